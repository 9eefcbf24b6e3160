// The page, from the map that is served to the answers that are shown.

import { AnswerView } from "./answer_view.js";
import { byId, counted, listed, say, show } from "./elements.js";
import { drivesOf, filesOfDrop, filesOfInput, passedOver } from "./frame_files.js";
import { MapIndex } from "./map_index.js";
import { showMap } from "./map_view.js";
import { MatrixView } from "./matrix_view.js";
import { PlayedDrive } from "./played_drive.js";
import { RouteView } from "./route_view.js";
import { readMap } from "./service.js";
import { ThresholdView } from "./threshold_view.js";

const NO_IMAGE = "There is no image among these files; choose PNG or JPEG files. Videos and bags are answered by "
  + "everplace localize.";

let map, views, drive = null;

async function openMap() {
  const info = await readMap();
  map = new MapIndex(info);
  const drives = `${counted(info.drives.length, "drive")} (${listed(Object.keys(info.conditions))})`;
  byId("map-summary").textContent =
    `${counted(info.places, "place")}, ${drives}, ${info.method}, version ${info.version}`;
  const matrix = new MatrixView(map, (frame) => drive.show(frame));
  views = { answer: new AnswerView(map), route: new RouteView(map), matrix };
  views.threshold = new ThresholdView(map, (judge) => {
    views.matrix.judged(judge);
    views.answer.judge(drive && drive.frames.length > 1 && drive.answers[drive.at] ? judge(drive.at) : null);
  });
  showMap(map);
}

function begin({ name, frames }) {
  drive?.end();
  drive = new PlayedDrive(name, frames, map.info.version, { onShown, onState, onProblem, onNewMap });
  drive.pace = Number(byId("speed").value);
  const several = frames.length > 1;
  say("query-problem", "");
  show("transport", several);
  views.matrix.begin(several ? drive : null);
  views.threshold.begin(several ? drive : null);
  views.route.show(null);
  byId("query-empty").textContent = "Looking for its place on the map.";
  onState();
  if (several) drive.play();
  else drive.show(0);
}

function onShown() {
  const { at, answers, frames } = drive;
  say("query-problem", "");
  views.answer.show(frames[at], answers[at], drive.playing);
  views.route.show(answers[at]);
  views.matrix.update();
  views.threshold.update();
  onState();
}

function onProblem(text) {
  say("query-problem", text);
  show("query-empty", false);
}

function onState() {
  const { at, answers, frames, playing } = drive;
  byId("play").textContent = playing ? "Pause" : at === frames.length - 1 ? "Play again" : "Play";
  const position = byId("position");
  position.max = frames.length - 1;
  position.value = Math.max(at, 0);
  const text = `${Math.max(at, 0) + 1} of ${frames.length}`;
  byId("position-text").textContent = answers.length < frames.length ? `${text}, ${answers.length} answered` : text;
  position.setAttribute("aria-valuetext", `frame ${text}`);
  byId("step-back").disabled = at <= 0;
  byId("step-on").disabled = at >= frames.length - 1;
}

/** The map was added to: its places changed, so the drive begins anew. */
async function onNewMap() {
  const { name, frames } = drive;
  try {
    await openMap();
  } catch (error) {
    say("query-problem", error.message);
    return;
  }
  begin({ name, frames });
  say("files-note", `The map grew to version ${map.info.version} meanwhile, so the drive began anew.`);
}

async function take(found) {
  if (!found.length) return;
  await opening; // the user may be quicker than the map
  if (!map) return;
  const { drives, others } = drivesOf(found);
  const choice = byId("folder-select");
  const options = drives.map(({ name, frames }, index) => new Option(`${name || "frames"} (${frames.length})`, index));
  choice.replaceChildren(...options);
  show("folder-choice", drives.length > 1);
  choice.onchange = () => begin(drives[Number(choice.value)]);
  const several = drives.length > 1
    ? `${drives.length} folders hold frames; the first one is played, the others can be chosen.` : "";
  say("files-note", [passedOver(others), several].filter(Boolean).join(" "));
  if (drives.length) begin(drives[0]);
  else say("query-problem", NO_IMAGE);
}

function listenToFiles() {
  for (const kind of ["frames", "folder"]) {
    const input = byId(`${kind}-input`);
    byId(`choose-${kind}`).onclick = () => input.click();
    input.onchange = async () => {
      const found = filesOfInput(input);
      input.value = ""; // so that the same choice can be made again
      await take(found);
      // Space would open the chooser again, where it is to play and pause.
      if (drive?.frames.length > 1) byId("play").focus({ preventScroll: true });
    };
  }
  let depth = 0; // of the elements that the pointer entered while it drags
  const sign = (by) => show("drop-sign", (depth = Math.max(depth + by, 0)) > 0);
  const dragged = (event) => event.dataTransfer?.types.includes("Files");
  addEventListener("dragenter", (event) => { if (dragged(event)) sign(1); });
  addEventListener("dragleave", (event) => { if (dragged(event)) sign(-1); });
  addEventListener("dragover", (event) => { if (dragged(event)) event.preventDefault(); });
  addEventListener("drop", async (event) => {
    if (!dragged(event)) return;
    event.preventDefault();
    sign(-Infinity);
    try {
      await take(await filesOfDrop(event.dataTransfer));
    } catch {
      say("query-problem", "The browser could not read what was dropped; choose the files with the buttons.");
    }
  });
}

function listenToTransport() {
  byId("play").onclick = () => (drive.playing ? drive.pause() : drive.play());
  byId("step-back").onclick = () => drive.step(-1);
  byId("step-on").onclick = () => drive.step(1);
  byId("position").oninput = () => {
    drive.pause();
    if (drive.answers.length) drive.show(Math.min(Number(byId("position").value), drive.answers.length - 1));
    onState();
  };
  byId("speed").onchange = () => { drive.pace = Number(byId("speed").value); };
  byId("anew").onclick = () => begin(drive);
  addEventListener("keydown", (event) => {
    if (!drive || drive.frames.length < 2 || event.ctrlKey || event.metaKey || event.altKey) return;
    // Keys that do something of their own where the focus is are left to it.
    const taken = event.target.closest("input, select, button, a, summary, dialog, [tabindex]");
    if (event.key === " " && !taken) byId("play").click();
    else if (event.key === "ArrowLeft" && !taken?.matches("input, select, [tabindex]")) drive.step(-1);
    else if (event.key === "ArrowRight" && !taken?.matches("input, select, [tabindex]")) drive.step(1);
    else return;
    event.preventDefault();
  });
}

listenToFiles();
listenToTransport();
const opening = openMap().catch((error) => {
  byId("map-summary").textContent = "";
  say("map-problem", error.message);
});
