// The objects of a query: outlines on the image, the graph from above, and a table.

import { byId, coloursOf, html, svg } from "./elements.js";

const MAX_ROWS = 60;
const NAMED = 12;
let colours = new Map();

export function showObjects(answer) {
  const objects = answer.objects ?? [];
  colours = coloursOf(objects.map((thing) => thing.label));
  byId("object-views").hidden = objects.length === 0;
  byId("picture").hidden = !answer.picture;
  byId("outlines").replaceChildren();
  if (answer.picture) showOutlines(answer.picture, objects);
  showGraph(objects, answer.edges ?? []);
  byId("objects").replaceChildren(...objects.slice(0, MAX_ROWS).map(row));
}

function showOutlines(picture, objects) {
  byId("seen").src = picture;
  const area = byId("outlines");
  area.setAttribute("viewBox", "0 0 1 1");
  area.setAttribute("preserveAspectRatio", "none");
  objects.forEach((thing, i) => {
    for (const line of thing.outline) {
      const points = line.map(([x, y]) => `${x},${y}`).join(" ");
      const shape = svg("polygon", { points, class: colours.get(thing.label), "data-object": i });
      shape.append(svg("title", {}, thing.label));
      shape.addEventListener("pointerenter", () => light(i));
      shape.addEventListener("pointerleave", () => light(null));
      area.append(shape);
    }
  });
}

function showGraph(objects, edges) {
  const ranged = objects.filter((thing) => thing.centroid_m !== null);
  byId("graph-figure").hidden = ranged.length === 0;
  if (ranged.length === 0) return;
  const reach = Math.max(1, ...ranged.map((thing) => Math.hypot(thing.centroid_m[0], thing.centroid_m[1])));
  const at = (thing) => [50 - (42 * thing.centroid_m[1]) / reach, 50 - (42 * thing.centroid_m[0]) / reach];
  const maxSaliency = Math.max(...ranged.map((thing) => thing.saliency), 1e-9);
  const lines = edges
    .filter(([a, b]) => objects[a].centroid_m && objects[b].centroid_m)
    .map(([a, b]) => {
      const [[x1, y1], [x2, y2]] = [at(objects[a]), at(objects[b])];
      return svg("line", { x1, y1, x2, y2 });
    });
  const nodes = ranged.map((thing) => {
    const [cx, cy] = at(thing);
    const kind = `${colours.get(thing.label)}${thing.matched ? " full" : ""}`;
    const dot = svg("circle", { cx, cy, r: 1.2 + 2.2 * Math.sqrt(thing.saliency / maxSaliency), class: kind });
    dot.append(svg("title", {}, thing.label));
    return dot;
  });
  const names = ranged.slice(0, NAMED).map((thing) => {
    const [x, y] = at(thing);
    return svg("text", { x, y: y - 4, "text-anchor": x < 20 ? "start" : x > 80 ? "end" : "middle" }, thing.label);
  });
  const self = svg("polygon", { points: "50,46 52.6,53 50,51.4 47.4,53", class: "self" });
  byId("graph").setAttribute("viewBox", "0 0 100 100");
  byId("graph").replaceChildren(...lines, ...nodes, ...names, self);
}

function row(thing, i) {
  const name = html("th", { scope: "row" }, html("span", { class: `swatch ${colours.get(thing.label)}` }), thing.label);
  const line = html(
    "tr", { "data-object": i }, name,
    html("td", {}, thing.score.toFixed(2)),
    html("td", {}, `${thing.azimuth_deg.toFixed(0)}°`),
    html("td", {}, thing.matched ? thing.matched.label : "-"),
  );
  line.addEventListener("pointerenter", () => light(i));
  line.addEventListener("pointerleave", () => light(null));
  return line;
}

// Emphasize one object in the image and in the table.
function light(number) {
  for (const element of document.querySelectorAll("[data-object]")) {
    element.classList.toggle("lit", Number(element.dataset.object) === number);
  }
}
