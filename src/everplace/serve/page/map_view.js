// What the map holds: which places it knows under which condition, and what each drive taught it.

import { AROUND, Chart, placeAxis } from "./chart.js";
import { asSentence, byId, count, counted, html, listed, percent, svg } from "./elements.js";
import { gridCursor } from "./grid_cursor.js";

const ROW = 26; // pixels
const MOST = 3; // frames a place, from which on the shade stays
const HOLES = 6; // named in the table
const LONGEST = 14; // letters of a condition beside the picture

/** The last section of the page. */
export function showMap(map) {
  const { conditions, cells } = map.info.table;
  drawCoverage(map, conditions, cells);
  showLegend();
  showCoverage(map, conditions, cells);
  showLearned(map);
}

function drawCoverage(map, conditions, cells) {
  const spoken = conditions.map((name, row) => `${name} lacks ${holesOf(map, cells, row) || "none"}`).join("; ");
  const chart = new Chart(byId("coverage-chart"), {
    label: `Places by condition: ${spoken}.`,
    height: ROW * conditions.length + AROUND,
    left: Math.min(Math.max(...conditions.map((name) => name.length)), LONGEST) * 7 + 14,
  });
  const names = () => conditions.map((name, row) => ({ at: row + 0.5, text: shortened(name) }));
  const cursor = svg("svg", {
    class: "overlay", role: "application", "aria-roledescription": "table of places and conditions",
    "aria-label": "Places by condition", "aria-describedby": "coverage-readout",
  });
  const axes = { x: placeAxis(map), y: { min: conditions.length, max: 0, label: "", ticks: names } };
  chart.draw(axes, ({ group, x, y, left, top, width, height }) => {
    const hatch = svg("path", { class: "hatch", d: "M-1 7 7 -1M-1 1 1 -1M5 7 7 5" });
    const hole = svg("pattern", { id: "hole", width: 6, height: 6, patternUnits: "userSpaceOnUse" }, hatch);
    group.append(svg("defs", {}, hole));
    conditions.forEach((_, row) => {
      for (const { from, to, level } of runs(cells, row, map.perBin)) {
        const wide = Math.max(x(to) - x(from), 0.75);
        group.append(svg("rect", {
          class: `level level-${level}`, x: x(from), y: y(row) + 2, width: wide, height: ROW - 4,
        }));
      }
    });
    for (const [name, value] of Object.entries({ left, top, width, height })) cursor.style[name] = `${value}px`;
    cursor.setAttribute("viewBox", `0 0 ${width} ${height}`);
  });
  byId("coverage-chart").append(cursor);
  byId("coverage-readout").textContent = "Move over the picture, or focus it and use the arrow keys, to read a place.";
  gridCursor(cursor, () => [conditions.length, map.bins], (row, bin) => {
    const frames = cells[bin][row];
    const found = frames ? counted(frames, "frame") : "no frame, a hole";
    byId("coverage-readout").textContent = asSentence(`${map.binName(bin)} in ${conditions[row]}: ${found}`);
    const across = cursor.viewBox.baseVal.width / map.bins;
    cursor.replaceChildren(svg("rect", {
      class: "cell", x: bin * across, y: row * ROW + 1, width: Math.max(across, 3), height: ROW - 2,
    }));
  });
}

function showLegend() {
  const levels = ["no frame (a hole)", "1 frame a place", "2", "3 or more"];
  byId("coverage-legend").replaceChildren(...levels.map((text, level) => {
    const sample = svg("rect", { class: `level level-${level}`, x: 0.5, y: 0.5, width: 17, height: 11 });
    const box = svg("svg", { width: 18, height: 12, viewBox: "0 0 18 12", "aria-hidden": "true" }, sample);
    return html("span", { class: "key" }, box, ` ${text}`);
  }));
}

const shortened = (name) => (name.length > LONGEST ? `${name.slice(0, LONGEST - 1)}…` : name);

const levelOf = (frames, perBin) => Math.min(Math.ceil(frames / perBin), MOST);

/** Neighbouring columns of a condition with the same shade. */
function runs(cells, row, perBin) {
  const found = [];
  cells.forEach((cell, bin) => {
    const level = levelOf(cell[row], perBin);
    if (found.at(-1)?.level === level) found.at(-1).to = bin + 1;
    else found.push({ from: bin, to: bin + 1, level });
  });
  return found;
}

/** The places that a condition has no frame of: "0 to 19 and 71"; empty where there is none. */
function holesOf(map, cells, row) {
  const holes = runs(cells, row, map.perBin).filter((run) => run.level === 0).map(({ from, to }) => {
    const first = map.placeNumber(from * map.perBin);
    const last = map.placeNumber(Math.min(to * map.perBin, map.info.places) - 1);
    return first === last ? String(first) : `${first} to ${last}`;
  });
  return listed(holes.length > HOLES ? [...holes.slice(0, HOLES), `${holes.length - HOLES} more`] : holes);
}

function fill(id, heads, rows) {
  byId(id).replaceChildren(
    html("thead", {}, html("tr", {}, ...heads.map(([name, kind]) => html("th", { scope: "col", class: kind }, name)))),
    html("tbody", {}, ...rows.map((row) => html("tr", {}, ...row.map((value, index) =>
      index ? html("td", { class: heads[index][1] }, value) : html("th", { scope: "row" }, value))))),
  );
}

function showCoverage(map, conditions, cells) {
  const { drives, conditions: seen, places } = map.info;
  const heads = [
    ["Condition", ""], ["Drives", "number"], ["Places seen", "number"], ["Holes (places without a frame)", "text"],
  ];
  fill("coverage-table", heads, conditions.map((name, row) => {
    const driven = drives.filter((drive) => drive.condition === name).length;
    return [name, count(driven), `${count(seen[name])} of ${count(places)}`, holesOf(map, cells, row) || "none"];
  }));
}

const HOW = { first: "it made the map", names: "frame names", poses: "poses", images: "its images" };

function showLearned(map) {
  const { learned, calibration, decodes, method } = map.info;
  const heads = [
    ["Drive", ""], ["Condition", "text"], ["Frames", "number"], ["Placed", "number"], ["Surely", "number"],
    ["New places", "number"], ["Placed by", "text"], ["Names agree", "number"], ["Teaches", "text"],
  ];
  fill("learned-table", heads, learned.drives.map((one) => [
    one.name, one.condition, count(one.frames), count(one.placed), one.how === "first" ? "–" : count(one.sure),
    count(one.new_places), HOW[one.how] ?? one.how, one.agreement === null ? "–" : percent(one.agreement),
    one.learns ? "yes" : "no",
  ]));
  const pairs = learned.pairs
    ? `${counted(learned.pairs, "pair")} of frames that show the same place taught the descriptor what a change of `
      + "light and season does here."
    : "No two drives share places yet, so the descriptor knows only what other routes and other light taught it; add a "
      + "drive with everplace map add.";
  const off = calibration.expected_error === null
    ? "" : `, and are off by ${percent(calibration.expected_error, 1)} on average`;
  const sure = calibration.provisional
    ? "Its probabilities were measured on other routes."
    : `Its probabilities were measured on ${count(calibration.queries)} of its own frames${off}.`;
  const shown = decodes ? "" : ` Its method, ${method}, cannot show a frame in another condition.`;
  byId("learned-text").textContent = `${pairs} ${sure}${shown}`;
}
