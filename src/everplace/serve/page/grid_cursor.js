// A cursor in a picture of rows and columns, by pointer and by keyboard.

const FAR = 10;
const STEPS = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };

/**
 * Makes an element's cells reachable.
 *
 * @param element What is focused and pointed at; its box is the picture.
 * @param size Gives [rows, columns].
 * @param onMove Called with (row, column) under the pointer or the keyboard's cursor.
 * @param onChoose Called with (row, column) at a click, Enter or Space.
 */
export function gridCursor(element, size, onMove, onChoose = () => {}) {
  let at = [0, 0];
  element.tabIndex = 0;

  const moveTo = (row, column) => {
    const [rows, columns] = size();
    at = [Math.min(Math.max(row, 0), rows - 1), Math.min(Math.max(column, 0), columns - 1)];
    onMove(...at);
  };
  const under = (event) => {
    const box = element.getBoundingClientRect();
    const [rows, columns] = size();
    const [down, across] = [(event.clientY - box.top) / box.height, (event.clientX - box.left) / box.width];
    moveTo(Math.floor(rows * down), Math.floor(columns * across));
  };
  element.addEventListener("pointermove", under);
  element.addEventListener("click", (event) => { under(event); onChoose(...at); });
  element.addEventListener("focus", () => { if (element.matches(":focus-visible")) onMove(...at); });
  element.addEventListener("keydown", (event) => {
    const step = STEPS[event.key];
    if (step) {
      const by = event.shiftKey ? FAR : 1;
      moveTo(at[0] + by * step[0], at[1] + by * step[1]);
    } else if (event.key === "Home" || event.key === "End") {
      moveTo(at[0], event.key === "Home" ? 0 : size()[1] - 1);
    } else if (event.key === "PageUp" || event.key === "PageDown") {
      moveTo(event.key === "PageUp" ? 0 : size()[0] - 1, at[1]);
    } else if (event.key === "Enter" || event.key === " ") {
      onChoose(...at);
    } else {
      return;
    }
    event.preventDefault();
    event.stopPropagation();
  });
}
