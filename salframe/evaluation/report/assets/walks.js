// Trajectories of navigation runs.

function showWalks() {
  if (!content.walks.length) return;
  const menus = make("span", {class: "tools", style: "margin: 0"}),
    place = make("div", {class: "trajectory"}),
    about = make("p", {class: "note"});
  const key = (colour, text) =>
    make("span", {class: "key"}, make("span", {class: "swatch", style: `background: var(${colour}); margin: 0`}), text);
  section(
    "trajectories",
    "Trajectories",
    make("div", {class: "tools"}, menus),
    about,
    place,
    make(
      "p",
      {},
      key("--c0", "where the agent was, from its start on"),
      key("--c1", "where it believed to be"),
      key("--c2", "goal, and 0.5 m around it"),
    ),
  );
  const shown = {walk: 0, arm: null, outcome: 0, episode: 0};
  const change = (next) => {
    Object.assign(shown, next);
    paint();
  };
  const paint = () => {
    const walk = content.walks[shown.walk],
      arms = Object.keys(walk.episodes).map(Number);
    if (!arms.includes(shown.arm)) shown.arm = arms[0];
    const all = walk.episodes[shown.arm] || [];
    const rows = all.filter((row) => !shown.outcome || row.success === (shown.outcome === 1));
    const row = rows[Math.min(shown.episode, rows.length - 1)];
    const failed = all.filter((one) => !one.success).length;
    menus.replaceChildren(
      choose(
        "run",
        content.walks.map((one) => one.name),
        (walk) => change({walk, episode: 0}),
        shown.walk,
      ),
      choose(
        "method",
        arms.map((arm) => content.arms[arm].name),
        (i) => change({arm: arms[i], episode: 0}),
        arms.indexOf(shown.arm),
      ),
      choose(
        "outcome",
        ["all", `success (${all.length - failed})`, `failure (${failed})`],
        (outcome) => change({outcome, episode: 0}),
        shown.outcome,
      ),
      choose(
        "episode",
        rows.map((one) => `${one.episode}: to ${one.goal} in ${one.world}`),
        (episode) => change({episode}),
        shown.episode,
      ),
    );
    about.textContent = row
      ? `${row.success ? "success" : "failure"}, ${row.status}, ${row.travelled_m.toFixed(1)} m walked, ${row.shortest_m.toFixed(1)} m shortest, ` +
        `${row.left_m === null ? "no way" : `${row.left_m.toFixed(1)} m`} left, ${row.panoramas} panoramas, ${row.collisions} collisions` +
        (walk.worlds[row.world].floors > 1 ? "; the floors are beside each other, the lowest on the left" : "")
      : "no episode";
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
  const believed = row.believed.filter((point) => point),
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
    believed.map((point) => circle(point, r * 0.8, {fill: "var(--c1)"})),
    line(believed, {stroke: "var(--c1)", "stroke-dasharray": `${r} ${r}`, opacity: 0.6}),
    circle(row.path[0], r * 1.4, {fill: "var(--c0)"}),
  );
}
