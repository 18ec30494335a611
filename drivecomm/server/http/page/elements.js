// Elements of the page: made once, changed only where their content differs.

/** Return an element. attributes: those that are false or undefined are left out; functions are event listeners. */
export function el(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== undefined && value !== null) made.setAttribute(name, value);
  }
  made.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return made;
}

/** Show a text, touching the page only if it is another one. */
export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Set or, by null, remove an attribute, touching the page only if it is another one. */
export function mark(element, name, value) {
  if (value === null || value === undefined || value === false) {
    if (element.hasAttribute(name)) element.removeAttribute(name);
  } else if (element.getAttribute(name) !== String(value)) element.setAttribute(name, value);
}

export function hide(element, hidden) {
  if (element.hidden !== hidden) element.hidden = hidden;
}

const SHAPES = {
  running: "M6 3.5 20.5 12 6 20.5Z",
  reverse: "M18 3.5 3.5 12 18 20.5Z",
  ready: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18Zm0 3a6 6 0 1 1 0 12 6 6 0 0 1 0-12Z",
  not_ready: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18Zm0 3a6 6 0 1 1 0 12 6 6 0 0 1 0-12ZM7.5 10.7h9v2.6h-9Z",
  stopping: "M4 5h16v3H4Zm2 5h12L12 20Z",
  fault: "M12 1 23 12 12 23 1 12Zm-1.6 5.2.5 7.3h2.2l.5-7.3Zm.1 9.2v2.6h3v-2.6Z",
  silent: "M3.2 5.3 5.3 3.2 12 9.9l6.7-6.7 2.1 2.1L14.1 12l6.7 6.7-2.1 2.1L12 14.1l-6.7 6.7-2.1-2.1L9.9 12Z",
  asking: "M3 10.5h3.6v3.6H3Zm7.2 0h3.6v3.6h-3.6Zm7.2 0H21v3.6h-3.6Z",
  open: "M4 4h7v3H7v10h4v3H4Zm9 0h7v16h-7v-3h4V7h-4Z",
  closed: "M5 4h14v16H5Zm3 3v10h8V7Z",
};

const SVG = "http://www.w3.org/2000/svg";

/** Return a small drawing of a state, which repeats what a word beside it says. */
export function shape(name) {
  const drawing = document.createElementNS(SVG, "svg");
  drawing.setAttribute("viewBox", "0 0 24 24");
  drawing.setAttribute("class", "shape");
  drawing.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("fill-rule", "evenodd");
  drawing.append(path);
  reshape(drawing, name);
  return drawing;
}

export function reshape(drawing, name) {
  mark(drawing, "data-shape", name);
  mark(drawing.firstChild, "d", SHAPES[name] ?? SHAPES.asking);
}
