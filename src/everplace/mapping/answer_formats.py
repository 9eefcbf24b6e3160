"""Answers of a localizer as the files that SLAM and reconstruction read, written row by row."""

from __future__ import annotations

import contextlib
import csv
import io
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from everplace.files import whole_file
from everplace.mapping.map_answer import MapAnswer

__all__ = ["COLUMNS", "FORMATS", "AnswerFile", "AnswerFormat", "answer_file"]

COLUMNS = ("frame", "time", "place", "drive", "database_frame", "score", "probability", "off_map")


class AnswerFormat(NamedTuple):
    """A format.

    Attributes:
        head: What stands first.
        row: Text of one frame, of its number in the drive, its name (a file's stem, or its number in a video) and the
            answer; it may be empty.
    """

    head: str
    row: Callable[[int, str, MapAnswer], str]


class AnswerFile:
    """A file that grows by whole rows, so that memory does not."""

    def __init__(self, file: BinaryIO, form: AnswerFormat) -> None:
        """Begins with the head of a format."""
        self._file, self._form = file, form
        self._end = file.write(_encoded(form.head))

    def add(self, number: int, frame: str, answer: MapAnswer) -> None:
        """Writes an answer.

        Args:
            number: Of the frame in its drive, from 0, whether the frames before it are written or not.
            frame: Its name.
            answer: What the map says of it.
        """
        text = _encoded(self._form.row(number, frame, answer))
        self._file.write(text)
        self._end += len(text)

    def finish(self) -> None:
        """Cuts off what Ctrl-C left of a row."""
        self._file.truncate(self._end)


@contextlib.contextmanager
def answer_file(path: Path, form: AnswerFormat) -> Iterator[AnswerFile]:
    """Gives a file to add answers to, which appears whole in the end (see `everplace.files.whole_file`).

    Args:
        path: Where; `everplace.files.STANDARD_OUTPUT` is printed in the end.
        form: One of `FORMATS`.

    Raises:
        StorageError: The disk is full or the place cannot be written to.
    """
    with whole_file(path) as temporary, temporary.open("wb") as file:
        answers = AnswerFile(file, form)
        yield answers
        answers.finish()


def _csv_text(cells: list[object]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()


def _csv_row(_: int, frame: str, answer: MapAnswer) -> str:
    """One row a frame, with the columns `COLUMNS`: also loop closures for any SLAM."""
    time = "" if answer.time is None else f"{answer.time:.6f}"
    numbers = [f"{number:.6g}" for number in (answer.score, answer.probability, answer.off_map)]
    return _csv_text([frame, time, answer.place, answer.drive, answer.database_frame, *numbers])


def _tum_row(number: int, _: str, answer: MapAnswer) -> str:
    """A trajectory in TUM's format: `time x y z qx qy qz qw`, of the frames whose place has a pose.

    Where a frame has no time, its number in the drive stands for it.
    """
    pose = answer.pose
    if pose is None:
        return ""
    time = number if answer.time is None else answer.time
    half = pose.heading / 2
    return f"{time:.6f} {pose.x:.6f} {pose.y:.6f} 0 0 0 {math.sin(half):.9f} {math.cos(half):.9f}\n"


def _g2o_row(number: int, _: str, answer: MapAnswer) -> str:
    """Loop closures in g2o's format: a fixed vertex for each place of the map, and an edge to each frame that is there.

    Vertex 2k is the pose of the place of frame k, 2k + 1 the frame. An edge says that the two are at the same place,
    with an information that grows with the odds of the match.
    """
    pose = answer.pose
    if pose is None:
        return ""
    where = f"{pose.x:.6f} {pose.y:.6f} {pose.heading:.9f}"
    odds = answer.probability / max(1 - answer.probability, 1e-6)
    place, seen = 2 * number, 2 * number + 1
    return (
        f"VERTEX_SE2 {place} {where}\nFIX {place}\nVERTEX_SE2 {seen} {where}\n"
        f"EDGE_SE2 {place} {seen} 0 0 0 {odds:.6g} 0 0 {odds:.6g} 0 {odds:.6g}\n"
    )


def _hloc_pairs_row(_: int, frame: str, answer: MapAnswer) -> str:
    """Pairs of image names for hloc: the frame, and the frame of the map."""
    return f"{frame} {answer.drive}/{answer.database_frame}\n"


def _encoded(text: str) -> bytes:
    """UTF-8; what of a file name is not is escaped."""
    return text.encode("utf-8", "backslashreplace")


FORMATS = {
    "csv": AnswerFormat(_csv_text(list(COLUMNS)), _csv_row),
    "tum": AnswerFormat("", _tum_row),
    "g2o": AnswerFormat("", _g2o_row),
    "hloc-pairs": AnswerFormat("", _hloc_pairs_row),
}
"""By the names of `everplace localize --format`."""
