// Which data set and arm is looked at, the confusion between places, and the floor plan.

const sets = content.sets;
const looked = {set: 0, arm: null, outcome: null, truth: null, answer: null, text: "", floor: 0};
const watchers = [];
const asked = () => sets[looked.set];
const armsOf = (set) => Object.keys(set.answers).map(Number);
const answersOf = (arm) => asked().answers[arm];

// Look at something else: every part that depends on it is drawn anew.
function look(change) {
  Object.assign(looked, change);
  if (sets.length && !armsOf(asked()).includes(looked.arm)) looked.arm = armsOf(asked())[0] ?? null;
  for (const paint of watchers) paint();
}

// Menus of the data set and the arm, which follow what is looked at.
function choosers() {
  const place = make("span", {class: "tools", style: "margin: 0"});
  watchers.push(() => {
    const arms = armsOf(asked());
    place.replaceChildren(
      choose(
        "data",
        sets.map((set) => set.name),
        (set) => look({set, truth: null, answer: null, floor: 0}),
        looked.set,
      ),
      choose(
        "method",
        arms.map((arm) => content.arms[arm].name),
        (i) => look({arm: arms[i]}),
        arms.indexOf(looked.arm),
      ),
    );
  });
  return place;
}

const outcomeOf = (i, arm = looked.arm) => answersOf(arm).outcome[i];

function showConfusion() {
  if (!sets.some((set) => armsOf(set).length)) return;
  const place = make("div", {class: "scroll matrix", tabindex: 0});
  const only = make("input", {type: "checkbox", onchange: () => paint()});
  only.checked = sets[0].places.length > 16;
  const note = make("p", {class: "note"});
  section(
    "rooms",
    "Rooms",
    make(
      "p",
      {class: "note"},
      "Rows: where the queries were taken. Columns: the place that was answered. Click a cell to list its queries.",
    ),
    make("div", {class: "tools"}, choosers(), make("label", {}, only, "only places that were mistaken")),
    place,
    note,
  );
  const paint = () => {
    const counts = countPairs();
    place.replaceChildren(matrix(counts, only.checked));
    const wrong = [...counts.values()].filter((pair) => pair.truth !== pair.answer && pair.answer !== null);
    wrong.sort((a, b) => b.queries.length - a.queries.length);
    const named = wrong
      .slice(0, 5)
      .map((pair) => `${placeName(pair.truth)} taken for ${placeName(pair.answer)} (${pair.queries.length})`);
    note.textContent = named.length ? `Most often: ${named.join(", ")}.` : "No place was taken for another.";
  };
  watchers.push(paint);
}

const placeName = (place) => (place === null ? "no place" : asked().places[place]);

// The queries of each pair of a place and an answer; null: no place was named.
function countPairs() {
  const pairs = new Map(),
    answers = answersOf(looked.arm);
  asked().truth.forEach((truth, i) => {
    const named = answers.outcome[i] < 2 ? answers.place[i] : null;
    const key = `${truth} ${named}`;
    if (!pairs.has(key)) pairs.set(key, {truth, answer: named, queries: []});
    pairs.get(key).queries.push(i);
  });
  return pairs;
}

function matrix(pairs, onlyMistaken) {
  const all = [...pairs.values()],
    off = all.filter((pair) => pair.truth !== pair.answer);
  const shown = onlyMistaken ? off : all;
  const rows = [...new Set(shown.map((pair) => pair.truth))].sort((a, b) => a - b);
  const columns = [...new Set(shown.flatMap((pair) => [pair.answer, ...(onlyMistaken ? [] : [pair.truth])]))].sort(
    (a, b) => (a === null) - (b === null) || a - b,
  );
  if (!rows.length) return make("p", {class: "note"}, "Every query's place was answered.");
  const cell = rows.length > 60 ? 12 : 18,
    long = Math.max(...[...rows, ...columns].map((place) => placeName(place).length));
  const margin = Math.min(190, 12 + 6.2 * long),
    width = margin + cell * columns.length + 60,
    height = margin + cell * rows.length + 4;
  const cut = (text) => (text.length > 28 ? `${text.slice(0, 27)}…` : text);
  const svg = draw("svg", {
    width,
    height,
    viewBox: `0 0 ${width} ${height}`,
    role: "img",
    "aria-label": "Places by answers",
  });
  columns.forEach((place, x) =>
    svg.append(
      draw(
        "text",
        {transform: `translate(${margin + cell * (x + 0.7)} ${margin - 6}) rotate(-50)`},
        cut(placeName(place)),
      ),
    ),
  );
  rows.forEach((place, y) => {
    svg.append(
      draw("text", {x: margin - 8, y: margin + cell * (y + 0.7), "text-anchor": "end"}, cut(placeName(place))),
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
  const most = Math.max(...shown.map((pair) => pair.queries.length));
  for (const pair of all) {
    const x = columns.indexOf(pair.answer),
      y = rows.indexOf(pair.truth),
      count = pair.queries.length;
    if (x < 0 || y < 0) continue;
    const colour = pair.truth === pair.answer ? "--right" : pair.answer === null ? "--none" : "--wrong";
    const choose = () => {
      look({truth: pair.truth, answer: pair.answer, outcome: null});
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
          opacity: 0.45 + 0.55 * Math.min(1, count / most),
          tabindex: 0,
          role: "button",
          "aria-label": `${placeName(pair.truth)}, answered ${placeName(pair.answer)}: ${count}`,
          onclick: choose,
          onkeydown: (event) => {
            if (event.key === "Enter") choose();
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
  const place = make("div", {}),
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
      "An arrow from where a query was taken to where the method put it; a dot alone has no estimate. Click one to look at it.",
    ),
    make("div", {class: "tools"}, choosers(), floors, make("span", {}, keys)),
    place,
  );
  const paint = () => {
    const set = asked();
    floors.replaceChildren(
      choose(
        "floor",
        set.floors.map((_, i) => String(i + 1)),
        (floor) => look({floor}),
        looked.floor,
      ),
    );
    place.hidden = !set.floors.length;
    if (set.floors.length) drawFloor(place, set, set.floors[looked.floor]);
  };
  whenSeen(place, () => {
    if (!watchers.includes(paint)) watchers.push(paint);
    paint();
  });
}

function drawFloor(place, set, floor) {
  const here = new Set(floor.places),
    answers = answersOf(looked.arm);
  const [left, top, width, height] = floor.box;
  const data = content.outcomes.map((name, outcome) => {
    const x = [],
      y = [],
      text = [],
      ids = [],
      symbol = [],
      size = [];
    set.truth.forEach((truth, i) => {
      const from = set.poses[i],
        to = answers.pose[i];
      if (answers.outcome[i] !== outcome || !from || !here.has(set.places[truth])) return;
      const told = [set.ids[i], set.places[truth], `answer: ${placeName(answers.place[i])}`].map(plain).join("<br>");
      const ends = to && outcome < 2 ? [from, to] : [from];
      ends.forEach((end, k) => {
        x.push(end[0]);
        y.push(end[1]);
        text.push(told);
        ids.push(i);
        symbol.push(k ? "arrow" : "circle");
        size.push(k ? 15 : 9);
      });
      for (const column of [x, y, text, ids, symbol, size]) column.push(null);
    });
    const color = variable(`--${OUTCOME_CLASSES[outcome]}`);
    return {
      x,
      y,
      text,
      customdata: ids,
      name,
      mode: "lines+markers",
      hoverinfo: "text",
      line: {color, width: 2},
      marker: {color, symbol, size, angleref: "previous"},
    };
  });
  const ink = variable("--quiet");
  const names = floor.labels.map(([name, x, y]) => ({
    text: plain(name),
    x,
    y,
    showarrow: false,
    font: {size: 11, color: ink},
  }));
  const axis = {showgrid: false, zeroline: false};
  const layout = layoutOf({
    annotations: names,
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
  Plotly.react(place, data, layout, PLOT);
  if (place.removeAllListeners) place.removeAllListeners("plotly_click");
  place.on("plotly_click", (event) => {
    const i = event.points[0].customdata;
    if (i !== null) openQuery(i);
  });
}
