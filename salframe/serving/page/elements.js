// Creates elements. Text is always set as text, so that names of places and labels cannot become markup.

const SVG = "http://www.w3.org/2000/svg";
const NUM_COLOURS = 10;

export const byId = (id) => document.getElementById(id);

export function html(name, attributes = {}, ...children) {
  return fill(document.createElement(name), attributes, children);
}

export function svg(name, attributes = {}, ...children) {
  return fill(document.createElementNS(SVG, name), attributes, children);
}

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

// The classes of the colours of labels: equal labels have equal colours.
export function coloursOf(labels) {
  return new Map([...new Set(labels)].map((label, i) => [label, `c${i % NUM_COLOURS}`]));
}

export const percent = (share) => `${(100 * share).toFixed(share > 0 && share < 0.1 ? 1 : 0)} %`;
