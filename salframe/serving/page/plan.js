// The floor plan: floors, places, objects and edges of the map, and on them an answer, a route or a trail.
// Positions of the map are in metres, x to the right and y up; those of the picture are in centimetres, y down.

import { percent, svg } from "./elements.js";

const CM = 100;
const MARGIN_M = 0.6;
const CHI_95 = Math.sqrt(5.991); // radius of the 95 % ellipse of two variables, in standard deviations
const SAME_FLOOR_M = 0.5;

const point = ([x, y]) => `${(x * CM).toFixed(1)},${(-y * CM).toFixed(1)}`;
const ring = (positions) => `M${positions.map(point).join("L")}Z`;

export class Plan {
  // `choosePlace` is called with a name, `choosePoint` with { x_m, y_m, z_m }.
  constructor(element, map, choosePlace, choosePoint) {
    this.element = element;
    this.map = map;
    this.choosePlace = choosePlace;
    this.layers = {};
    this.floors = [...new Set(this.of("floor").map((feature) => feature.properties.z_m))].sort((a, b) => a - b);
    this.floor = 0;
    element.addEventListener("click", (event) => {
      const at = this.toMap(event);
      if (event.target.closest(".place") === null && this.floors.length) choosePoint(at);
    });
    new ResizeObserver(() => this.scaleText()).observe(element);
    this.draw();
  }

  of(layer) {
    return this.map.features.filter((feature) => feature.properties.layer === layer);
  }

  // The number of the floor below a height: the highest one that is at most SAME_FLOOR_M above it.
  floorAt(z) {
    let number = 0;
    this.floors.forEach((floor, i) => { if (floor <= z + SAME_FLOOR_M) number = i; });
    return number;
  }

  show(floor) {
    this.floor = floor;
    this.draw();
  }

  isShown(z) {
    return this.floors.length < 2 || this.floorAt(z) === this.floor;
  }

  draw() {
    this.layers = {};
    const groups = ["ground", "shades", "things", "edges", "links", "trail", "route", "places", "pose"].map((name) => {
      this.layers[name] = svg("g", {});
      return this.layers[name];
    });
    this.element.replaceChildren(...groups);
    for (const feature of this.of("floor")) this.drawArea(feature, "floor");
    for (const feature of this.of("region")) this.drawArea(feature, "region");
    for (const feature of this.of("object")) this.drawObject(feature);
    for (const feature of this.of("edge")) this.drawEdge(feature);
    for (const feature of this.of("node")) this.drawNode(feature);
    for (const feature of this.of("place")) this.drawPlace(feature);
    const corners = this.corners();
    const [left, right] = [Math.min(...corners.map((c) => c[0])), Math.max(...corners.map((c) => c[0]))];
    const [low, high] = [Math.min(...corners.map((c) => c[1])), Math.max(...corners.map((c) => c[1]))];
    this.size_m = Math.hypot(right - left, high - low);
    this.box = [left - MARGIN_M, -high - MARGIN_M, right - left + 2 * MARGIN_M, high - low + 2 * MARGIN_M].map((v) => v * CM);
    this.element.setAttribute("viewBox", this.box.map((v) => v.toFixed(1)).join(" "));
    this.scaleText();
  }

  corners() {
    const positions = [];
    const collect = (value) => {
      if (typeof value[0] === "number") positions.push(value);
      else value.forEach(collect);
    };
    const outlines = [...this.of("floor"), ...this.of("region")];
    const all = outlines.length ? outlines : [...this.of("object"), ...this.of("place")];
    all.forEach((feature) => collect(feature.geometry.coordinates));
    return positions.length ? positions : [[0, 0], [1, 1]];
  }

  // Text has the same size on the screen at every width of the plan.
  scaleText() {
    const width = this.element.clientWidth;
    const height = this.element.clientHeight;
    if (!width || !height || !this.box) return;
    this.unit = Math.max(this.box[2] / width, this.box[3] / height);
    this.element.style.setProperty("--unit", this.unit);
    for (const dot of this.element.querySelectorAll("[data-px]")) dot.setAttribute("r", dot.dataset.px * this.unit);
    this.hideCrowdedNames();
  }

  // Hide names that would cover another name or leave the plan. They appear when their place has the pointer or the focus, or is the goal.
  hideCrowdedNames() {
    const plan = this.element.getBoundingClientRect();
    const shown = [];
    for (const text of this.layers.places.querySelectorAll("text")) {
      text.classList.remove("crowded");
      const box = text.getBoundingClientRect();
      const covers = shown.some((b) => box.left < b.right && b.left < box.right && box.top < b.bottom && b.top < box.bottom);
      if (covers || box.left < plan.left || box.right > plan.right) text.classList.add("crowded");
      else shown.push(box);
    }
  }

  drawArea(feature, kind) {
    if (!this.isShown(feature.properties.z_m)) return;
    const path = feature.geometry.coordinates.flat().map(ring).join("");
    const area = svg("path", { d: path, class: kind, "fill-rule": "evenodd" });
    if (kind === "region") area.append(svg("title", {}, feature.properties.place));
    this.layers.ground.append(area);
  }

  drawObject(feature) {
    if (!this.isShown(feature.properties.z_m)) return;
    const shape = svg("polygon", { points: feature.geometry.coordinates[0].map(point).join(" "), class: "object" });
    shape.append(svg("title", {}, `${feature.properties.label} in ${feature.properties.place}`));
    this.layers.things.append(shape);
  }

  drawEdge(feature) {
    if (!this.isShown(feature.geometry.coordinates[0][2])) return;
    const points = feature.geometry.coordinates.map(point).join(" ");
    this.layers.edges.append(svg("polyline", { points, class: "edge" }));
  }

  drawNode(feature) {
    const [x, y, z] = feature.geometry.coordinates;
    if (this.isShown(z)) this.layers.edges.append(this.dot([x, y], 2, "node"));
  }

  drawPlace(feature) {
    const [x, y, z] = feature.geometry.coordinates;
    if (!this.isShown(z)) return;
    const name = feature.properties.place;
    const place = svg("g", { class: "place", role: "button", tabindex: 0, "aria-label": `Route to ${name}` });
    const text = svg("text", { x: x * CM, y: -y * CM }, name);
    text.setAttribute("dy", "-0.9em");
    place.append(this.dot([x, y], 6, ""), text, svg("title", {}, name));
    place.dataset.place = name;
    place.addEventListener("click", () => this.choosePlace(name));
    place.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      this.choosePlace(name);
    });
    this.layers.places.append(place);
  }

  dot([x, y], px, kind) {
    return svg("circle", { cx: x * CM, cy: -y * CM, r: px, "data-px": px, class: kind });
  }

  mark(place) {
    for (const element of this.layers.places.children) {
      element.classList.toggle("chosen", element.dataset.place === place);
    }
  }

  // Shade regions by the probabilities of places.
  shade(places) {
    this.layers.shades.replaceChildren();
    const share = new Map(places.map((place) => [place.place, place.probability]));
    for (const feature of this.of("region")) {
      const probability = share.get(feature.properties.place);
      if (!probability || !this.isShown(feature.properties.z_m)) continue;
      const path = feature.geometry.coordinates.flat().map(ring).join("");
      const area = svg("path", { d: path, class: "shade", "fill-opacity": (0.1 + 0.4 * probability).toFixed(3) });
      area.dataset.place = feature.properties.place;
      area.append(svg("title", {}, `${feature.properties.place}: ${percent(probability)}`));
      this.layers.shades.append(area);
    }
  }

  showPose(pose, covariance, isSure, links = []) {
    this.layers.pose.replaceChildren();
    this.layers.links.replaceChildren();
    if (pose === null) return;
    if (this.floorAt(pose.z_m) !== this.floor && this.floors.length > 1) this.show(this.floorAt(pose.z_m));
    const [x, y] = [pose.x_m * CM, -pose.y_m * CM];
    this.layers.pose.classList.toggle("unsure", !isSure);
    if (covariance !== null) this.layers.pose.append(ellipse(x, y, covariance.matrix));
    const size = Math.max(0.18, this.size_m / 60) * CM;
    const transform = `translate(${x} ${y}) rotate(${-pose.yaw_deg}) scale(${size})`;
    const arrow = svg("polygon", { points: "1.3,0 -0.9,0.8 -0.45,0 -0.9,-0.8", transform, class: "arrow" });
    arrow.append(svg("title", {}, "Pose of the query"));
    this.layers.pose.append(arrow);
    for (const [linkX, linkY] of links) {
      this.layers.links.append(svg("line", { x1: x, y1: y, x2: linkX * CM, y2: -linkY * CM, class: "link" }), this.dot([linkX, linkY], 4, "linked"));
    }
    this.scaleText();
  }

  showRoute(line) {
    this.layers.route.replaceChildren(svg("polyline", { points: line.map(point).join(" "), class: "route" }));
  }

  showTrail(positions) {
    this.layers.trail.replaceChildren(svg("polyline", { points: positions.map(point).join(" "), class: "trail" }));
    this.layers.trail.append(...positions.map((position) => this.dot(position, 3, "trail-point")));
    this.scaleText();
  }

  toMap(event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.element.getScreenCTM().inverse());
    return { x_m: at.x / CM, y_m: -at.y / CM, z_m: this.floors[this.floor] ?? 0 };
  }
}

// The 95 % ellipse of the position.
function ellipse(x, y, matrix) {
  const [a, b, d] = [matrix[0][0], matrix[0][1], matrix[1][1]];
  const mean = (a + d) / 2;
  const spread = Math.hypot((a - d) / 2, b);
  const angle = (Math.atan2(2 * b, a - d) / 2) * (180 / Math.PI);
  const shape = svg("ellipse", {
    rx: CHI_95 * Math.sqrt(Math.max(mean + spread, 0)) * CM,
    ry: CHI_95 * Math.sqrt(Math.max(mean - spread, 0)) * CM,
    transform: `translate(${x} ${y}) rotate(${-angle})`,
    class: "ellipse",
  });
  shape.append(svg("title", {}, "95 % region of the position"));
  return shape;
}
