// Trajectories of navigation runs.

function showWalks() {
  if (!content.walks.length) return;
  const menus = make("span", {class: "tools", style: "margin: 0"}),
    place = make("div", {class: "trajectory"}),
    summary = make("p", {class: "note"});
  const colourKey = (colour, text) =>
    make("span", {class: "key"}, make("span", {class: "swatch", style: `background: var(${colour}); margin: 0`}), text);
  section(
    "trajectories",
    "Trajectories",
    make("div", {class: "tools"}, menus),
    summary,
    place,
    make(
      "p",
      {},
      colourKey("--c0", "true path of the agent; the dot is its start"),
      colourKey("--c1", "estimated positions"),
      colourKey("--c2", "goal, with a circle of radius 0.5 m"),
    ),
  );
  const selected = {walk: 0, arm: null, outcome: 0, episode: 0};
  const change = (next) => {
    Object.assign(selected, next);
    paint();
  };
  const paint = () => {
    const walk = content.walks[selected.walk],
      arms = Object.keys(walk.episodes).map(Number);
    if (!arms.includes(selected.arm)) selected.arm = arms[0];
    const all = walk.episodes[selected.arm] || [];
    const rows = all.filter((row) => !selected.outcome || row.success === (selected.outcome === 1));
    const row = rows[Math.min(selected.episode, rows.length - 1)];
    const numFailed = all.filter((one) => !one.success).length;
    menus.replaceChildren(
      makeMenu(
        "run",
        content.walks.map((one) => one.name),
        (walk) => change({walk, episode: 0}),
        selected.walk,
      ),
      makeMenu(
        "method",
        arms.map((arm) => content.arms[arm].name),
        (i) => change({arm: arms[i], episode: 0}),
        arms.indexOf(selected.arm),
      ),
      makeMenu(
        "outcome",
        ["all", `success (${all.length - numFailed})`, `failure (${numFailed})`],
        (outcome) => change({outcome, episode: 0}),
        selected.outcome,
      ),
      makeMenu(
        "episode",
        rows.map((one) => `${one.episode}: to ${one.goal} in ${one.world}`),
        (episode) => change({episode}),
        selected.episode,
      ),
    );
    summary.textContent = row
      ? `${row.success ? "success" : "failure"}, ${row.status}, ${row.travelled_m.toFixed(1)} m walked, ` +
        `${row.shortest_m.toFixed(1)} m shortest path, ` +
        `${row.left_m === null ? "no path" : `${row.left_m.toFixed(1)} m`} to the goal, ` +
        `${row.panoramas} panoramas, ${row.collisions} collisions` +
        (walk.worlds[row.world].floors > 1 ? "; the floors are drawn side by side, the lowest on the left" : "")
      : "no episodes";
    place.replaceChildren(row ? drawWalk(walk.worlds[row.world], row) : "");
  };
  paint();
}

function drawWalk(world, row) {
  const [left, top, width, height] = world.box,
    r = Math.max(width, height) / 170;
  const at = ([x, y]) => `${(x - left).toFixed(3)},${(top - y).toFixed(3)}`;
  const circle = ([x, y], radius, style) => draw("circle", {cx: x - left, cy: top - y, r: radius, ...style});
  const line = (points, style) =>
    draw("polyline", {
      points: points.map(at).join(" "),
      fill: "none",
      "stroke-width": r * 0.6,
      "stroke-linejoin": "round",
      ...style,
    });
  const estimated = row.believed.filter((point) => point),
    goal = world.nodes[row.goal];
  return draw(
    "svg",
    {viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "Trajectory"},
    world.picture
      ? draw("image", {
          href: world.picture,
          width,
          height,
          style: "image-rendering: pixelated",
          opacity: "var(--floor, 1)",
        })
      : null,
    world.edges.map((edge) =>
      line([edge.slice(0, 2), edge.slice(2)], {stroke: "var(--line)", "stroke-width": r * 0.4}),
    ),
    Object.values(world.nodes).map((node) => circle(node, r * 0.5, {fill: "var(--quiet)", opacity: 0.6})),
    goal ? [circle(goal, 0.5, {fill: "var(--c2)", opacity: 0.35}), circle(goal, r * 1.2, {fill: "var(--c2)"})] : null,
    line(row.path, {stroke: "var(--c0)"}),
    estimated.map((point) => circle(point, r * 0.8, {fill: "var(--c1)"})),
    line(estimated, {stroke: "var(--c1)", "stroke-dasharray": `${r} ${r}`, opacity: 0.6}),
    circle(row.path[0], r * 1.4, {fill: "var(--c0)"}),
  );
}
