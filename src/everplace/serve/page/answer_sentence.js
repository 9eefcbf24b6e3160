// What an answer says, in one sentence.

import { percent } from "./elements.js";

const LIKELY = 0.5;

/** The most probable condition of an answer, or null. */
export function conditionOf(answer) {
  const [best] = Object.entries(answer.condition).sort((one, other) => other[1] - one[1]);
  return best ? best[0] : null;
}

/** Whether the answer is that the frame shows no place of the map. */
export const isOffMap = (answer) => answer.off_map > Math.max(LIKELY, answer.probability);

/** "At place 212 with 97 %, looks like winter." */
export function sentenceOf(answer) {
  if (isOffMap(answer)) return `Not on this map (${percent(answer.off_map)}).`;
  const looks = answer.unseen_condition ? "a condition not seen before" : `looks like ${conditionOf(answer)}`;
  return answer.probability >= LIKELY
    ? `At place ${answer.place} with ${percent(answer.probability)}, ${looks}.`
    : `Not sure: place ${answer.place} is the best guess (${percent(answer.probability)}), ${looks}.`;
}

/** What is to be said of probabilities that come from elsewhere. */
export const PROVISIONAL = "Provisional: the map has not seen enough places come back in another drive, so these "
  + "percentages were measured on other routes.";
