// A chart as SVG that is as wide as its place, with labelled axes; colours come from the style sheet.

import { svg } from "./elements.js";

const RIGHT = 12, TOP = 10, BOTTOM = 42;
/** What the axis of x takes below a chart, and the air above it. */
export const AROUND = TOP + BOTTOM;
const PER_TICK = { x: 70, y: 36 }; // pixels

/** Round numbers between two, not more of them than `most`. */
export function ticks(min, max, most) {
  const span = max - min;
  if (!(span > 0)) return [min];
  const rough = span / Math.max(most, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((by) => by * power).find((one) => one >= rough * 0.999);
  const first = Math.ceil(min / step - 1e-9);
  return Array.from({ length: Math.floor(max / step + 1e-9) - first + 1 }, (_, index) => (first + index) * step);
}

const plain = (value) => String(Number(value.toPrecision(6))).replace("-", "\u2212");

/** One chart. It draws itself again when its width changes. */
export class Chart {
  /**
   * @param label What a reader who cannot see it is told; null: what lies over it tells them.
   * @param height In pixels, or a function of the width inside the axes.
   * @param left Room for the axis of y, in pixels.
   */
  constructor(host, { label = null, height, left = 58 }) {
    this.host = host;
    this.height = height;
    this.left = left;
    this.root = svg("svg", label === null ? { "aria-hidden": "true" } : { role: "img", "aria-label": label });
    host.replaceChildren(this.root);
    this._paint = null;
    new ResizeObserver(() => this._redraw()).observe(host);
  }

  /** Changes what a reader who cannot see it is told. */
  set label(text) {
    this.root.setAttribute("aria-label", text);
  }

  /**
   * Draws.
   *
   * @param axes {x, y}, or what gives them for a width inside the axes; each {min, max, label} and optionally `ticks`,
   *     which gives [{at, text}], at most so many.
   * @param paint Given {group, x, y, left, top, width, height}: where to draw, and from values to pixels.
   */
  draw(axes, paint) {
    this._axes = axes;
    this._paint = paint;
    this._redraw();
  }

  _redraw() {
    const outer = this.host.clientWidth;
    if (!this._paint || outer < 80) return;
    const width = outer - this.left - RIGHT;
    const { x, y } = typeof this._axes === "function" ? this._axes(width) : this._axes;
    const height = (typeof this.height === "function" ? this.height(width) : this.height) - AROUND;
    const toX = (value) => this.left + (width * (value - x.min)) / (x.max - x.min);
    const toY = (value) => TOP + height - (height * (value - y.min)) / (y.max - y.min);
    const total = height + AROUND;
    this.root.setAttribute("width", outer);
    this.root.setAttribute("height", total);
    this.root.setAttribute("viewBox", `0 0 ${outer} ${total}`);
    const group = svg("g");
    const both = [...this._xAxis(x, toX, width, height), ...this._yAxis(y, toY, width, height)];
    this.root.replaceChildren(svg("g", { class: "axis", "aria-hidden": "true" }, ...both), group);
    this._paint({ group, x: toX, y: toY, left: this.left, top: TOP, width, height });
  }

  _xAxis(axis, to, width, height) {
    const base = TOP + height;
    const drawn = marksOf(axis, width, "x").flatMap(({ at, text }) => [
      svg("path", { d: `M${to(at)} ${base}v4` }),
      svg("text", { x: to(at), y: base + 16, "text-anchor": "middle" }, text),
    ]);
    const title = { class: "title", x: this.left + width / 2, y: base + 35, "text-anchor": "middle" };
    return [...drawn, svg("path", { d: `M${this.left} ${base}h${width}` }), svg("text", title, axis.label)];
  }

  _yAxis(axis, to, width, height) {
    const drawn = marksOf(axis, height, "y").flatMap(({ at, text }) => [
      svg("path", { d: `M${this.left} ${to(at)}h-4` }),
      svg("path", { class: "grid", d: `M${this.left} ${to(at)}h${width}` }),
      svg("text", { x: this.left - 7, y: to(at) + 4, "text-anchor": "end" }, text),
    ]);
    const turned = `translate(12 ${TOP + height / 2}) rotate(-90)`;
    const title = svg("text", { class: "title", "text-anchor": "middle", transform: turned }, axis.label);
    return [...drawn, svg("path", { d: `M${this.left} ${TOP}v${height}` }), title];
  }
}

/** What is written along an axis of so many pixels. */
function marksOf(axis, length, kind) {
  const most = Math.max(1, Math.floor(length / PER_TICK[kind]));
  return axis.ticks?.(most) ?? ticks(axis.min, axis.max, most).map((at) => ({ at, text: plain(at) }));
}

/** The axis of a map's columns, with the numbers of their places. */
export function placeAxis(map) {
  const marks = (most) => ticks(0, Math.max(map.bins - 1, 1), most)
    .filter((bin) => Number.isInteger(bin) && bin < map.bins)
    .map((bin) => ({ at: bin + 0.5, text: String(map.placeNumber(bin * map.perBin)) }));
  return { min: 0, max: map.bins, label: "place, in the order of travel", ticks: marks };
}

/** The axis of a drive's frames. */
export function frameAxis(frames) {
  const marks = (most) => ticks(0, frames, most).filter((frame) => Number.isInteger(frame) && frame < frames)
    .map((frame) => ({ at: frame + 0.5, text: String(frame) }));
  return { min: 0, max: frames, label: "frame, counted from 0", ticks: marks };
}

/** The path of a mark around a point: "right" a disc, "wrong" a cross, "accepted" a disc, "left" a ring. */
export function mark(kind, x, y, radius) {
  if (kind === "wrong") {
    const r = radius * 0.95;
    return `M${x - r} ${y - r}l${2 * r} ${2 * r}M${x - r} ${y + r}l${2 * r} ${-2 * r}`;
  }
  return `M${x - radius} ${y}a${radius} ${radius} 0 1 0 ${2 * radius} 0a${radius} ${radius} 0 1 0 ${-2 * radius} 0`;
}
