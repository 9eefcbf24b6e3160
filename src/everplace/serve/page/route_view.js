// Where the query lies: the belief along the route, as a strip and, where the map has poses, on the ground.

import { isOffMap } from "./answer_sentence.js";
import { AROUND, Chart, placeAxis } from "./chart.js";
import { byId, percent, show, svg } from "./elements.js";

const FAINT = 0.004; // probabilities below are not drawn

/** The second section of the page. */
export class RouteView {
  constructor(map) {
    this.map = map;
    this.strip = new Chart(byId("belief-chart"), { label: "Probability of each place; no frame yet.", height: 210 });
    const poses = map.info.poses?.filter(Boolean) ?? [];
    show("poses-figure", poses.length > 1);
    byId("poses-figure").parentElement.classList.toggle("single", poses.length < 2);
    if (poses.length > 1) {
      this.bounds = boundsOf(poses);
      this.ground = new Chart(byId("poses-chart"), {
        label: "The route from above.", height: (across) => groundHeight(across, this.bounds) + AROUND,
      });
      byId("poses-caption").textContent = "The route from above. "
        + "The larger and stronger a disc, the more probable its place; the ring is the answer.";
    }
    this.show(null);
  }

  /** Shows an answer; null: none yet. */
  show(answer) {
    const belief = answer?.belief ?? [];
    const best = answer ? this.map.frameOfAnswer(answer) : null;
    const bin = best && best.order !== null && !isOffMap(answer) ? this.map.bin(best.order) : null;
    const text = !answer ? "Probability of each place. It fills in with the first frame."
      : bin === null
        ? `The frame is most likely on no place of the map (${percent(answer.off_map)}); these places share the rest.`
        : `The mark is the answer, ${this.map.binName(bin)}; not on the map: ${percent(answer.off_map)}.`;
    byId("belief-caption").textContent = text;
    this.strip.label = `Probability of each place along the route. ${text}`;
    this._drawStrip(belief, bin);
    if (this.ground) this._drawGround(belief, bin);
  }

  _drawStrip(belief, bin) {
    const { map } = this;
    const axes = { x: placeAxis(map), y: { min: 0, max: 1, label: "probability" } };
    this.strip.draw(axes, ({ group, x: toX, y: toY, width }) => {
      const wide = Math.max(width / map.bins - 1, 2.5);
      const bars = belief.map((share, at) => share > FAINT ? `M${toX(at + 0.5)} ${toY(0)}V${toY(share)}` : "").join("");
      group.append(svg("path", { class: "belief", d: bars, "stroke-width": wide }));
      if (bin !== null) {
        const at = toX(bin + 0.5);
        const top = Math.max(toY(Math.min(belief[bin], 1)) - 4, toY(1) + 1);
        group.append(svg("path", { class: "answer-mark", d: `M${at} ${top}l-6 -9h12z` }));
      }
    });
  }

  _drawGround(belief, bin) {
    // The same scale both ways: whichever axis has room to spare shows more ground.
    const axes = (across) => {
      const { x, y, width, height } = this.bounds;
      const high = groundHeight(across, this.bounds);
      const half = Math.max(width / across, height / high) / 2;
      return {
        x: { min: x - half * across, max: x + half * across, label: "x (m)" },
        y: { min: y - half * high, max: y + half * high, label: "y (m)" },
      };
    };
    this.ground.draw(axes, ({ group, x: toX, y: toY }) => {
      const { poses } = this.map.info;
      let pen = "M";
      const way = poses.map((pose) => {
        if (!pose) {
          pen = "M";
          return "";
        }
        const piece = `${pen}${toX(pose[0])} ${toY(pose[1])}`;
        pen = "L";
        return piece;
      }).join("");
      group.append(svg("path", { class: "way", d: way }));
      belief.forEach((share, at) => {
        if (share <= FAINT || !poses[at]) return;
        group.append(svg("circle", {
          class: "spot", cx: toX(poses[at][0]), cy: toY(poses[at][1]), r: 2 + 6 * Math.sqrt(share),
          "fill-opacity": 0.3 + 0.7 * share,
        }));
      });
      if (bin !== null && poses[bin]) {
        group.append(svg("circle", { class: "ring", cx: toX(poses[bin][0]), cy: toY(poses[bin][1]), r: 11 }));
      }
    });
  }
}

/** How high the ground is drawn, in pixels. */
const groundHeight = (across, { width, height }) => Math.min(Math.max((across * height) / width, 80), 320);

/** Middle, width and height of the ground that the route takes, with a margin. */
function boundsOf(poses) {
  const [x, y] = [0, 1].map((axis) => {
    const values = poses.map((pose) => pose[axis]);
    return { low: Math.min(...values), high: Math.max(...values) };
  });
  const margin = 0.08 * Math.max(x.high - x.low, y.high - y.low, 1);
  return {
    x: (x.low + x.high) / 2, y: (y.low + y.high) / 2, width: x.high - x.low + margin, height: y.high - y.low + margin,
  };
}
