// What every part of the page needs: its content, elements that hold text as text, the theme, colours of arms.

const content = JSON.parse(document.getElementById("content").textContent);
const SVG = "http://www.w3.org/2000/svg";
const DASHES = ["solid", "dash", "dot"],
  STROKES = ["", "7 4", "2 3"],
  COLOURS = 8;
const OUTCOME_CLASSES = ["right", "wrong", "denied", "none"];

// An element with attributes and children; strings become text, never markup. `on...` are listeners.
function make(name, attributes = {}, ...children) {
  return fill(document.createElement(name), attributes, children);
}

function draw(name, attributes = {}, ...children) {
  return fill(document.createElementNS(SVG, name), attributes, children);
}

function fill(element, attributes, children) {
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (value !== null && value !== undefined && value !== false)
      element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined));
  return element;
}

// Text as Plotly takes it, which reads a few tags.
const plain = (text) => text.replace(/[&<>]/g, (mark) => ({"&": "&amp;", "<": "&lt;", ">": "&gt;"})[mark]);

// An island by its id, null where the page has none.
function island(id) {
  const found = document.getElementById(id);
  return found && found.textContent;
}

function section(id, title, ...children) {
  const made = make("section", {id}, make("h2", {}, title), ...children);
  document.getElementById("main").append(made);
  document.getElementById("contents").append(make("a", {href: `#${id}`}, title));
  return made;
}

// A menu of names; `change` is called with the position of the one that is chosen.
function choose(label, names, change, chosen = 0) {
  const select = make(
    "select",
    {onchange: () => change(select.selectedIndex)},
    names.map((name) => make("option", {}, name)),
  );
  select.selectedIndex = chosen;
  return make("label", {hidden: names.length < 2}, label, select);
}

const variable = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const colourOf = (arm) => variable(`--c${arm % COLOURS}`);
const styleOf = (arm) => Math.floor(arm / COLOURS) % DASHES.length;

// The line that an arm is drawn with.
function sample(arm) {
  return draw(
    "svg",
    {width: 26, height: 10, "aria-hidden": true},
    draw("line", {
      x1: 1,
      x2: 25,
      y1: 5,
      y2: 5,
      stroke: `var(--c${arm % COLOURS})`,
      "stroke-width": 3,
      "stroke-dasharray": STROKES[styleOf(arm)],
    }),
  );
}

// What is drawn anew when the theme changes.
const themed = [];
const dark = matchMedia("(prefers-color-scheme: dark)");
function setTheme(isDark) {
  document.documentElement.classList.toggle("dark", isDark);
  document.documentElement.style.colorScheme = isDark ? "dark" : "light";
  for (const again of themed) again();
}
setTheme(dark.matches);
dark.addEventListener("change", () => setTheme(dark.matches));
document
  .getElementById("theme")
  .addEventListener("click", () => setTheme(!document.documentElement.classList.contains("dark")));

// Draw an element once it is near the screen, before the page is printed, or when the browser is idle.
const pending = new Set();
function drawPending() {
  for (const paint of [...pending]) paint();
}
addEventListener("beforeprint", drawPending);
function drawWhenIdle() {
  const [next] = pending;
  if (!next) return;
  next();
  setTimeout(drawWhenIdle, 50);
}
addEventListener("load", () => setTimeout(drawWhenIdle, 300));

function whenSeen(element, paint) {
  const first = () => {
    watch.disconnect();
    pending.delete(first);
    paint();
    themed.push(paint);
  };
  pending.add(first);
  const watch = new IntersectionObserver(
    (seen) => {
      if (seen.some((one) => one.isIntersecting)) first();
    },
    {rootMargin: "400px"},
  );
  watch.observe(element);
}

const PLOT = {
  responsive: true,
  displaylogo: false,
  displayModeBar: innerWidth < 600 ? false : "hover",
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
};
function axisStyle() {
  const line = variable("--line");
  return {gridcolor: line, linecolor: line, zerolinecolor: line, tickcolor: line};
}
function layoutOf(layout) {
  const own = {...layout};
  for (const axis of ["xaxis", "yaxis"]) own[axis] = {...axisStyle(), ...layout[axis]};
  return {
    modebar: {bgcolor: "rgba(0,0,0,0)", color: variable("--quiet"), activecolor: variable("--accent")},
    margin: {l: 58, r: 16, t: 26, b: 46},
    height: 320,
    showlegend: false,
    hovermode: "closest",
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: {family: "system-ui, Segoe UI, Helvetica, Arial, sans-serif", size: 12, color: variable("--ink")},
    hoverlabel: {bgcolor: variable("--paper"), bordercolor: variable("--line"), font: {color: variable("--ink")}},
    ...own,
  };
}
