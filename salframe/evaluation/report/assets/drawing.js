// Panoramas with their objects, and graphs from above. A panorama is WIDE x HIGH units, shown from 60 degrees above to 60
// below the horizon.

const WIDE = 512,
  HIGH = 256,
  TOP = HIGH / 6,
  SEEN = (HIGH * 2) / 3,
  GAP = 14,
  NAMED = 16;
const MIN_M = 4,
  NEAR_M = 6; // a graph from above shows so much at least, and what is so near to the camera

const pixel = ([x, y, z]) => [
  ((Math.PI - Math.atan2(y, x)) / (2 * Math.PI)) * WIDE,
  (0.5 - Math.atan2(z, Math.hypot(x, y)) / Math.PI) * HIGH,
];
const angles = (azimuth, elevation) => [
  ((Math.PI - azimuth) / (2 * Math.PI)) * WIDE,
  (0.5 - elevation / Math.PI) * HIGH,
];

function hueOf(label) {
  let hash = 7;
  for (const letter of label) hash = (hash * 31 + letter.codePointAt(0)) % 3600;
  return `hsl(${hash / 10} 70% 52%)`;
}

const sizeOfObjects = (objects) => (objects ? objects.labels.length : 0);
const centreOf = (objects, k) => (objects.bearing ? objects.bearing[k] : objects.box[k].slice(0, 3));

function corners([x, y, z, length, width, height, yaw]) {
  const found = [],
    c = Math.cos(yaw),
    s = Math.sin(yaw);
  for (const a of [-0.5, 0.5])
    for (const b of [-0.5, 0.5])
      for (const h of [-0.5, 0.5])
        found.push([x + c * a * length - s * b * width, y + s * a * length + c * b * width, z + h * height]);
  return found;
}

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

// The convex hull of points, by Andrew's monotone chain.
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

// Points on both sides of the seam, as one shape around the column of `near`.
const unwrap = (points, near) => points.map(([x, y]) => [x + WIDE * Math.round((near - x) / WIDE), y]);
const around = (points, paint) =>
  [-WIDE, 0, WIDE]
    .filter((shift) => points.some(([x]) => x + shift > 0 && x + shift < WIDE))
    .map((shift) => paint(points.map(([x, y]) => [x + shift, y])));
const path = (points) => points.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");

// A panorama with its objects at (x, y) of an outer drawing; `matched` are those that are named first.
function panorama(x, y, url, objects, matched) {
  const inner = draw("svg", {x, y, width: WIDE, height: SEEN, viewBox: `0 ${TOP} ${WIDE} ${SEEN}`});
  inner.append(draw("rect", {x: 0, y: TOP, width: WIDE, height: SEEN, fill: "var(--line)"}));
  if (url) inner.append(draw("image", {href: url, width: WIDE, height: HIGH, preserveAspectRatio: "none"}));
  if (!objects) return inner;
  const places = objects.labels.map((_, k) => pixel(centreOf(objects, k)));
  objects.labels.forEach((label, k) => {
    if (!objects.box || !objects.saliency) return;
    const shape = unwrap(corners(objects.box[k]).map(pixel), places[k][0]),
      columns = shape.map((point) => point[0]);
    if (Math.max(...columns) - Math.min(...columns) > WIDE / 2) return;
    inner.append(
      ...around(hull(shape), (points) =>
        draw(
          "polygon",
          {points: path(points), fill: hueOf(label), "fill-opacity": 0.14, stroke: hueOf(label), "stroke-width": 0.9},
          draw("title", {}, label),
        ),
      ),
    );
  });
  for (const [a, b] of objects.edges)
    inner.append(
      ...around(unwrap([places[a], places[b]], places[a][0]), (points) =>
        draw("polyline", {points: path(points), stroke: "#fff", "stroke-width": 0.8, opacity: 0.75, fill: "none"}),
      ),
    );
  const most = Math.max(1e-9, ...(objects.saliency || [0]));
  objects.labels.forEach((label, k) =>
    inner.append(
      draw(
        "circle",
        {
          cx: places[k][0],
          cy: places[k][1],
          r: objects.saliency ? 1.6 + 3.4 * Math.sqrt(objects.saliency[k] / most) : 2.4,
          fill: hueOf(label),
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

// Names beside objects, the matched first, where none lies on another.
function nameObjects(objects, places, matched) {
  const order = objects.labels
    .map((_, k) => k)
    .sort(
      (a, b) => matched.has(b) - matched.has(a) || (objects.saliency ? objects.saliency[b] - objects.saliency[a] : 0),
    );
  const taken = [],
    made = [];
  for (const k of order.slice(0, Math.max(NAMED, matched.size))) {
    const label = objects.labels[k],
      letters = innerWidth < 860 ? 14 : 9,
      long = 0.545 * letters * label.length,
      [x, y] = places[k];
    if (y < TOP + 4 || y > TOP + SEEN) continue;
    const left = Math.min(Math.max(x - long / 2, 1), WIDE - long - 1),
      box = [left, y - 6 - letters, left + long, y - 4];
    if (taken.some((other) => box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3]))
      continue;
    taken.push(box);
    made.push(draw("text", {x: left, y: y - 6}, label));
  }
  return made;
}

// Two panoramas, side by side or one below the other, and what is matched between them.
function pairOf(query, reference, match, stacked) {
  const [dx, dy] = stacked ? [0, SEEN + GAP] : [WIDE + GAP, 0];
  const svg = draw("svg", {
    class: "pair",
    viewBox: `0 0 ${stacked ? WIDE : 2 * WIDE + GAP} ${stacked ? 2 * SEEN + GAP : SEEN}`,
    role: "img",
    "aria-label": "The query and the map's panorama",
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
      hueOf(query.objects.labels[a]),
      1.4,
      query.objects.labels[a],
    );
  for (const [a1, e1, a2, e2] of match.points || [])
    link(angles(a1, e1), angles(a2, e2), "var(--c4)", 0.6, "matched point");
  return svg;
}

const turned = ([x, y, yaw], [px, py]) => [
  x + Math.cos(yaw) * px - Math.sin(yaw) * py,
  y + Math.sin(yaw) * px + Math.cos(yaw) * py,
];

// Both graphs from above, in the world: the map's where its panorama was taken, the query's under a pose.
function planOf(query, reference, match, pose, truth, floor) {
  const placed = [];
  for (const [objects, at, colour] of [
    [reference.objects, reference.pose, "--c1"],
    [query.objects, pose, "--c0"],
  ])
    if (objects && objects.box && at)
      placed.push({
        colour,
        names: objects.labels,
        saliency: objects.saliency,
        shapes: objects.box.map((box) => footprint(box).map((p) => turned(at, p))),
        centres: objects.box.map((box) => turned(at, box)),
        edges: objects.edges,
      });
    else placed.push(null);
  const cameras = [
    [reference.pose, "--c1", "the map's panorama"],
    [pose, "--c0", "the query, as estimated"],
    [truth, "--c2", "the query, in truth"],
  ].filter((one) => one[0]);
  const eye = cameras[0][0],
    near = placed
      .flatMap((one) => (one ? one.centres : []))
      .filter(([x, y]) => Math.hypot(x - eye[0], y - eye[1]) < NEAR_M);
  const points = [...near, ...cameras.map((one) => one[0])],
    xs = points.map((p) => p[0]),
    ys = points.map((p) => p[1]);
  const spread = (values) => Math.max(0, MIN_M - Math.max(...values) + Math.min(...values)) / 2 + 1;
  const left = Math.min(...xs) - spread(xs),
    top = Math.max(...ys) + spread(ys),
    width = Math.max(...xs) + spread(xs) - left,
    height = top - Math.min(...ys) + spread(ys);
  const scale = 520 / Math.max(width, 0.8 * height),
    at = ([x, y]) => [(x - left) * scale, (top - y) * scale];
  const svg = draw("svg", {
    viewBox: `0 0 ${(width * scale).toFixed(1)} ${(height * scale).toFixed(1)}`,
    role: "img",
    "aria-label": "Both graphs from above",
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
  for (const one of placed.filter(Boolean)) {
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
  const [map, asks] = placed;
  if (map && asks)
    for (const [a, b] of match.pairs || []) {
      svg.append(
        draw("polyline", {
          points: path([at(asks.centres[a]), at(map.centres[b])]),
          stroke: "var(--ink)",
          "stroke-width": 1.6,
          "stroke-dasharray": "3 2",
        }),
      );
      const [x, y] = at(map.centres[b]);
      svg.append(draw("text", {x: x + 4, y: y - 3}, map.names[b]));
    }
  for (const [[x, y, yaw], colour, title] of cameras) {
    const head = [
      [0.34, 0],
      [-0.2, 0.2],
      [-0.08, 0],
      [-0.2, -0.2],
    ].map((p) => at(turned([x, y, yaw], p)));
    const style =
      colour === "--c2"
        ? {fill: "none", stroke: "var(--c2)", "stroke-width": 2}
        : {fill: `var(${colour})`, stroke: "var(--paper)", "stroke-width": 1};
    svg.append(draw("polygon", {points: path(head), ...style}, draw("title", {}, title)));
  }
  return svg;
}
