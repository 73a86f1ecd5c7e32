// Panoramas with their objects, and top views of graphs. A panorama is drawn WIDTH x HEIGHT units large and cropped to
// elevations from -60 to 60 degrees.

const WIDTH = 512,
  HEIGHT = 256,
  TOP = HEIGHT / 6,
  VISIBLE_HEIGHT = (HEIGHT * 2) / 3,
  GAP = 14,
  MAX_NAMES = 16; // maximum number of objects whose names are drawn, if not more are matched
const MIN_SPAN_M = 4,
  NEAR_M = 6; // a top view is at least MIN_SPAN_M wide and contains all objects nearer to the camera than NEAR_M

// Return the pixel of a point (x, y, z) in the frame of the camera.
const pixel = ([x, y, z]) => [
  ((Math.PI - Math.atan2(y, x)) / (2 * Math.PI)) * WIDTH,
  (0.5 - Math.atan2(z, Math.hypot(x, y)) / Math.PI) * HEIGHT,
];
// Return the pixel of a direction.
const anglePixel = (azimuth, elevation) => [
  ((Math.PI - azimuth) / (2 * Math.PI)) * WIDTH,
  (0.5 - elevation / Math.PI) * HEIGHT,
];

// Return a colour that depends only on the label.
function labelColour(label) {
  let hash = 7;
  for (const letter of label) hash = (hash * 31 + letter.codePointAt(0)) % 3600;
  return `hsl(${hash / 10} 70% 52%)`;
}

const countObjects = (objects) => (objects ? objects.labels.length : 0);
const centreOf = (objects, k) => (objects.bearing ? objects.bearing[k] : objects.box[k].slice(0, 3));

// Return the eight corners of a box.
function corners([x, y, z, length, width, height, yaw]) {
  const points = [],
    c = Math.cos(yaw),
    s = Math.sin(yaw);
  for (const a of [-0.5, 0.5])
    for (const b of [-0.5, 0.5])
      for (const h of [-0.5, 0.5])
        points.push([x + c * a * length - s * b * width, y + s * a * length + c * b * width, z + h * height]);
  return points;
}

// Return the four corners (x, y) of a box in the top view.
function footprint([x, y, , length, width, , yaw]) {
  const c = Math.cos(yaw),
    s = Math.sin(yaw);
  return [
    [1, 1],
    [1, -1],
    [-1, -1],
    [-1, 1],
  ].map(([a, b]) => [x + (c * a * length - s * b * width) / 2, y + (s * a * length + c * b * width) / 2]);
}

// Return the convex hull of points, by Andrew's monotone chain.
function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const turn = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
  const half = (list) => {
    const chain = [];
    for (const point of list) {
      while (chain.length > 1 && turn(chain.at(-2), chain.at(-1), point) <= 0) chain.pop();
      chain.push(point);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

// Shift points across the seam of the panorama, so that they are one shape around the column `near`.
const unwrap = (points, near) => points.map(([x, y]) => [x + WIDTH * Math.round((near - x) / WIDTH), y]);
// Draw a shape once for each side of the seam on which it is visible.
const drawAround = (points, paint) =>
  [-WIDTH, 0, WIDTH]
    .filter((shift) => points.some(([x]) => x + shift > 0 && x + shift < WIDTH))
    .map((shift) => paint(points.map(([x, y]) => [x + shift, y])));
const path = (points) => points.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");

// Draw a panorama with its objects at (x, y) of an outer drawing. The names of the `matched` objects have priority.
function panorama(x, y, url, objects, matched) {
  const inner = draw("svg", {
    x,
    y,
    width: WIDTH,
    height: VISIBLE_HEIGHT,
    viewBox: `0 ${TOP} ${WIDTH} ${VISIBLE_HEIGHT}`,
  });
  inner.append(draw("rect", {x: 0, y: TOP, width: WIDTH, height: VISIBLE_HEIGHT, fill: "var(--line)"}));
  if (url) inner.append(draw("image", {href: url, width: WIDTH, height: HEIGHT, preserveAspectRatio: "none"}));
  if (!objects) return inner;
  const places = objects.labels.map((_, k) => pixel(centreOf(objects, k)));
  objects.labels.forEach((label, k) => {
    if (!objects.box || !objects.saliency) return;
    const shape = unwrap(corners(objects.box[k]).map(pixel), places[k][0]),
      columns = shape.map((point) => point[0]);
    if (Math.max(...columns) - Math.min(...columns) > WIDTH / 2) return;
    inner.append(
      ...drawAround(hull(shape), (points) =>
        draw(
          "polygon",
          {
            points: path(points),
            fill: labelColour(label),
            "fill-opacity": 0.14,
            stroke: labelColour(label),
            "stroke-width": 0.9,
          },
          draw("title", {}, label),
        ),
      ),
    );
  });
  for (const [a, b] of objects.edges)
    inner.append(
      ...drawAround(unwrap([places[a], places[b]], places[a][0]), (points) =>
        draw("polyline", {points: path(points), stroke: "#fff", "stroke-width": 0.8, opacity: 0.75, fill: "none"}),
      ),
    );
  const maxSaliency = Math.max(1e-9, ...(objects.saliency || [0]));
  objects.labels.forEach((label, k) =>
    inner.append(
      draw(
        "circle",
        {
          cx: places[k][0],
          cy: places[k][1],
          r: objects.saliency ? 1.6 + 3.4 * Math.sqrt(objects.saliency[k] / maxSaliency) : 2.4,
          fill: labelColour(label),
          stroke: "#fff",
          "stroke-width": 0.8,
        },
        draw("title", {}, objects.saliency ? `${label}, saliency ${(100 * objects.saliency[k]).toFixed(1)} %` : label),
      ),
    ),
  );
  inner.append(...nameObjects(objects, places, matched));
  return inner;
}

// Draw the names of objects, the matched ones first. A name that would overlap another one is omitted.
function nameObjects(objects, places, matched) {
  const order = objects.labels
    .map((_, k) => k)
    .sort(
      (a, b) => matched.has(b) - matched.has(a) || (objects.saliency ? objects.saliency[b] - objects.saliency[a] : 0),
    );
  const reserved = [],
    names = [];
  for (const k of order.slice(0, Math.max(MAX_NAMES, matched.size))) {
    const label = objects.labels[k],
      fontSize = innerWidth < 860 ? 14 : 9,
      width = 0.545 * fontSize * label.length,
      [x, y] = places[k];
    if (y < TOP + 4 || y > TOP + VISIBLE_HEIGHT) continue;
    const left = Math.min(Math.max(x - width / 2, 1), WIDTH - width - 1),
      box = [left, y - 6 - fontSize, left + width, y - 4];
    if (reserve(box, reserved)) names.push(draw("text", {x: left, y: y - 6}, label));
  }
  return names;
}

// Draw two panoramas, side by side or stacked, with lines between matched objects or points.
function drawPair(query, reference, match, stacked) {
  const [dx, dy] = stacked ? [0, VISIBLE_HEIGHT + GAP] : [WIDTH + GAP, 0];
  const svg = draw("svg", {
    class: "pair",
    viewBox: `0 0 ${stacked ? WIDTH : 2 * WIDTH + GAP} ${stacked ? 2 * VISIBLE_HEIGHT + GAP : VISIBLE_HEIGHT}`,
    role: "img",
    "aria-label": "Panoramas of the query and of the map, with matches",
  });
  const pairs = match.pairs || [];
  svg.append(
    panorama(0, 0, query.url, query.objects, new Set(pairs.map((pair) => pair[0]))),
    panorama(dx, dy, reference.url, reference.objects, new Set(pairs.map((pair) => pair[1]))),
  );
  const link = ([x1, y1], [x2, y2], colour, width, title) =>
    svg.append(
      draw(
        "line",
        {x1, y1: y1 - TOP, x2: x2 + dx, y2: y2 - TOP + dy, stroke: colour, "stroke-width": width, opacity: 0.85},
        draw("title", {}, title),
      ),
    );
  for (const [a, b] of query.objects && reference.objects ? pairs : [])
    link(
      pixel(centreOf(query.objects, a)),
      pixel(centreOf(reference.objects, b)),
      labelColour(query.objects.labels[a]),
      1.4,
      query.objects.labels[a],
    );
  for (const [a1, e1, a2, e2] of match.points || [])
    link(anglePixel(a1, e1), anglePixel(a2, e2), "var(--c4)", 0.6, "matched point");
  return svg;
}

// Transform a point by a pose (x, y, yaw) in the plane.
const transformPoint = ([x, y, yaw], [px, py]) => [
  x + Math.cos(yaw) * px - Math.sin(yaw) * py,
  y + Math.sin(yaw) * px + Math.cos(yaw) * py,
];

// Draw the top view of both graphs in the world frame. The graph of the reference frame is drawn at its pose, the graph
// of the query at `pose`.
function drawTopView(query, reference, match, pose, truth, floor) {
  const graphs = [];
  for (const [objects, at, colour] of [
    [reference.objects, reference.pose, "--c1"],
    [query.objects, pose, "--c0"],
  ])
    if (objects && objects.box && at)
      graphs.push({
        colour,
        names: objects.labels,
        saliency: objects.saliency,
        shapes: objects.box.map((box) => footprint(box).map((p) => transformPoint(at, p))),
        centres: objects.box.map((box) => transformPoint(at, box)),
        edges: objects.edges,
      });
    else graphs.push(null);
  const cameras = [
    [reference.pose, "--c1", "reference frame"],
    [pose, "--c0", "query"],
    [truth, "--c2", "true pose of the query"],
  ].filter((one) => one[0]);
  const camera = cameras[0][0],
    near = graphs
      .flatMap((one) => (one ? one.centres : []))
      .filter(([x, y]) => Math.hypot(x - camera[0], y - camera[1]) < NEAR_M);
  const points = [...near, ...cameras.map((one) => one[0])],
    xs = points.map((p) => p[0]),
    ys = points.map((p) => p[1]);
  const spread = (values) => Math.max(0, MIN_SPAN_M - Math.max(...values) + Math.min(...values)) / 2 + 1;
  const left = Math.min(...xs) - spread(xs),
    top = Math.max(...ys) + spread(ys),
    width = Math.max(...xs) + spread(xs) - left,
    height = top - Math.min(...ys) + spread(ys);
  const scale = 520 / Math.max(width, 0.8 * height),
    at = ([x, y]) => [(x - left) * scale, (top - y) * scale];
  const svg = draw("svg", {
    viewBox: `0 0 ${(width * scale).toFixed(1)} ${(height * scale).toFixed(1)}`,
    role: "img",
    "aria-label": "Top view of both graphs",
    style: "max-height: 66vh",
  });
  if (floor) {
    const [fl, ft, fw, fh] = floor.box,
      [x, y] = at([fl, ft]);
    svg.append(
      draw("image", {
        href: floor.picture,
        x,
        y,
        width: fw * scale,
        height: fh * scale,
        preserveAspectRatio: "none",
        opacity: "var(--floor, 1)",
      }),
    );
  }
  for (const one of graphs.filter(Boolean)) {
    const colour = `var(${one.colour})`;
    one.shapes.forEach((shape, k) =>
      svg.append(
        draw(
          "polygon",
          {points: path(shape.map(at)), fill: colour, "fill-opacity": 0.1, stroke: colour, "stroke-width": 0.9},
          draw("title", {}, one.names[k]),
        ),
      ),
    );
    for (const [a, b] of one.edges)
      svg.append(
        draw("polyline", {
          points: path([one.centres[a], one.centres[b]].map(at)),
          stroke: colour,
          "stroke-width": 0.7,
          opacity: 0.5,
        }),
      );
    one.centres.forEach((centre, k) =>
      svg.append(
        draw("circle", {cx: at(centre)[0], cy: at(centre)[1], r: 2.4, fill: colour}, draw("title", {}, one.names[k])),
      ),
    );
  }
  const [referenceGraph, queryGraph] = graphs;
  if (referenceGraph && queryGraph)
    for (const [a, b] of match.pairs || []) {
      svg.append(
        draw("polyline", {
          points: path([at(queryGraph.centres[a]), at(referenceGraph.centres[b])]),
          stroke: "var(--ink)",
          "stroke-width": 1.6,
          "stroke-dasharray": "3 2",
        }),
      );
      const [x, y] = at(referenceGraph.centres[b]);
      svg.append(draw("text", {x: x + 4, y: y - 3}, referenceGraph.names[b]));
    }
  for (const [[x, y, yaw], colour, title] of cameras) {
    const arrow = [
      [0.34, 0],
      [-0.2, 0.2],
      [-0.08, 0],
      [-0.2, -0.2],
    ].map((p) => at(transformPoint([x, y, yaw], p)));
    const style =
      colour === "--c2"
        ? {fill: "none", stroke: "var(--c2)", "stroke-width": 2}
        : {fill: `var(${colour})`, stroke: "var(--paper)", "stroke-width": 1};
    svg.append(draw("polygon", {points: path(arrow), ...style}, draw("title", {}, title)));
  }
  return svg;
}
