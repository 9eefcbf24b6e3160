"""The last frames of a drive on a map, taken together.

A standing robot sees one view again and again, with its chance matches. Were each of these frames heard, ten of them
would push all others out of the window, and say ten times what one has said. So a frame that shows the last view again
counts as one with it, and of one that shows it in part only the rest is heard: as in
`everplace.sequences.route_filter.filter_windows`, whose parts these are.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import MapError
from everplace.mapping.calibration import Calibration, likelihood_ratios_of
from everplace.sequences.belief import Belief, Course, Repeats
from everplace.sequences.evidence import likelihood_ratios, standardised
from everplace.sequences.frame_change import View, change_in_steps
from everplace.sequences.route_model import GAITS, RouteModel

__all__ = ["MAP_MODEL", "SEQUENCE", "FrameWindow", "state_width"]

SEQUENCE = 10
"""Frames that an answer rests on, unless somebody asks for another number."""

MAP_MODEL = RouteModel(leave=0.02, repeat=0.05)
"""What is assumed of a drive on a map. It leaves the map more often than in a comparison, and the noise of its camera
may change a view more; chosen on rendered worlds and on Nordland's places 0 to 1,019."""

_ROUNDING = 1e-6
"""Of probabilities that sum to 1."""


def state_width(places: int) -> int:
    """How many numbers `FrameWindow.state` gives of each view on a map of P places: 7P + 3."""
    return places + 1 + 2 * (len(GAITS) * places + 1)


class FrameWindow:
    """Where the newest frame was taken, given the last L views of the drive and nothing before.

    A frame costs time in proportion to L and to the number of places, also where it is the 500th of one view.
    """

    def __init__(self, length: int, calibration: Calibration, model: RouteModel = MAP_MODEL) -> None:
        """Begins a drive.

        Args:
            length: L, at least 1.
            calibration: How scores are to be read.
            model: What is assumed of the drive.
        """
        self._calibration, self._model = calibration, model
        self._views: deque[_View] = deque(maxlen=length)

    def add(self, scores: NDArray[Any]) -> tuple[NDArray[np.float64], float]:
        """Takes the next frame.

        Args:
            scores: (P,) cosines with the places, higher = more alike; NaN: none.

        Returns:
            (P,) probability of every place, and that of being off the map; together they sum to 1.
        """
        shown = likelihood_ratios(standardised(scores), self._model)
        view = View.of(shown)
        # That two frames show nothing does not mean that the robot stands.
        known = scores[np.isfinite(scores)]
        blind = bool((known == known[:1]).all())
        if self._views and not blind and change_in_steps(self._views[-1].view, view) < self._model.repeat:
            self._go_on()
        else:
            self._see(np.asarray(scores, np.float64), shown, view)
        belief = self._views[0].course.belief
        return belief.places[0], float(belief.off[0])

    def state(self) -> list[NDArray[np.float64]]:
        """Of each view `state_width(P)` numbers: its scores, how many frames showed it, and the belief since it."""
        return [np.concatenate([one.scores, [one.frames], _numbers(one.course)]) for one in self._views]

    def restore(self, state: NDArray[np.float64]) -> None:
        """Goes on where `state` was taken, by a window of any length.

        Args:
            state: Rows of `state_width(P)` numbers.

        Raises:
            MapError: They are not those of a state.
        """
        places = (state.shape[1] - 3) // 7
        scores, frames, beliefs = state[:, :places], state[:, places], state[:, places + 1 :]
        if not (
            not np.isinf(scores).any()
            and np.isfinite(frames).all()
            and ((frames >= 1) & (frames % 1 == 0)).all()
            and ((beliefs >= 0) & (beliefs <= 1)).all()
            and np.allclose(beliefs.sum(axis=1), 1, atol=_ROUNDING)
        ):
            raise MapError(
                "this state is damaged: it holds numbers that are no scores, probabilities or counts of frames; "
                "begin anew"
            )
        repeats = len(frames) > 0 and frames[-1] > 1
        self._views.clear()
        for row, count, numbers in zip(scores, frames.tolist(), beliefs, strict=True):
            shown = likelihood_ratios(standardised(row), self._model)
            course = _course(numbers, repeats=repeats)
            self._views.append(_View(row, shown, View.of(shown), course, int(count)))

    def _see(self, scores: NDArray[np.float64], shown: NDArray[np.float64], view: View) -> None:
        """Takes a frame that shows something new."""
        if len(self._views) == self._views.maxlen:
            self._views.popleft()
        ratios = likelihood_ratios_of(scores, self._calibration)
        for one in self._views:
            one.course.follow(ratios, True, self._model)
        self._views.append(_View(scores, shown, view, Course.begin(ratios, self._model)))

    def _go_on(self) -> None:
        """Takes a frame that shows the last view again; what that shows of its place, the route model says."""
        self._views[-1].frames += 1
        for one in self._views:
            one.course.follow(self._views[-1].shown, False, self._model)


@dataclass(slots=True, eq=False)
class _View:
    """A view of the window.

    Attributes:
        scores: (P,) of its first frame.
        shown: (P,) what they say of the places, by the route model.
        view: The same, to be compared with other frames.
        course: Of a robot that knows nothing before this view.
        frames: How many frames showed it.
    """

    scores: NDArray[np.float64]
    shown: NDArray[np.float64]
    view: View
    course: Course
    frames: int = 1


def _numbers(course: Course) -> NDArray[np.float64]:
    """The probabilities of a course that stands, and those of one that goes on: all that sums to its belief."""
    if course.repeats is None:
        standing, going = course.belief, Belief(np.zeros_like(course.belief.on), np.zeros_like(course.belief.off))
    else:
        standing, going = course.repeats.standing, course.repeats.going
    return np.concatenate([standing.on.ravel(), standing.off, going.on.ravel(), going.off])


def _course(numbers: NDArray[np.float64], *, repeats: bool) -> Course:
    """What `_numbers` gave; whether the last view came again."""
    standing, going = (
        Belief(half[:-1].reshape(1, len(GAITS), -1).copy(), half[-1:].copy()) for half in np.split(numbers, 2)
    )
    if not repeats:
        return Course(standing)
    both = Repeats(standing, going)
    return Course(both.either(), both)
