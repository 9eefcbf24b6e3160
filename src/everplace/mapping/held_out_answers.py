"""Answers to frames of the map itself that were held out of what it learnt, and how right they were."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.mapping.calibration import Calibration
from everplace.mapping.frame_window import MAP_MODEL, SEQUENCE, FrameWindow
from everplace.mapping.reliability import STRETCH
from everplace.route.selection import spread

__all__ = ["HeldOutAnswers", "follows_none", "sequence_answers", "some_stretches", "stretches"]

_REACH = 1
_OFF_EVERY = 8
_GUARD = 3
_PROBABILITY, _RIGHT, _ON_MAP = "held_out.probability", "held_out.right", "held_out.on_map"


@dataclass(frozen=True, eq=False)
class HeldOutAnswers:
    """What the map answered, each time from the last 10 frames.

    Attributes:
        probability: (M,) float32, of the best match.
        right: (M,) whether it was right.
        on_map: (M,) whether the map showed the frame's place. The places of some stretches are hidden, as on a detour:
            what is found there is wrong, and nothing can be found.
    """

    probability: NDArray[np.float32]
    right: NDArray[np.bool_]
    on_map: NDArray[np.bool_]

    @classmethod
    def none(cls) -> HeldOutAnswers:
        """Of a map that holds nothing out."""
        return cls(np.empty(0, np.float32), np.empty(0, np.bool_), np.empty(0, np.bool_))

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> HeldOutAnswers:
        """What `to_arrays` gave.

        A map that an earlier everplace wrote does not say which frames were on the map: all count as such, until it
        learns again.
        """
        right = arrays[_RIGHT].astype(np.bool_)
        on_map = arrays[_ON_MAP].astype(np.bool_) if _ON_MAP in arrays else np.ones(len(right), np.bool_)
        return cls(arrays[_PROBABILITY], right, on_map)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays by name, as they stand in the map."""
        return {
            _PROBABILITY: self.probability,
            _RIGHT: self.right.astype(np.uint8),
            _ON_MAP: self.on_map.astype(np.uint8),
        }


def follows_none(rows: NDArray[np.int64], drives: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each frame does not follow the one before it: the first of all, of a drive, and after a gap.

    Args:
        rows: (M,) of the map, ascending.
        drives: (M,) number of each frame's drive.

    Returns:
        (M,).
    """
    apart: NDArray[np.bool_] = (np.diff(rows, prepend=rows[:1]) > STRETCH) | (np.diff(drives, prepend=drives[:1]) != 0)
    apart[:1] = True
    return apart


def stretches(apart: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The number of each frame's stretch: at most 24 frames in a row, none before a break and behind it.

    Args:
        apart: (M,) of `follows_none`.

    Returns:
        (M,), from 0 on, ascending.
    """
    frames = np.arange(len(apart))
    begun = np.maximum.accumulate(np.where(apart, frames, 0))
    return np.cumsum((frames - begun) % STRETCH == 0) - 1


def some_stretches(numbers: NDArray[np.int64], most: int) -> NDArray[np.bool_]:
    """Which frames are looked at: all, or whole stretches, evenly spread, of about `most` frames.

    Args:
        numbers: (M,) of `stretches`.
        most: Frames.

    Returns:
        (M,).
    """
    if len(numbers) <= most:
        return np.ones(len(numbers), np.bool_)
    of = int(numbers[-1]) + 1
    return np.isin(numbers, spread(of, max(1, of * most // len(numbers))))


def sequence_answers(
    scores: NDArray[np.float32],
    true: NDArray[np.int64],
    stretch: NDArray[np.int64],
    apart: NDArray[np.bool_],
    calibration: Calibration,
) -> HeldOutAnswers:
    """Answers every frame from the last 10. Every eighth stretch is off the map: what it shows is hidden.

    Args:
        scores: M×P.
        true: (M,) columns.
        stretch: (M,) number of each frame's stretch.
        apart: (M,) of `follows_none`.
        calibration: How the scores are read.
    """
    probability, right = np.empty(len(scores), np.float32), np.empty(len(scores), np.bool_)
    on_map = stretch % _OFF_EVERY != _OFF_EVERY // 2
    hidden = {int(number): _around(true[stretch == number], scores.shape[1]) for number in np.unique(stretch[~on_map])}
    window = FrameWindow(SEQUENCE, calibration)
    for query, scored in enumerate(scores):
        if apart[query]:
            window = FrameWindow(SEQUENCE, calibration)
        row = scored if on_map[query] else np.where(hidden[int(stretch[query])], np.nan, scored)
        posterior, _ = window.add(row)
        place = int(MAP_MODEL.worth(posterior[None])[0].argmax())
        probability[query] = posterior[max(place - _REACH, 0) : place + _REACH + 1].sum()
        right[query] = on_map[query] and abs(place - int(true[query])) <= _REACH
    return HeldOutAnswers(probability, right, on_map)


def _around(true: NDArray[np.int64], places: int) -> NDArray[np.bool_]:
    """(P,) whether a place is one of these, or next to one."""
    near = np.zeros(places, np.bool_)
    for place in np.unique(true).tolist():
        near[max(place - _GUARD, 0) : place + _GUARD + 1] = True
    return near
