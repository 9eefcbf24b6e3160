"""Answers of a localizer as a recording for the Rerun viewer (extra `rerun`): what it saw, matched and believed."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import MissingExtraError
from everplace.files import write_bytes
from everplace.images.decoding import resize_image
from everplace.mapping.frame_stream import SeenFrame
from everplace.mapping.localizer import Localizer
from everplace.mapping.map_answer import MapAnswer, Observation

__all__ = ["BARS", "RerunRecording", "require_rerun", "rerun_recording"]

BARS = 512
"""The belief along the route has at most so many bars; of a longer route each is the greatest of several places."""
_QUALITY, _WIDTH = 85, 640
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
    """Gives a recording to add answers to; the file is written in the end.

    Until then memory holds it, at most some 100 KB a frame: the SDK's own writer can hang on a full disk.

    Args:
        path: The `.rrd` file.
        localizer: What answers.

    Raises:
        MissingExtraError: The Rerun SDK is not installed.
        StorageError: The disk is full or the place cannot be written to.
    """
    rerun = require_rerun()
    stream = rerun.RecordingStream("everplace")
    held = stream.memory_recording()
    stream.send_blueprint(_layout(), make_active=False)
    yield RerunRecording(stream, localizer)
    write_bytes(path, held.drain_as_bytes())


class RerunRecording:
    """What is shown of each frame, on the timelines `frame` and, where times are known, `time`.

    Entities: `query/image`, `match/image` (the map's thumbnail), `match/text`, `answer/probability`, `answer/off_map`,
    `condition/NAME`, `belief/places` (a bar a place), and, where the map has poses, `route/DRIVE` and `route/match`.
    """

    def __init__(self, stream: Any, localizer: Localizer) -> None:
        """Shows the map's route.

        Args:
            stream: A `rerun.RecordingStream`.
            localizer: What answers.
        """
        self._rerun, self._stream, self._localizer = require_rerun(), stream, localizer
        table = localizer.map.frames("stem", "x", "y", "thumbnail")
        drives, stems = table["drive"].to_pylist(), table["stem"].to_pylist()
        self._thumbnails = table["thumbnail"]
        self._rows = {name: row for row, name in enumerate(zip(drives, stems, strict=True))}
        self._first: float | None = None
        self._number = 0
        self._arrow = 0.0
        self._show_route(np.array(drives), np.stack([np.asarray(table[name]) for name in ("x", "y")], axis=1))

    def add(self, frame: SeenFrame, seen: Observation) -> None:
        """Shows a frame and what the localizer answered."""
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
