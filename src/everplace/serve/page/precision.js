// Which answers are right, and what precision and recall a threshold leaves; pure numbers.

/**
 * What a threshold accepts.
 *
 * @param judged [{probability, right, sought}]: for each answer whether it is right, and whether the map shows it.
 * @returns {accepted, right, wrong, precision, recall}; precision null where nothing is accepted, recall null where the
 *     map shows none of the frames.
 */
export function measured(judged, threshold) {
  const accepted = judged.filter((one) => one.probability >= threshold);
  const right = accepted.filter((one) => one.right).length;
  const sought = judged.filter((one) => one.sought).length;
  return {
    accepted: accepted.length, right, wrong: accepted.length - right,
    precision: accepted.length ? right / accepted.length : null, recall: sought ? right / sought : null,
  };
}

/** [{threshold, precision, recall}] at every probability that occurs, from the surest down. */
export function precisionCurve(judged) {
  const sorted = [...judged].sort((one, other) => other.probability - one.probability);
  const sought = judged.filter((one) => one.sought).length;
  const points = [];
  let right = 0;
  sorted.forEach((one, index) => {
    right += one.right ? 1 : 0;
    // Equal probabilities are accepted at once.
    if (sorted[index + 1]?.probability === one.probability) return;
    points.push({ threshold: one.probability, precision: right / (index + 1), recall: sought ? right / sought : 0 });
  });
  return points;
}

/** The row of a table of thresholds that holds for a threshold: the one with the least threshold not below it. */
export function rowAt(table, threshold) {
  return table.reduce((best, row) =>
    row.threshold >= threshold && (best === null || row.threshold < best.threshold) ? row : best, null);
}

/** The least threshold of a table with a precision; null: none has it. */
export function thresholdFor(table, precision) {
  const rows = table.filter((row) => row.precision >= precision).map((row) => row.threshold);
  return rows.length ? Math.min(...rows) : null;
}
