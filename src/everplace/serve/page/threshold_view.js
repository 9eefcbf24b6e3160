// Which answers a threshold accepts, how many of them are right, and the curve that it lies on.

import { VERDICTS } from "./answer_view.js";
import { Chart, frameAxis, mark } from "./chart.js";
import { byId, count, counted, html, percent, show, svg } from "./elements.js";
import { measured, precisionCurve, rowAt, thresholdFor } from "./precision.js";

const WANTED = 0.99;

/** The fourth section of the page. */
export class ThresholdView {
  /** @param onJudged Called with what tells "right", "wrong", "accepted" or "left" of a frame's number. */
  constructor(map, onJudged) {
    this.map = map;
    this.onJudged = onJudged;
    this.slider = byId("threshold-slider");
    this.curve = new Chart(byId("curve-chart"), { label: "", height: 280 });
    this.points = new Chart(byId("answers-chart"), { label: "", height: 280 });
    this.table = map.info.precision ?? [];
    this.slider.value = thresholdFor(this.table, WANTED) ?? 0.9;
    for (const id of ["threshold-slider", "truth", "tolerance"]) byId(id).oninput = () => this.update();
    this.begin(null);
  }

  /** Begins with another drive; null: none, or a single frame. */
  begin(drive) {
    this.drive = drive;
    const known = drive ? drive.frames.filter((frame) => this.map.ordersOfStem(frame.name).length).length : 0;
    show("truth-part", drive !== null);
    byId("truth").disabled = !known;
    byId("truth").checked = false;
    if (drive) {
      byId("truth-note").textContent = known
        ? `${count(known)} of ${counted(drive.frames.length, "frame name")} are those of frames of the map.`
        : "No frame has the name of a frame of the map, so nothing tells which answers are right.";
    }
    this.update();
  }

  /** Judges all answers anew. */
  update() {
    const threshold = Number(this.slider.value);
    byId("threshold-value").textContent = threshold.toFixed(2);
    const judged = this._judgedAnswers();
    const knowing = byId("truth").checked;
    this.kindOf = (frame) => {
      const one = judged[frame];
      if (!one || one.probability < threshold) return "left";
      return knowing ? (one.right ? "right" : "wrong") : "accepted";
    };
    this._drawCurve(knowing ? precisionCurve(judged.filter(Boolean)) : this.table, knowing, threshold);
    this._drawAnswers(judged, threshold, knowing);
    const reading = this._reading(judged.filter(Boolean), threshold, knowing);
    byId("threshold-text").textContent = reading;
    this.slider.setAttribute("aria-valuetext", `${threshold.toFixed(2)}. ${reading}`);
    this.onJudged(this.kindOf);
  }

  _judgedAnswers() {
    const tolerance = Math.max(Number(byId("tolerance").value) || 0, 0);
    return (this.drive?.answers ?? []).map((answer, number) => {
      if (!answer) return null;
      const there = this.map.frameOfAnswer(answer)?.order ?? null;
      const orders = this.map.ordersOfStem(this.drive.frames[number].name);
      const right = there !== null && orders.some((order) => Math.abs(order - there) <= tolerance);
      return { probability: answer.probability, right, sought: orders.length > 0 };
    });
  }

  _reading(judged, threshold, knowing) {
    const chosen = `At ${threshold.toFixed(2)}`;
    const at = measured(judged, threshold);
    const are = at.accepted === 1 ? "is" : "are";
    const share = `${count(at.accepted)} of ${counted(judged.length, "answer")} of the played drive ${are} accepted`;
    if (knowing && judged.length) {
      if (!at.accepted) return `${chosen}, no answer of the played drive is accepted.`;
      const recall = at.recall === null ? "" : `, recall ${percent(at.recall, 1)}`;
      return `${chosen}, ${share}, ${count(at.right)} right and ${count(at.wrong)} wrong: `
        + `precision ${percent(at.precision, 1)}${recall}.`;
    }
    const row = rowAt(this.table, threshold);
    const own = row
      ? `On the map's own held-out answers this threshold gives precision ${percent(row.precision, 1)} `
        + `and recall ${percent(row.recall, 1)}.`
      : this.table.length ? "None of the map's own held-out answers was so sure." : "";
    return [judged.length ? `${chosen}, ${share}.` : "", own].filter(Boolean).join(" ");
  }

  _drawCurve(table, knowing, threshold) {
    const empty = !table.length;
    show("curve-empty", empty);
    show("curve-figure", !empty);
    if (empty) return;
    byId("curve-caption").textContent = knowing
      ? "Precision over recall of the answers played so far. The ring is the threshold."
      : "Precision over recall of the map's own answers, each drive held out in turn. The ring is the threshold.";
    const at = rowAt(table, threshold);
    const reached = at
      ? `precision ${percent(at.precision, 1)}, recall ${percent(at.recall, 1)}` : "nothing is accepted";
    this.curve.label = `Precision over recall; at the threshold ${threshold.toFixed(2)} ${reached}.`;
    const scale = { x: { min: 0, max: 1, label: "recall" }, y: { min: 0, max: 1, label: "precision" } };
    this.curve.draw(scale, ({ group, x, y }) => {
      const line = [...table].sort((one, other) => other.threshold - one.threshold);
      const points = line.map((one) => `${x(one.recall)} ${y(one.precision)}`);
      group.append(svg("path", { class: "curve", d: `M${points.join("L")}` }));
      if (at) group.append(svg("circle", { class: "ring", cx: x(at.recall), cy: y(at.precision), r: 7 }));
    });
  }

  _drawAnswers(judged, threshold, knowing) {
    show("answers-empty", this.drive === null);
    show("answers-figure", this.drive !== null);
    if (this.drive === null) return;
    const frames = this.drive.frames.length;
    this.points.label = "Probability of each answer of the played drive, with the threshold.";
    const kinds = knowing ? ["right", "wrong", "left"] : ["accepted", "left"];
    const legend = html("span", { class: "legend" }, ...kinds.map(legendMark), "– – threshold");
    byId("answers-caption").replaceChildren("Answers along the played drive:  ", legend);
    const scale = { x: frameAxis(frames), y: { min: 0, max: 1, label: "probability" } };
    this.points.draw(scale, ({ group, x, y, width }) => {
      const radius = Math.min(Math.max(width / frames / 2, 2), 4.5);
      const paths = {};
      judged.forEach((one, frame) => {
        if (!one) return;
        const kind = this.kindOf(frame);
        paths[kind] = (paths[kind] ?? "") + mark(kind, x(frame + 0.5), y(one.probability), radius);
      });
      group.append(
        ...Object.entries(paths).map(([kind, d]) => svg("path", { class: `mark ${kind}`, d })),
        svg("path", { class: "threshold", d: `M${x(0)} ${y(threshold)}H${x(frames)}` }),
      );
    });
  }
}

function legendMark(kind) {
  const sample = svg("path", { class: `mark ${kind}`, d: mark(kind, 6, 6, 4.5) });
  const box = svg("svg", { width: 12, height: 12, viewBox: "0 0 12 12", "aria-hidden": "true" }, sample);
  return html("span", { class: "key" }, box, VERDICTS[kind].replace(/^. /, ""));
}
