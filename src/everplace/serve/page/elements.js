// Small helpers: elements, SVG, and how numbers and names are written.

export const byId = (id) => document.getElementById(id);

/** Shows or hides an element, by itself or by its id. */
export function show(element, visible) {
  (typeof element === "string" ? byId(element) : element).hidden = !visible;
}

/** Writes a text, and hides the element where there is none. */
export function say(id, text) {
  const element = byId(id);
  if (element.textContent !== text) element.textContent = text;
  element.hidden = !text;
}

function filled(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** An HTML element. */
export const html = (tag, attributes = {}, ...children) => filled(document.createElement(tag), attributes, children);

/** An SVG element. */
export const svg = (tag, attributes = {}, ...children) =>
  filled(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);

/** A share as per cent; what is not quite all or nothing is not rounded to it. */
export function percent(share, digits = 0) {
  const edge = 0.5 / 10 ** (digits + 2);
  if (share > 0 && share < edge) return `<\u00a0${(2 * edge * 100).toFixed(digits)}\u00a0%`;
  if (share < 1 && share > 1 - edge) return `>\u00a0${(100 - 2 * edge * 100).toFixed(digits)}\u00a0%`;
  return `${(100 * share).toFixed(digits)}\u00a0%`;
}

/** A number with so many decimals, and with a minus rather than a hyphen. */
export const signed = (value, decimals) => value.toFixed(decimals).replace("-", "\u2212");

/** A number with its thousands apart. */
export const count = (number) => number.toLocaleString("en-GB").replaceAll(",", "\u202f");

/** "1 frame", "3 frames". */
export const counted = (number, thing) => `${count(number)} ${thing}${number === 1 ? "" : "s"}`;

/** "a, b and c" */
export function listed(names) {
  return names.length < 2 ? names.join("") : `${names.slice(0, -1).join(", ")} and ${names.at(-1)}`;
}

/** What the service says, as a sentence of its own. */
export const asSentence = (text) => text[0].toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? "" : ".");

/** "9" before "10". */
export const naturally = new Intl.Collator("en", { numeric: true }).compare;

/** A file's name without its ending. */
export const stemOf = (name) => name.replace(/\.[^.]*$/, "") || name;
