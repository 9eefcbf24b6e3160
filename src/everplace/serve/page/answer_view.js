// The query beside the place that it matches, the answer in a sentence and in numbers, and the next best places.

import { PROVISIONAL, conditionOf, isOffMap, sentenceOf } from "./answer_sentence.js";
import { byId, html, percent, say, show, signed } from "./elements.js";
import { pictureOf, translated } from "./service.js";

/** What a threshold makes of an answer, in words. */
export const VERDICTS = { right: "✓ right", wrong: "✗ wrong", accepted: "accepted", left: "not accepted" };
const SPOKEN_EVERY = 4000; // milliseconds, while a drive plays

/** Sets a picture from a URL that may have to be waited for, unless another one was asked for meanwhile. */
export function setPicture(image, url, alt) {
  image.alt = alt;
  image._wanted = url;
  Promise.resolve(url).then(
    (address) => { if (image._wanted === url) image.src = address; },
    () => { if (image._wanted === url) image.removeAttribute("src"); },
  );
}

/** The first section of the page. */
export class AnswerView {
  constructor(map) {
    this.map = map;
    this._queryUrl = null;
    this._spoken = 0;
    this._translating = null;
    this._wanted = null;
    const choice = byId("translated-condition");
    choice.replaceChildren(html("option", { value: "" }, "as the match"),
      ...Object.keys(map.info.conditions).map((name) => html("option", { value: name }, name)));
    choice.onchange = () => this._translate();
  }

  /** Shows a frame and its answer; `playing`: others follow at once. */
  show(frame, answer, playing) {
    show("query-empty", false);
    show("answer", true);
    this._frame = frame;
    this._answer = answer;
    if (this._queryUrl) URL.revokeObjectURL(this._queryUrl);
    this._queryUrl = URL.createObjectURL(frame.file);
    setPicture(byId("query-image"), this._queryUrl, `The frame ${frame.name} that was asked about`);
    byId("query-caption").textContent = `Query: ${frame.name}`;
    show("match-figure", answer !== null);
    for (const part of ["matches-part", "facts-part"]) show(part, answer !== null);
    if (answer === null) {
      byId("sentence").textContent = "This frame has no answer.";
      show("translated-figure", false);
      return;
    }
    byId("sentence").textContent = sentenceOf(answer);
    byId("answer").classList.toggle("off", isOffMap(answer));
    say("provisional", answer.provisional ? PROVISIONAL : "");
    const best = this.map.frameOfAnswer(answer);
    if (best) {
      const alt = `The map's frame ${best.stem} of ${best.drive}`;
      setPicture(byId("match-image"), pictureOf(best.id, this.map.info.version), alt);
    }
    const match = isOffMap(answer) ? "Most alike on the map" : "Best match";
    byId("match-caption").textContent =
      `${match}: place ${answer.place}, frame ${answer.database_frame} of ${answer.drive}`;
    this._showMatches(answer);
    this._showFacts(answer);
    this._translate();
    this._speak(frame, answer, playing);
  }

  /** Says what the threshold makes of the answer ("right", "wrong", "accepted", "left"); null: nothing. */
  judge(kind) {
    byId("verdict").className = `verdict ${kind}`;
    say("verdict", kind ? VERDICTS[kind] : "");
  }

  _speak(frame, answer, playing) {
    if (playing && Date.now() - this._spoken < SPOKEN_EVERY) return;
    this._spoken = Date.now();
    byId("live").textContent = `Frame ${frame.name}: ${sentenceOf(answer)}${answer.provisional ? " Provisional." : ""}`;
  }

  _showMatches(answer) {
    const others = answer.matches.filter((match) => match.place !== answer.place).slice(0, 6);
    show("matches-empty", !others.length);
    const list = byId("matches");
    while (list.children.length > others.length) list.lastChild.remove();
    others.forEach((match, index) => {
      // Pictures keep their elements while a drive plays, so that nothing flickers.
      const item = list.children[index] ?? list.appendChild(html("li", {}, html("img"), html("div")));
      const alt = `Place ${match.place} in ${match.condition}`;
      setPicture(item.firstChild, pictureOf(match.id, this.map.info.version), alt);
      item.lastChild.replaceChildren(
        html("strong", {}, percent(match.probability)), ` place ${match.place}`, html("br"),
        html("span", { class: "hint" }, `${match.drive}, cosine ${signed(match.score, 2)}`),
      );
    });
  }

  _showFacts(answer) {
    const rows = [
      ["This place, or the one next to it", percent(answer.probability, 1)],
      ["Not on the map", percent(answer.off_map, 1)],
      ["Cosine to the match", signed(answer.score, 3)],
    ];
    if (answer.pose) {
      const [x, y, heading] = answer.pose;
      const degrees = signed((heading * 180) / Math.PI, 0);
      rows.push(["Pose of the match", `x ${signed(x, 1)} m, y ${signed(y, 1)} m, heading ${degrees}°`]);
    }
    const conditions = Object.entries(answer.condition).sort((one, other) => other[1] - one[1]).map(([name, share]) => {
      const bar = html("meter", { min: 0, max: 1, "aria-hidden": "true" });
      bar.value = share;
      return [`${answer.unseen_condition ? "Nearest to" : "Looks like"} ${name}`, bar, percent(share, 1)];
    });
    if (answer.unseen_condition) rows.push(["Condition", "unlike any that the map has seen"]);
    byId("facts").replaceChildren(...[...rows, ...conditions].map(([name, ...values]) =>
      html("div", {}, html("dt", {}, name), html("dd", {}, ...values))));
  }

  /** One request at a time; while it runs, only the last wish is kept. */
  async _translate() {
    if (!this.map.info.decodes || this._answer === null) return;
    const best = this.map.frameOfAnswer(this._answer);
    const matched = best?.condition ?? conditionOf(this._answer);
    const condition = byId("translated-condition").value || matched;
    byId("translated-condition").options[0].textContent = `as the match: ${matched}`;
    this._wanted = { file: this._frame.file, name: this._frame.name, condition };
    if (this._translating) return;
    this._translating = true;
    while (this._wanted) {
      const { file, name, condition: wanted } = this._wanted;
      this._wanted = null;
      show("translated-figure", true);
      const image = byId("translated-image");
      try {
        const url = await translated(file, wanted);
        if (image.src.startsWith("blob:")) URL.revokeObjectURL(image.src);
        image.src = url;
        image.alt = `The frame ${name} as it would look in ${wanted}`;
        say("translated-problem", "");
      } catch (error) {
        image.removeAttribute("src");
        image.alt = "";
        say("translated-problem", error.message);
      }
    }
    this._translating = false;
  }
}
