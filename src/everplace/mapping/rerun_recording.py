"""Answers of a localizer as a recording for the Rerun viewer (extra `rerun`): what it saw, matched and believed."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from everplace.errors import MissingExtraError
from everplace.files import whole_file
from everplace.images.decoding import resize_image
from everplace.mapping.frame_stream import SeenFrame
from everplace.mapping.localizer import Localizer
from everplace.mapping.map_answer import MapAnswer, Observation

__all__ = ["BARS", "RerunRecording", "require_rerun", "rerun_recording"]

BARS = 512
"""The belief along the route has at most so many bars; of a longer route each is the greatest of several places."""
_QUALITY, _WIDTH = 85, 640
_COPIED = 1 << 20
_ARROW, _POINT = 0.05, 7.0
"""The arrow is as long as this share of the route's extent; the point has so many pixels."""


def require_rerun() -> Any:
    """Imports the Rerun SDK.

    Raises:
        MissingExtraError: It is not installed.
    """
    try:
        import rerun
    except ImportError:
        raise MissingExtraError("a recording for the Rerun viewer", "rerun") from None
    return rerun


@contextlib.contextmanager
def rerun_recording(path: Path, localizer: Localizer) -> Iterator[RerunRecording]:
    """Gives a recording to add answers to, which is written meanwhile and appears whole in the end.

    Memory holds the index that stands at the file's end, some 0.3 KB for each of its parts, of which there are at most
    some 60 a second.

    Args:
        path: The `.rrd` file.
        localizer: What answers.

    Raises:
        MissingExtraError: The Rerun SDK is not installed.
        StorageError: The disk is full or the place cannot be written to.
    """
    stream = require_rerun().RecordingStream("everplace")
    with whole_file(path) as temporary, _saved(stream, temporary) as check:
        stream.send_blueprint(_layout(), make_active=False)
        yield RerunRecording(stream, localizer, check)


@contextlib.contextmanager
def _saved(stream: Any, path: Path) -> Iterator[Callable[[], None]]:
    """Saves what a stream is given, until the end of the block; gives what raises the error of writing.

    Where the disk is full the SDK waits for ever, so it writes into a pipe, and what comes out is written here.

    Args:
        stream: A `rerun.RecordingStream`.
        path: The file.

    Raises:
        OSError: Writing failed.
    """
    if sys.platform == "win32":  # which has no such pipes
        stream.save(path)
        yield lambda: None
        stream.disconnect()
        return
    with tempfile.TemporaryDirectory() as directory, path.open("wb") as file:
        pipe = Path(directory, "recording.rrd")
        os.mkfifo(pipe)
        end = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)  # which waits for no writer
        os.set_blocking(end, True)
        stream.save(pipe)
        copy = _Copy(end, file)
        copy.start()
        try:
            yield copy.check
        finally:
            stream.disconnect()
            copy.join()
        copy.check()


class _Copy(threading.Thread):
    """Copies what comes out of a pipe to a file; goes on reading after an error, so that the writer does not wait."""

    def __init__(self, pipe: int, file: BinaryIO) -> None:
        super().__init__(daemon=True)
        self._pipe, self._file = pipe, file
        self._error: OSError | None = None

    def run(self) -> None:
        with os.fdopen(self._pipe, "rb", buffering=0) as pipe:
            while data := pipe.read(_COPIED):
                if self._error is None:
                    try:
                        self._file.write(data)
                        self._file.flush()
                    except OSError as error:
                        self._error = error

    def check(self) -> None:
        """Raises the error that writing ended with."""
        if self._error is not None:
            raise self._error


class RerunRecording:
    """What is shown of each frame, on the timelines `frame` and, where times are known, `time`.

    Entities: `query/image`, `match/image` (the map's thumbnail), `match/text`, `answer/probability`, `answer/off_map`,
    `condition/NAME`, `belief/places` (a bar a place), and, where the map has poses, `route/DRIVE` and `route/match`.
    """

    def __init__(self, stream: Any, localizer: Localizer, check: Callable[[], None]) -> None:
        """Shows the map's route.

        Args:
            stream: A `rerun.RecordingStream`.
            localizer: What answers.
            check: Raises the error of writing the file, if there is one.
        """
        self._rerun, self._stream, self._localizer, self._check = require_rerun(), stream, localizer, check
        table = localizer.map.frames("stem", "x", "y", "thumbnail")
        drives, stems = table["drive"].to_pylist(), table["stem"].to_pylist()
        self._thumbnails = table["thumbnail"]
        self._rows = {name: row for row, name in enumerate(zip(drives, stems, strict=True))}
        self._first: float | None = None
        self._number = 0
        self._arrow = 0.0
        self._show_route(np.array(drives), np.stack([np.asarray(table[name]) for name in ("x", "y")], axis=1))

    def add(self, frame: SeenFrame, seen: Observation) -> None:
        """Shows a frame and what the localizer answered.

        Raises:
            OSError: What was added before cannot be written.
        """
        self._check()
        answer = seen.answer
        rerun, stream = self._rerun, self._stream
        stream.set_time("frame", sequence=self._number)
        self._number += 1
        if frame.seconds is not None:
            self._first = frame.seconds if self._first is None else self._first
            stream.set_time("time", duration=frame.seconds - self._first)
        stream.log("query/image", rerun.Image(_shown(frame.image)).compress(jpeg_quality=_QUALITY))
        thumbnail = self._thumbnails[self._rows[answer.drive, answer.database_frame]].as_py()
        stream.log("match/image", rerun.EncodedImage(contents=thumbnail, media_type="image/jpeg"))
        stream.log("match/text", rerun.TextDocument(_sentences(frame.stem, answer)))
        stream.log("answer/probability", rerun.Scalars(answer.probability))
        stream.log("answer/off_map", rerun.Scalars(answer.off_map))
        for name, probability in answer.condition.items():
            stream.log(["condition", name], rerun.Scalars(probability))
        places, belief = _bars(self._localizer.places, seen.belief)
        stream.log("belief/places", rerun.BarChart(belief, abscissa=places))
        if answer.pose is None:
            stream.log("route/match", rerun.Clear(recursive=False))
        else:
            where, heading = [answer.pose.x, answer.pose.y, 0], answer.pose.heading
            ahead = [self._arrow * np.cos(heading), self._arrow * np.sin(heading), 0]
            size = rerun.Radius.ui_points(_POINT)
            stream.log(
                "route/match", rerun.Points3D([where], radii=size), rerun.Arrows3D(origins=[where], vectors=[ahead])
            )

    def _show_route(self, drives: NDArray[np.str_], positions: NDArray[np.float64]) -> None:
        """Shows where the drives of the map went, as far as that is known."""
        self._stream.log("route", self._rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        known = ~np.isnan(positions).any(axis=1)
        if known.any():
            self._arrow = _ARROW * float(np.ptp(positions[known], axis=0).max())
        for name in self._localizer.map.drives:
            of_drive = positions[(drives == name) & known]
            if len(of_drive):
                line = np.column_stack([of_drive, np.zeros(len(of_drive))])
                self._stream.log(["route", name], self._rerun.LineStrips3D([line]), static=True)


def _shown(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The image, not wider than a viewer shows it."""
    height, width = image.shape[:2]
    return image if width <= _WIDTH else resize_image(image, (max(1, round(height * _WIDTH / width)), _WIDTH))


def _sentences(stem: str, answer: MapAnswer) -> str:
    lines = [
        f"Frame {stem}: place {answer.place} with {answer.probability:.1%}, not on the map with {answer.off_map:.1%}",
        f"Most like {answer.database_frame} of {answer.drive}, cosine {answer.score:.3f}",
    ]
    if answer.unseen_condition:
        lines.append("A condition that the map has not seen")
    if answer.provisional:
        lines.append("Provisional: the map knows one drive only")
    return "\n\n".join(lines)


def _bars(places: NDArray[np.int64], belief: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """At most `BARS` places, in the order of travel, and the belief in each or in its neighbours up to the next."""
    starts = np.arange(0, len(places), -(-len(places) // BARS))
    return places[starts], np.maximum.reduceat(belief, starts).astype(np.float32)


def _layout() -> Any:
    """How the viewer shows it at first."""
    from rerun import blueprint

    return blueprint.Blueprint(
        blueprint.Vertical(
            blueprint.Horizontal(
                blueprint.Spatial2DView(origin="query/image", name="Query"),
                blueprint.Spatial2DView(origin="match/image", name="Match"),
                blueprint.Spatial3DView(origin="route", name="Route"),
            ),
            blueprint.Horizontal(
                blueprint.BarChartView(origin="belief", name="Belief along the route"),
                blueprint.TimeSeriesView(origin="answer", name="Match, and off the map"),
                blueprint.TimeSeriesView(origin="condition", name="Condition"),
                blueprint.TextDocumentView(origin="match/text", name="Answer"),
            ),
        ),
        collapse_panels=True,
    )
