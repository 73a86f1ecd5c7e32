// The request, the tables, and the figures with a menu of the arms (methods with their settings) that they show.

const MAX_METHODS = 6; // a longer list of methods is folded

function listOfPairs(pairs) {
  return make(
    "dl",
    {},
    pairs.map(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]),
  );
}

function showRequest() {
  const element = section("request", "Request");
  for (const run of content.runs) {
    const methods = listOfPairs(run.methods);
    const parts = [
      listOfPairs([["data", run.data]]),
      run.methods.length > MAX_METHODS
        ? make("details", {}, make("summary", {}, `${run.methods.length} methods`), methods)
        : methods,
      listOfPairs(run.more),
      make("details", {}, make("summary", {}, "versions and machine"), listOfPairs(run.versions)),
    ];
    const title = run.folder;
    element.append(
      content.runs.length > 1
        ? make("details", {open: content.runs.length < 4}, make("summary", {}, title), parts)
        : make("div", {}, make("p", {class: "note"}, title), parts),
    );
  }
  if (content.notes.length)
    element.append(
      make(
        "div",
        {class: "notice"},
        content.notes.map((note) => make("p", {}, note)),
      ),
    );
}

function showTables() {
  const element = section("results", "Results");
  for (const table of content.tables.usual)
    element.append(table.title ? make("h3", {}, table.title) : "", tableOf(table));
  element.append(
    ...content.tables.about.map((note) => make("p", {class: "note"}, note)),
    make("details", {}, make("summary", {}, "all columns"), content.tables.all.map(tableOf)),
  );
  for (const paper of content.reported) showReported(element, paper);
}

// Create a table of measured rows, with the best values of each column in bold.
function tableOf(table) {
  const best = new Set(table.best.map(String));
  const head = table.headings.map((text, j) =>
    make("th", {class: j < table.leading || text === "input" ? "text" : null, scope: "col"}, text),
  );
  const rows = table.rows.map((row, i) =>
    make(
      "tr",
      {},
      row.map((text, j) =>
        make(
          "td",
          {
            class:
              [
                j < table.leading || table.headings[j] === "input" ? "text" : "",
                best.has(`${i},${j}`) ? "lead" : "",
                table.headings[j] === "input" ? "input" : "",
              ]
                .join(" ")
                .trim() || null,
          },
          text,
        ),
      ),
    ),
  );
  return make(
    "div",
    {class: "scroll", tabindex: 0},
    make("table", {}, make("thead", {}, make("tr", {}, head)), make("tbody", {}, rows)),
  );
}

// Show the tables of a paper, whose values were not measured here.
function showReported(element, paper) {
  element.append(
    make("h3", {}, "Reported, not measured"),
    make("p", {class: "note"}, `${paper.source}. ${paper.note}`),
  );
  const tables = paper.tables.map((table) =>
    make(
      "div",
      {class: "scroll"},
      make(
        "table",
        {},
        make(
          "thead",
          {},
          make(
            "tr",
            {},
            make("th", {class: "text"}, table.title),
            table.figures.map((name) => make("th", {}, name)),
          ),
        ),
        make(
          "tbody",
          {},
          Object.entries(table.rows).map(([name, values]) =>
            make(
              "tr",
              {},
              make("td", {class: "text"}, name),
              values.map((value) => make("td", {}, String(value))),
            ),
          ),
        ),
      ),
    ),
  );
  element.append(make("div", {class: "figures"}, tables));
}

function showFigures() {
  if (!content.figures.length) return;
  const selected = new Set(content.selected),
    painters = [];
  const legend = make("div", {class: "legend"});
  const measured = [
    ...new Set(
      content.figures.flatMap((figure) => figure.data.map((trace) => trace.arm)).filter((arm) => arm !== undefined),
    ),
  ].sort((a, b) => a - b);
  const boxes = measured.map((arm) => {
    const box = make("input", {
      type: "checkbox",
      onchange: () => {
        box.checked ? selected.add(arm) : selected.delete(arm);
        update();
      },
    });
    box.checked = selected.has(arm);
    return [arm, box];
  });
  const setAll = (isOn) => () => {
    for (const [arm, box] of boxes) {
      box.checked = isOn;
      isOn ? selected.add(arm) : selected.delete(arm);
    }
    update();
  };
  const menu = make(
    "details",
    {class: "menu"},
    make("summary", {}, "Methods"),
    make(
      "div",
      {},
      make("button", {type: "button", onclick: setAll(true)}, "all"),
      " ",
      make("button", {type: "button", onclick: setAll(false)}, "none"),
      boxes.map(([arm, box]) => make("label", {}, box, lineSample(arm), content.arms[arm].name)),
    ),
  );
  document.addEventListener("click", (event) => {
    if (!menu.contains(event.target)) menu.open = false;
  });
  menu.addEventListener("keydown", (event) => {
    if (event.key === "Escape") {
      menu.open = false;
      menu.firstChild.focus();
    }
  });
  function update() {
    legend.replaceChildren(
      ...measured
        .filter((arm) => selected.has(arm))
        .map((arm) => make("span", {}, lineSample(arm), content.arms[arm].name)),
    );
    for (const paint of painters) paint();
  }
  const element = section(
    "figures",
    "Figures",
    make("div", {class: "tools"}, measured.length > 1 ? menu : null, legend),
  );
  const grid = make("div", {class: "figures"});
  element.append(grid);
  for (const figure of content.figures) {
    const place = make("div", {});
    const paint = () =>
      Plotly.react(
        place,
        tracesOf(figure, selected),
        plotLayout({...figure.layout, ...chartSize(figure, selected)}),
        PLOT_CONFIG,
      );
    const block = make("div", {class: "figure"}, make("h3", {}, figure.title), place);
    grid.append(block);
    paintWhenVisible(block, () => {
      if (!painters.includes(paint)) painters.push(paint);
      paint();
    });
  }
  update();
}

// Return the height of a bar chart, which depends on the number of bars.
function chartSize(figure, selected) {
  const bars = figure.data.filter((trace) => trace.type === "bar" && selected.has(trace.arm)).length;
  return bars ? {height: Math.max(180, 70 + 26 * bars)} : {};
}

// Return the traces of a figure for Plotly, in the colours of their arms.
function tracesOf(figure, selected) {
  return figure.data
    .filter((trace) => trace.arm === undefined || selected.has(trace.arm))
    .map((trace) => {
      if (trace.arm === undefined) return trace;
      const color = colourOf(trace.arm),
        name = escapeText(content.arms[trace.arm].name);
      const line = {width: 2, dash: DASHES[styleOf(trace.arm)], ...trace.line, color};
      const error = (key) =>
        trace[key] && {[key]: {...trace[key], color: cssVariable(trace.type === "bar" ? "--ink" : "--quiet")}};
      const texts =
        trace.type === "bar"
          ? {y: [name]}
          : trace.mode.includes("text") || (trace.text && trace.text.length === 1)
            ? {text: [name]}
            : {};
      return {
        name,
        ...trace,
        ...texts,
        line: trace.type === "bar" ? undefined : line,
        marker: {...trace.marker, color},
        fillcolor: trace.fill ? withOpacity(color, 0.12) : undefined,
        ...error("error_x"),
        ...error("error_y"),
      };
    });
}

// Return a colour "#rrggbb" with an opacity from 0 to 1.
function withOpacity(color, opacity) {
  const [r, g, b] = [1, 3, 5].map((at) => parseInt(color.slice(at, at + 2), 16));
  return `rgba(${r},${g},${b},${opacity})`;
}
