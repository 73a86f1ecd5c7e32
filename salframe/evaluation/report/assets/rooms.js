// The selected data set and arm (method with its settings), the confusion matrix of places, and the floor plan.

const sets = content.sets;
const selection = {set: 0, arm: null, outcome: null, truth: null, answer: null, text: "", floor: 0};
const selectionListeners = []; // functions to call when the selection changes
const currentSet = () => sets[selection.set];
const armsOf = (set) => Object.keys(set.answers).map(Number);
const answersOf = (arm) => currentSet().answers[arm];

// Change the selection, and draw every part of the page that depends on it.
function updateSelection(change) {
  Object.assign(selection, change);
  if (sets.length && !armsOf(currentSet()).includes(selection.arm)) selection.arm = armsOf(currentSet())[0] ?? null;
  for (const paint of selectionListeners) paint();
}

// Create menus of the data set and the arm, which show the current selection.
function selectionMenus() {
  const place = make("span", {class: "tools", style: "margin: 0"});
  selectionListeners.push(() => {
    const arms = armsOf(currentSet());
    place.replaceChildren(
      makeMenu(
        "data",
        sets.map((set) => set.name),
        (set) => updateSelection({set, truth: null, answer: null, floor: 0}),
        selection.set,
      ),
      makeMenu(
        "method",
        arms.map((arm) => content.arms[arm].name),
        (i) => updateSelection({arm: arms[i]}),
        arms.indexOf(selection.arm),
      ),
    );
  });
  return place;
}

const outcomeOf = (i, arm = selection.arm) => answersOf(arm).outcome[i];

function showConfusion() {
  if (!sets.some((set) => armsOf(set).length)) return;
  const place = make("div", {class: "scroll matrix", tabindex: 0});
  const onlyWrong = make("input", {type: "checkbox", onchange: () => paint()});
  onlyWrong.checked = sets[0].places.length > 16;
  const note = make("p", {class: "note"});
  section(
    "rooms",
    "Rooms",
    make(
      "p",
      {class: "note"},
      "Rows: true place of a query. Columns: answered place. Click a cell to list its queries.",
    ),
    make("div", {class: "tools"}, selectionMenus(), make("label", {}, onlyWrong, "only wrong answers")),
    place,
    note,
  );
  const paint = () => {
    const counts = countPairs();
    place.replaceChildren(matrix(counts, onlyWrong.checked));
    const wrong = [...counts.values()].filter((pair) => pair.truth !== pair.answer && pair.answer !== null);
    wrong.sort((a, b) => b.queries.length - a.queries.length);
    const examples = wrong
      .slice(0, 5)
      .map((pair) => `${placeName(pair.truth)} confused with ${placeName(pair.answer)} (${pair.queries.length})`);
    note.textContent = examples.length
      ? `Most frequent errors: ${examples.join(", ")}.`
      : "No query has a wrong place.";
  };
  selectionListeners.push(paint);
}

const placeName = (place) => (place === null ? "no place" : currentSet().places[place]);

// Return the queries of each pair of a true place and an answered place. The answer is null if no place was answered.
function countPairs() {
  const pairs = new Map(),
    answers = answersOf(selection.arm);
  currentSet().truth.forEach((truth, i) => {
    // A correct rejection (outcome 0) can list places, too. They are not its answer.
    const namesPlace = answers.outcome[i] === 1 || (answers.outcome[i] === 0 && answers.place[i] === truth);
    const answer = namesPlace ? answers.place[i] : null;
    const key = `${truth} ${answer}`;
    if (!pairs.has(key)) pairs.set(key, {truth, answer, queries: []});
    pairs.get(key).queries.push(i);
  });
  return pairs;
}

// Draw the confusion matrix.
function matrix(pairs, onlyWrong) {
  const all = [...pairs.values()];
  const shown = onlyWrong ? all.filter((pair) => pair.truth !== pair.answer) : all;
  const rows = [...new Set(shown.map((pair) => pair.truth))].sort((a, b) => a - b);
  const columns = [...new Set(shown.flatMap((pair) => [pair.answer, ...(onlyWrong ? [] : [pair.truth])]))].sort(
    (a, b) => (a === null) - (b === null) || a - b,
  );
  if (!rows.length) return make("p", {class: "note"}, "All answers are correct.");
  const cell = rows.length > 60 ? 12 : 18,
    maxLength = Math.max(...[...rows, ...columns].map((place) => placeName(place).length));
  const margin = Math.min(190, 12 + 6.2 * maxLength),
    width = margin + cell * columns.length + 60,
    height = margin + cell * rows.length + 4;
  const shorten = (text) => (text.length > 28 ? `${text.slice(0, 27)}…` : text);
  const svg = draw("svg", {
    width,
    height,
    viewBox: `0 0 ${width} ${height}`,
    role: "img",
    "aria-label": "Confusion matrix of places",
  });
  columns.forEach((place, x) =>
    svg.append(
      draw(
        "text",
        {transform: `translate(${margin + cell * (x + 0.7)} ${margin - 6}) rotate(-50)`},
        shorten(placeName(place)),
      ),
    ),
  );
  rows.forEach((place, y) => {
    svg.append(
      draw("text", {x: margin - 8, y: margin + cell * (y + 0.7), "text-anchor": "end"}, shorten(placeName(place))),
      draw("line", {
        x1: margin,
        x2: margin + cell * columns.length,
        y1: margin + cell * (y + 1),
        y2: margin + cell * (y + 1),
        stroke: "var(--line)",
        "stroke-width": 0.5,
      }),
    );
  });
  columns.forEach((_, x) =>
    svg.append(
      draw("line", {
        x1: margin + cell * (x + 1),
        x2: margin + cell * (x + 1),
        y1: margin,
        y2: height - 4,
        stroke: "var(--line)",
        "stroke-width": 0.5,
      }),
    ),
  );
  const maxCount = Math.max(...shown.map((pair) => pair.queries.length));
  for (const pair of all) {
    const x = columns.indexOf(pair.answer),
      y = rows.indexOf(pair.truth),
      count = pair.queries.length;
    if (x < 0 || y < 0) continue;
    const colour = pair.truth === pair.answer ? "--correct" : pair.answer === null ? "--none" : "--wrong";
    const selectCell = () => {
      updateSelection({truth: pair.truth, answer: pair.answer, outcome: null});
      location.hash = "#queries";
    };
    svg.append(
      draw(
        "rect",
        {
          class: "cell",
          x: margin + cell * x + 1,
          y: margin + cell * y + 1,
          width: cell - 2,
          height: cell - 2,
          rx: 2,
          fill: `var(${colour})`,
          opacity: 0.45 + 0.55 * Math.min(1, count / maxCount),
          tabindex: 0,
          role: "button",
          "aria-label": `${placeName(pair.truth)}, answered ${placeName(pair.answer)}: ${count}`,
          onclick: selectCell,
          onkeydown: (event) => {
            if (event.key === "Enter") selectCell();
          },
        },
        draw("title", {}, `${placeName(pair.truth)}, answered ${placeName(pair.answer)}: ${count}`),
      ),
    );
    if (cell > 14)
      svg.append(draw("text", {class: "count", x: margin + cell * (x + 0.5), y: margin + cell * (y + 0.5) + 4}, count));
  }
  return svg;
}

function showFloors() {
  if (!sets.some((set) => set.floors.length)) return;
  const place = make("div", {class: "figure"}),
    floors = make("span", {});
  const keys = content.outcomes.map((name, i) =>
    make(
      "span",
      {class: "key"},
      make("span", {class: "swatch", style: `background: var(--${OUTCOME_CLASSES[i]}); margin: 0`}),
      name,
    ),
  );
  section(
    "floor",
    "Floor plan",
    make(
      "p",
      {class: "note"},
      "Each arrow points from the true position of a query to its estimated position. If the two are very close to each " +
        "other, only the arrowhead is visible. A dot without an arrow is a query without an estimated pose. Hover over a dot to show the query and its place. Click it to open the query.",
    ),
    make("div", {class: "tools"}, selectionMenus(), floors, make("span", {}, keys)),
    place,
  );
  const paint = () => {
    const set = currentSet();
    floors.replaceChildren(
      makeMenu(
        "floor",
        set.floors.map((_, i) => String(i + 1)),
        (floor) => updateSelection({floor}),
        selection.floor,
      ),
    );
    place.hidden = !set.floors.length;
    if (set.floors.length) drawFloor(place, set, set.floors[selection.floor]);
  };
  paintWhenVisible(place, () => {
    if (!selectionListeners.includes(paint)) {
      selectionListeners.push(paint);
      addEventListener("resize", paint);
    }
    paint();
  });
}

function drawFloor(place, set, floor) {
  const [left, top, width, height] = floor.box;
  const axis = {showgrid: false, zeroline: false};
  const layout = plotLayout({
    images: [
      {
        source: floor.picture,
        xref: "x",
        yref: "y",
        x: left,
        y: top,
        sizex: width,
        sizey: height,
        sizing: "stretch",
        layer: "below",
        opacity: document.documentElement.classList.contains("dark") ? 0.35 : 1,
      },
    ],
    xaxis: {...axis, title: {text: "x (m)"}, range: [left, left + width], constrain: "domain"},
    yaxis: {...axis, title: {text: "y (m)"}, range: [top - height, top], scaleanchor: "x"},
    height: Math.min(860, Math.max(300, (place.clientWidth * height) / width + 80)),
  });
  const {l, r, t, b} = layout.margin;
  const pixelsPerMetre = Math.min((place.clientWidth - l - r) / width, (layout.height - t - b) / height);
  layout.annotations = roomNames(floor, pixelsPerMetre);
  Plotly.react(place, floorTraces(set, floor), layout, PLOT_CONFIG);
  if (place.removeAllListeners) place.removeAllListeners("plotly_click");
  place.on("plotly_click", (event) => openQuery(event.points[0].customdata));
}

// Return the traces of a floor plan for Plotly. For each outcome, one trace has the arrows from true to estimated
// positions, and one has a dot at each true position. The dots are a trace of their own, because Plotly hides the first
// marker of a line with `angleref: "previous"`.
function floorTraces(set, floor) {
  const answers = answersOf(selection.arm),
    places = new Set(floor.places),
    size = innerWidth < 600 ? 6 : 9;
  const hoverText = (i) =>
    [set.ids[i], placeName(set.truth[i]), `answer: ${placeName(answers.place[i])}`].map(escapeText).join("<br>");
  const trace = (points, style) => ({
    x: points.map(([, position]) => position[0]),
    y: points.map(([, position]) => position[1]),
    text: points.map(([i]) => hoverText(i)),
    customdata: points.map(([i]) => i),
    hoverinfo: "text",
    ...style,
  });
  return content.outcomes.flatMap((name, outcome) => {
    const color = cssVariable(`--${OUTCOME_CLASSES[outcome]}`);
    const queries = [...set.ids.keys()].filter(
      (i) => answers.outcome[i] === outcome && set.poses[i] && places.has(placeName(set.truth[i])),
    );
    const dots = queries.map((i) => [i, set.poses[i]]);
    const arrows = queries
      .filter((i) => answers.pose[i] && outcome < 2)
      .flatMap((i) => [set.poses[i], answers.pose[i], [null, null]].map((position) => [i, position]));
    return [
      trace(arrows, {
        name,
        mode: "lines+markers",
        line: {color, width: 2},
        marker: {color, symbol: "arrow", size: 1.6 * size, angleref: "previous"},
      }),
      trace(dots, {name, mode: "markers", marker: {color, size}}),
    ];
  });
}

// Return the names of the rooms of a floor as annotations for Plotly. A name that would overlap another one is omitted.
function roomNames(floor, pixelsPerMetre) {
  const [left, , width] = floor.box,
    size = 11,
    color = cssVariable("--quiet"),
    reserved = [];
  return floor.labels.flatMap(([name, middle, y]) => {
    const dx = (0.3 * size * name.length) / pixelsPerMetre,
      dy = (0.6 * size) / pixelsPerMetre;
    const x = Math.max(left + dx, Math.min(left + width - dx, middle));
    if (!reserve([x - dx, y - dy, x + dx, y + dy], reserved)) return [];
    return [{text: escapeText(name), x, y, showarrow: false, font: {size, color}}];
  });
}
