"""Shows training on stderr: a bar for a person at a terminal, a line an epoch for a log file."""

from __future__ import annotations

import sys
from types import TracebackType

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)  # fmt: skip
from rich.text import Text

from everplace.model.posterior import BLOCKS

__all__ = ["Display", "TrainingDisplay"]

_SHOWN = {
    "bound": "bound",
    "image": "log p(x|z)",
    "place": "log p(p|z_p)",
    "condition": "log p(c|z_c)",
    **{f"kl_{block}": f"KL {symbol}" for block, symbol in BLOCKS.items()},
    **{f"active_{block}": f"active {symbol}" for block, symbol in BLOCKS.items()},
    "held_out_recall_at_1": "held-out recall@1",
}

_BAR = 20
_TIME_LEFT = len("0:00:00")


class _Terms(ProgressColumn):
    """As many of the terms as the terminal has room for; whole ones, since half a number misleads."""

    def __init__(self, console: Console) -> None:
        super().__init__()
        self._console = console

    def render(self, task: Task) -> Text:
        """The terms, beside what stands before them: epoch, bar, batches and time left."""
        total = int(task.total or 0)
        before = (len(task.description), _BAR, len(f"{total}/{total}"), _TIME_LEFT)
        room = self._console.width - sum(before) - len(before)
        shown = ""
        for term in task.fields["terms"]:
            longer = f"{shown}  {term}" if shown else term
            if len(longer) > room:
                break
            shown = longer
        return Text(shown, no_wrap=True)


class Display:
    """Shows nothing; a context that is open while a run trains."""

    def __enter__(self) -> Display:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def begin_epoch(self, epoch: int, batches: int) -> None:
        """An epoch of so many batches begins, after `epoch` complete ones."""

    def advance(self) -> None:
        """A batch is done."""

    def end_epoch(self, row: dict[str, float]) -> None:
        """An epoch is done; its row of metrics.csv."""


class TrainingDisplay(Display):
    """Shows a run."""

    def __init__(self, epochs: int | None, name: str = "") -> None:
        """Prepares the display.

        Args:
            epochs: Of the whole run; None if minutes limit it.
            name: What the run is called, where several are trained one after the other.
        """
        self._prefix = f"{name}: " if name else ""
        self._of = f"/{epochs}" if epochs else ""
        self._console = Console(file=sys.stderr)
        self._bar: Progress | None = None
        self._task = TaskID(0)

    def __enter__(self) -> TrainingDisplay:
        if self._console.is_terminal:
            self._bar = Progress(
                TextColumn("{task.description}"), BarColumn(_BAR), MofNCompleteColumn(), TimeRemainingColumn(),
                _Terms(self._console), console=self._console,
            )  # fmt: skip
            self._task = self._bar.add_task(f"{self._prefix}epoch 1", terms=[])
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def begin_epoch(self, epoch: int, batches: int) -> None:
        """Begins the bar of an epoch."""
        if self._bar is not None:
            self._bar.reset(self._task, total=batches, description=f"{self._prefix}epoch {epoch + 1}{self._of}")

    def advance(self) -> None:
        """Moves the bar."""
        if self._bar is not None:
            self._bar.advance(self._task)

    def end_epoch(self, row: dict[str, float]) -> None:
        """Shows the terms of the bound and the held-out recall."""
        terms = [f"{label} {row[name]:.4g}" for name, label in _SHOWN.items() if name in row]
        if self._bar is not None:
            self._bar.update(self._task, terms=terms)
        else:
            self._console.print(
                f"{self._prefix}epoch {row['epoch']:.0f} ({row['seconds']:.0f} s): {'  '.join(terms)}", soft_wrap=True
            )
