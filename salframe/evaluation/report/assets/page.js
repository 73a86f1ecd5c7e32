// Functions that all parts of the page use: content, elements, the theme, and the colours of arms (methods with their
// settings).

const content = JSON.parse(document.getElementById("content").textContent);
const SVG = "http://www.w3.org/2000/svg";
const DASHES = ["solid", "dash", "dot"],
  STROKES = ["", "7 4", "2 3"],
  COLOURS = 8;
const OUTCOME_CLASSES = ["correct", "wrong", "rejected", "none"];

// Create an HTML element. Strings among the children become text, never markup. Attributes `on...` are event listeners.
function make(name, attributes = {}, ...children) {
  return fill(document.createElement(name), attributes, children);
}

// Create an SVG element, as `make` creates an HTML element.
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

// Escape a text for Plotly, which interprets some HTML tags.
const escapeText = (text) => text.replace(/[&<>]/g, (mark) => ({"&": "&amp;", "<": "&lt;", ">": "&gt;"})[mark]);

// Return the text of an island (content that is read on demand), or null if the page has no island with this id.
function island(id) {
  const element = document.getElementById(id);
  return element && element.textContent;
}

// Append a section to the page and to its table of contents.
function section(id, title, ...children) {
  const element = make("section", {id}, make("h2", {}, title), ...children);
  document.getElementById("main").append(element);
  document.getElementById("contents").append(make("a", {href: `#${id}`}, title));
  return element;
}

// Create a drop-down menu, hidden if it has only one name. `onSelect` is called with the index of the selected name.
function makeMenu(label, names, onSelect, selected = 0) {
  const select = make(
    "select",
    {onchange: () => onSelect(select.selectedIndex)},
    names.map((name) => make("option", {}, name)),
  );
  select.selectedIndex = selected;
  return make("label", {hidden: names.length < 2}, label, select);
}

// Reserve a box [left, top, right, bottom] for a text. Return false if it overlaps a box that is already reserved.
function reserve(box, reserved) {
  const overlaps = (other) => box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3];
  if (reserved.some(overlaps)) return false;
  reserved.push(box);
  return true;
}

const cssVariable = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const colourOf = (arm) => cssVariable(`--c${arm % COLOURS}`);
const styleOf = (arm) => Math.floor(arm / COLOURS) % DASHES.length;

// Draw a sample of the line of an arm, for legends.
function lineSample(arm) {
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

// Functions to call when the theme changes.
const themeListeners = [];
const dark = matchMedia("(prefers-color-scheme: dark)");
function setTheme(isDark) {
  document.documentElement.classList.toggle("dark", isDark);
  document.documentElement.style.colorScheme = isDark ? "dark" : "light";
  for (const paint of themeListeners) paint();
}
setTheme(dark.matches);
dark.addEventListener("change", () => setTheme(dark.matches));
document
  .getElementById("theme")
  .addEventListener("click", () => setTheme(!document.documentElement.classList.contains("dark")));

// Functions that draw elements which are not drawn yet.
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

// Draw an element when it comes near the screen, before the page is printed, or when the browser is idle.
function paintWhenVisible(element, paint) {
  const paintFirst = () => {
    observer.disconnect();
    pending.delete(paintFirst);
    paint();
    themeListeners.push(paint);
  };
  pending.add(paintFirst);
  const observer = new IntersectionObserver(
    (entries) => {
      if (entries.some((entry) => entry.isIntersecting)) paintFirst();
    },
    {rootMargin: "400px"},
  );
  observer.observe(element);
}

const PLOT_CONFIG = {
  responsive: true,
  displaylogo: false,
  displayModeBar: innerWidth < 600 ? false : "hover",
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
};
function axisStyle() {
  const line = cssVariable("--line");
  return {gridcolor: line, linecolor: line, zerolinecolor: line, tickcolor: line};
}
function plotLayout(layout) {
  const axes = {};
  for (const axis of ["xaxis", "yaxis"]) axes[axis] = {...axisStyle(), ...layout[axis]};
  return {
    modebar: {bgcolor: "rgba(0,0,0,0)", color: cssVariable("--quiet"), activecolor: cssVariable("--accent")},
    margin: {l: 58, r: 16, t: 26, b: 46},
    height: 320,
    showlegend: false,
    hovermode: "closest",
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: {family: "system-ui, Segoe UI, Helvetica, Arial, sans-serif", size: 12, color: cssVariable("--ink")},
    hoverlabel: {
      bgcolor: cssVariable("--paper"),
      bordercolor: cssVariable("--line"),
      font: {color: cssVariable("--ink")},
    },
    ...layout,
    ...axes,
  };
}
