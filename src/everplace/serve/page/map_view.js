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
  const chart = new Chart(byId("coverage-chart"), {
    label: `Places by condition: ${conditions.map((name, row) => `${name} ${holesOf(map, cells, row).text}`).join("; ")}.`,
    height: ROW * conditions.length + AROUND, left: Math.min(Math.max(...conditions.map((name) => name.length)), LONGEST) * 7 + 14,
  });
  const y = { min: conditions.length, max: 0, label: "", ticks: () => conditions.map((name, row) => ({ at: row + 0.5, text: shortened(name) })) };
  const marks = svg("svg", { class: "overlay", tabindex: "0", role: "application", "aria-roledescription": "table of places and conditions", "aria-describedby": "coverage-readout", "aria-label": "Places by condition" });
  chart.draw({ x: placeAxis(map), y }, (area) => {
    const { group, x: toX, y: toY, left, top, width, height } = area;
    group.append(svg("defs", {}, svg("pattern", { id: "hole", width: 6, height: 6, patternUnits: "userSpaceOnUse" },
      svg("path", { class: "hatch", d: "M-1 7 7 -1M-1 1 1 -1M5 7 7 5" }))));
    conditions.forEach((name, row) => {
      for (const { from, to, level } of runs(cells, row, map.perBin)) {
        group.append(svg("rect", {
          class: `level level-${level}`, x: toX(from), width: Math.max(toX(to) - toX(from), 0.75), y: toY(row) + 2, height: ROW - 4,
        }));
      }
    });
    for (const [property, value] of Object.entries({ left, top, width, height })) marks.style[property] = `${value}px`;
    marks.setAttribute("viewBox", `0 0 ${width} ${height}`);
  });
  byId("coverage-chart").append(marks);
  gridCursor(marks, () => [conditions.length, map.bins], (row, bin) => {
    const frames = cells[bin][row];
    byId("coverage-readout").textContent = asSentence(`${map.binName(bin)} in ${conditions[row]}: ${frames ? counted(frames, "frame") : "no frame, a hole"}`);
    const box = marks.viewBox.baseVal;
    marks.replaceChildren(svg("rect", {
      class: "cell", x: (bin * box.width) / map.bins, y: row * ROW + 1, width: Math.max(box.width / map.bins, 3), height: ROW - 2,
    }));
  });
  byId("coverage-readout").textContent = "Move over the picture, or focus it and use the arrow keys, to read a place.";
  byId("coverage-legend").replaceChildren(...[[0, "no frame (a hole)"], [1, "1 frame a place"], [2, "2"], [3, "3 or more"]].map(([level, text]) =>
    html("span", { class: "key" }, svg("svg", { width: 18, height: 12, viewBox: "0 0 18 12", "aria-hidden": "true" },
      svg("rect", { class: `level level-${level}`, x: 0.5, y: 0.5, width: 17, height: 11 })), ` ${text}`)));
  showCoverage(map, conditions, cells);
  showLearned(map);
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

function holesOf(map, cells, row) {
  const holes = runs(cells, row, map.perBin).filter((run) => run.level === 0).map(({ from, to }) => {
    const first = map.placeNumber(from * map.perBin);
    const last = map.placeNumber(Math.min(to * map.perBin, map.info.places) - 1);
    return first === last ? String(first) : `${first} to ${last}`;
  });
  const more = holes.length > HOLES ? [`${holes.length - HOLES} more`] : [];
  return { holes, text: holes.length ? `has no frame of the places ${listed([...holes.slice(0, HOLES), ...more])}` : "has no hole" };
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
  fill("coverage-table", [["Condition", ""], ["Drives", "number"], ["Places seen", "number"], ["Holes (places without a frame)", "text"]],
    conditions.map((name, row) => {
      const { holes } = holesOf(map, cells, row);
      const more = holes.length > HOLES ? [`${holes.length - HOLES} more`] : [];
      return [
        name, count(drives.filter((drive) => drive.condition === name).length), `${count(seen[name])} of ${count(places)}`,
        holes.length ? listed([...holes.slice(0, HOLES), ...more]) : "none",
      ];
    }));
}

const HOW = { first: "it made the map", names: "frame names", poses: "poses", images: "its images" };

function showLearned(map) {
  const { learned, calibration, decodes, method } = map.info;
  fill("learned-table",
    [["Drive", ""], ["Condition", "text"], ["Frames", "number"], ["Placed", "number"], ["Surely", "number"], ["New places", "number"], ["Placed by", "text"], ["Names agree", "number"], ["Teaches", "text"]],
    learned.drives.map((one) => [
      one.name, one.condition, count(one.frames), count(one.placed), one.how === "first" ? "–" : count(one.sure), count(one.new_places),
      HOW[one.how] ?? one.how, one.agreement === null ? "–" : percent(one.agreement), one.learns ? "yes" : "no",
    ]));
  const pairs = learned.pairs
    ? `${counted(learned.pairs, "pair")} of frames that show the same place taught the descriptor what a change of light and season does here.`
    : "No two drives share places yet, so the descriptor knows only what other routes and other light taught it; add a drive with everplace map add.";
  const sure = calibration.provisional ? "Its probabilities were measured on other routes."
    : `Its probabilities were measured on ${count(calibration.queries)} of its own frames${calibration.expected_error === null ? "" : `, and are off by ${percent(calibration.expected_error, 1)} on average`}.`;
  const shown = decodes ? "" : ` Its method, ${method}, cannot show a frame in another condition.`;
  byId("learned-text").textContent = `${pairs} ${sure}${shown}`;
}
