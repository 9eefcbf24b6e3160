// The played drive against the map: a picture with a row for each frame and a column for each place.

import { setPicture } from "./answer_view.js";
import { Chart, frameAxis, mark, placeAxis } from "./chart.js";
import { byId, html, percent, show, signed, svg } from "./elements.js";
import { gridCursor } from "./grid_cursor.js";
import { pictureOf } from "./service.js";

const MOST_ROWS = 1024; // of pixels; a longer drive shows the largest value of the frames in a row
const STEP = 0.1; // the ends of the scale of cosines are multiples
const VIRIDIS = [
  "440154", "482475", "414487", "355f8d", "2a788e", "21918c", "22a884", "44bf70", "7ad151", "bddf26", "fde725",
];

const channels = (hex) => [0, 2, 4].map((from) => parseInt(hex.slice(from, from + 2), 16));

/** 256 colours as red, green, blue, from dark to light (matplotlib's viridis). */
const COLOURS = Array.from({ length: 256 }, (_, level) => {
  const at = (level / 255) * (VIRIDIS.length - 1);
  const below = Math.min(Math.floor(at), VIRIDIS.length - 2);
  const [one, other] = [VIRIDIS[below], VIRIDIS[below + 1]].map(channels);
  return one.map((part, index) => Math.round(part + (at - below) * (other[index] - part)));
});

/** The third section of the page. */
export class MatrixView {
  /** @param goTo Called with the number of a frame whose answer is to be shown. */
  constructor(map, goTo) {
    this.map = map;
    this.goTo = goTo;
    this.canvas = html("canvas", {
      role: "application", "aria-roledescription": "similarity matrix", "aria-describedby": "matrix-readout",
    });
    this.chart = new Chart(byId("matrix-chart"), { height: (width) => Math.min(Math.max(width * 0.7, 220), 520) });
    byId("matrix-chart").append(this.canvas);
    this.marks = svg("svg", { class: "overlay", "aria-hidden": "true" });
    byId("matrix-chart").append(this.marks);
    const size = () => [this.drive.frames.length, map.bins];
    gridCursor(this.canvas, size, (...at) => this._read(...at), (...at) => this._choose(...at));
    for (const choice of document.getElementsByName("matrix-kind")) {
      choice.onchange = () => { if (this.drive) this._repaint(); };
    }
    byId("pair-go").onclick = () => this.goTo(this.chosen);
    this.begin(null);
  }

  get kind() {
    return document.querySelector("[name=matrix-kind]:checked").value;
  }

  /** Begins with another drive; null: none, or a single frame. */
  begin(drive) {
    this.drive = drive;
    this.cursor = null;
    this.chosen = null;
    this.judge = null;
    show("matrix-empty", drive === null);
    show("matrix-part", drive !== null);
    show("pair", false);
    show("pair-empty", true);
    if (drive === null) return;
    this.painted = 0;
    this.range = null;
    this.canvas.setAttribute("aria-label", `${drive.frames.length} frames, ${this.map.info.places} places`);
    this._repaint();
  }

  /** Adds what was answered since, and marks the frame that is shown. */
  update() {
    if (!this.drive) return;
    if (this.painted < this.drive.answers.length) this._paint();
    this._mark();
  }

  /** Marks answers as `judge` tells ("right", "wrong", "accepted" or "left"). */
  judged(judge) {
    this.judge = judge;
    if (this.drive) this._mark();
  }

  _repaint() {
    this.painted = 0;
    this.range = this.kind === "belief" ? [0, 1] : this._rangeOf(this.drive.answers);
    this._layOut();
    this._paint();
    this._mark();
  }

  _rangeOf(answers) {
    let [low, high] = [Infinity, -Infinity];
    for (const answer of answers) {
      for (const value of answer?.similarity ?? []) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    return low > high ? [0, 1] : [Math.floor(low / STEP) * STEP, Math.ceil(high / STEP) * STEP];
  }

  _paint() {
    const { answers, frames } = this.drive;
    if (this.kind === "similarity") {
      const [low, high] = this._rangeOf(answers.slice(this.painted));
      const [least, most] = this.range;
      if (low < least - 1e-6 || high > most + 1e-6 || !this.painted) {
        this.range = this.painted ? [Math.min(low, least), Math.max(high, most)] : [low, high];
        this.painted = 0;
      }
    }
    const rows = Math.min(frames.length, MOST_ROWS);
    if (!this.painted) {
      Object.assign(this.canvas, { width: this.map.bins, height: rows });
      this._values = new Float32Array(rows * this.map.bins).fill(-Infinity);
      this._legend();
    }
    const context = this.canvas.getContext("2d");
    const from = Math.floor((this.painted * rows) / frames.length);
    for (let frame = this.painted; frame < answers.length; frame += 1) {
      const values = answers[frame]?.[this.kind] ?? [];
      const start = Math.floor((frame * rows) / frames.length) * this.map.bins;
      for (let bin = 0; bin < values.length; bin += 1) {
        this._values[start + bin] = Math.max(this._values[start + bin], values[bin]);
      }
    }
    this.painted = answers.length;
    const until = Math.ceil((this.painted * rows) / frames.length);
    if (until <= from) return;
    const image = context.createImageData(this.map.bins, until - from);
    const [low, high] = this.range;
    for (let at = 0; at < image.width * image.height; at += 1) {
      const value = this._values[from * image.width + at];
      if (value === -Infinity) continue; // no answer: nothing is painted
      const level = Math.round(255 * Math.min(Math.max((value - low) / (high - low || 1), 0), 1));
      image.data.set(COLOURS[level], 4 * at);
      image.data[4 * at + 3] = 255;
    }
    context.putImageData(image, 0, from);
  }

  _legend() {
    const [low, high] = this.range;
    const stops = COLOURS.filter((_, index) => index % 15 === 0).map((colour, index) =>
      svg("rect", { x: index * 6, y: 0, width: 6.5, height: 12, fill: `rgb(${colour})` }));
    const name = this.kind === "belief" ? "probability" : "cosine";
    const scale = svg("svg", { width: 108, height: 12, viewBox: "0 0 108 12", "aria-hidden": "true" }, ...stops);
    byId("matrix-legend").replaceChildren(`${name} ${signed(low, 1)} `, scale, ` ${signed(high, 1)}`);
  }

  _layOut() {
    const frames = frameAxis(this.drive.frames.length);
    this.chart.draw({ x: placeAxis(this.map), y: { ...frames, min: frames.max, max: 0 } }, (area) => {
      this._area = area;
      const { left, top, width, height } = area;
      for (const [name, value] of Object.entries({ left, top, width, height })) {
        this.canvas.style[name] = `${value}px`;
        this.marks.style[name] = `${value}px`;
      }
      this.marks.setAttribute("viewBox", `0 0 ${width} ${height}`);
      this._mark();
    });
  }

  _mark() {
    if (!this._area) return;
    const { width, height } = this._area;
    const { answers, at, frames } = this.drive;
    const radius = Math.min(Math.max(height / frames.length / 2, 2), 5);
    const toX = (column) => ((column + 0.5) * width) / this.map.bins;
    const toY = (row) => ((row + 0.5) * height) / frames.length;
    const paths = { right: "", wrong: "", accepted: "", left: "" };
    answers.forEach((answer, frame) => {
      const best = answer && this.map.frameOfAnswer(answer);
      // The belief shows the answers by itself, and marks would cover it.
      if (!best || best.order === null || this.kind === "belief") return;
      const kind = this.judge?.(frame) ?? "left";
      paths[kind] += mark(kind, toX(this.map.bin(best.order)), toY(frame), radius);
    });
    const drawn = Object.entries(paths).map(([kind, d]) => svg("path", { class: `mark ${kind} on-picture`, d }));
    if (at >= 0) drawn.push(svg("path", { class: "shown", d: `M0 ${toY(at)}h${width}` }));
    if (this.cursor) {
      const d = `M${toX(this.cursor[1])} 0v${height}M0 ${toY(this.cursor[0])}h${width}`;
      drawn.push(svg("path", { class: "cross under", d }), svg("path", { class: "cross", d }));
    }
    this.marks.replaceChildren(...drawn);
  }

  _cell(row, column) {
    const answer = this.drive.answers[row];
    const text = answer
      ? `cosine ${signed(answer.similarity[column], 3)}, belief ${percent(answer.belief[column], 1)}` : "no answer";
    return { frame: this.drive.frames[row], answer, text };
  }

  _read(row, column) {
    this.cursor = [row, column];
    const { frame, text } = this._cell(row, column);
    byId("matrix-readout").textContent = `Frame ${row} (${frame.name}), ${this.map.binName(column)}: ${text}`;
    this._mark();
  }

  _choose(row, column) {
    const { frame, answer, text } = this._cell(row, column);
    this.chosen = row;
    const place = this.map.frameOfBin(column, answer?.drive);
    show("pair-empty", false);
    show("pair", true);
    byId("pair-text").textContent = `Frame ${row} and ${this.map.binName(column)}: ${text}.`;
    if (this._pairUrl) URL.revokeObjectURL(this._pairUrl);
    this._pairUrl = URL.createObjectURL(frame.file);
    setPicture(byId("pair-query"), this._pairUrl, `Frame ${frame.name} of the played drive`);
    byId("pair-query-caption").textContent = `Query: ${frame.name}`;
    const alt = `Frame ${place.stem} of the map's drive ${place.drive}`;
    setPicture(byId("pair-place"), pictureOf(place.id, this.map.info.version), alt);
    byId("pair-place-caption").textContent =
      `Place ${this.map.placeNumber(place.order)}: frame ${place.stem} of ${place.drive}`;
  }
}
