"""Where on the route the robot is, from the frames so far: the forward recursion of `RouteModel`.

`RouteFilter` takes one frame after the other and remembers all; `filter_windows` answers every frame of a traverse
from the last L frames alone. Frames that merely repeat the last new one (`everplace.sequences.frame_change`) are not
counted among the L.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError, DescriptorsError
from everplace.sequences.belief import Belief, Course, Repeats
from everplace.sequences.evidence import likelihood_ratios, news, standardised
from everplace.sequences.frame_change import DriveEvidence, View, change_in_steps
from everplace.sequences.route_model import RouteModel, beside, checked_scores
from everplace.threads import usable_cores

__all__ = ["Answer", "RouteFilter", "answer", "filter_windows"]

_BLOCK = 1 << 16  # states handled at once: half a MiB, which stays in a core's cache


@dataclass(frozen=True, slots=True)
class Answer:
    """Where one frame was taken.

    Attributes:
        place: The place that is worth most as an answer (`RouteModel.worth`), an index into the database.
        probability: That the frame shows this place or one of its `reach` neighbours on either side, in [0, 1].
        on_map: Probability that the robot is on the map at all, in [0, 1].
    """

    place: int
    probability: float
    on_map: float

    @property
    def lost(self) -> bool:
        """Whether the robot is more probably not on the map."""
        return self.on_map < 0.5


@dataclass(slots=True, eq=False)
class _Seen:
    """The last new frame: its scores, what they say of the places, and the part of it that was new."""

    z: NDArray[np.float64]
    view: View
    ratios: NDArray[np.float64]


class RouteFilter:
    """Answers frame by frame, from all frames so far.

    Memory is that of a few numbers a place; a frame costs time in proportion to the number of places.
    """

    def __init__(self, places: int, model: RouteModel | None = None, *, reach: int = 1) -> None:
        """Starts anywhere on the map or off it.

        Args:
            places: N, the number of database frames, in the order of travel.
            model: The assumptions; None: the defaults.
            reach: Neighbours on either side that `Answer.probability` counts as the same place.

        Raises:
            ConfigError: There is no place, or `reach` is negative.
        """
        if places < 1 or reach < 0:
            raise ConfigError(
                f"a route of {places} places with a reach of {reach} is not possible; give 1 and 0 or more"
            )
        self.model = RouteModel() if model is None else model
        self.reach = reach
        self._places = places
        self._course: Course | None = None
        self._last: _Seen | None = None

    def update(self, scores: NDArray[Any]) -> Answer:
        """Takes the next frame.

        Args:
            scores: N scores of the frame against the database, higher = more alike; NaN: none.

        Returns:
            Where it was taken.

        Raises:
            DescriptorsError: There are not N scores.
        """
        if np.shape(scores) != (self._places,):
            raise DescriptorsError(
                f"a frame of scores of shape {np.shape(scores)} does not fit a map of {self._places} places"
            )
        z = standardised(scores)
        ratios = likelihood_ratios(z, self.model)
        view = View.of(ratios)
        if self._course is None or self._last is None:
            self._course = Course.begin(ratios, self.model)
            self._last = _Seen(z, view, ratios)
        else:
            change = change_in_steps(self._last.view, view)
            new = change >= self.model.repeat
            if new:
                fresh = news(z, self._last.z, np.array(change))
                self._last = _Seen(z, view, ratios if fresh is z else likelihood_ratios(fresh, self.model))
            self._course.follow(self._last.ratios, new, self.model)
        return answer(self.probabilities, self.model, self.reach)

    @property
    def probabilities(self) -> NDArray[np.float64]:
        """N: the probability of every place after the last frame; what is missing to 1 is "not on the map"."""
        belief = Belief.start(self.model, 1, self._places) if self._course is None else self._course.belief
        known: NDArray[np.float64] = belief.places[0]
        return known


def answer(probabilities: NDArray[np.float64], model: RouteModel, reach: int) -> Answer:
    """Reads an answer off the probabilities of the N places."""
    place = int(model.worth(probabilities).argmax())
    near = probabilities[max(place - reach, 0) : place + reach + 1].sum()
    return Answer(place, min(float(near), 1.0), min(float(probabilities.sum()), 1.0))


def filter_windows(S: NDArray[Any], length: int, model: RouteModel | None = None) -> NDArray[np.float32]:
    """Scores every place by the last L frames alone.

    Each query has a filter of its own that knows nothing before its L frames: fewer frames at the start. They are the
    frames i-L+1 to i, unless some show the last one again (`RouteModel.repeat`): these count as one with it, so that
    the window holds L different views. With L of at least M it is `RouteFilter`.

    Args:
        S: M×N scores; rows and columns in the order of travel; NaN: none.
        length: Number of frames L, at least 1.
        model: The assumptions; None: the defaults.

    Returns:
        M×N: log-odds log(w / (1 - w)) of w = p_j + `RouteModel.beside` (p_(j-1) + p_(j+1)), finite, where p_j = P(the
        robot is at place j | the last L frames).

    Raises:
        ConfigError: `length` is below 1.
        DescriptorsError: S is no matrix of numbers.
    """
    S = checked_scores(S, length)
    known = RouteModel() if model is None else model
    evidence = DriveEvidence(S, known)
    new, shown = evidence.new, evidence.shown
    out = np.empty(S.shape, np.float32)
    if length >= len(new):  # every window begins with the drive: one robot answers all frames
        course = Course.begin(evidence.alone(0), known)
        for view in range(len(new)):
            ratios = evidence.after_others(view, view + 1)[0]
            for frame in range(new[view], new[view] + shown[view]):
                if frame:
                    course.follow(ratios, frame == new[view], known)
                out[frame] = log_odds(course.belief, known)[0]
        return out
    size = max(1, _BLOCK // S.shape[1])

    def fill(start: int) -> None:
        """Answers the frames of up to `size` views, with a robot for each."""
        end = min(start + size, len(new))
        begin = max(start - length + 1, 0)
        after_others = evidence.after_others(begin, end)
        belief = Belief.start(known, end - start, S.shape[1])
        for view in range(begin, end):
            ratios = after_others[view - begin]
            due = max(view - start, 0)  # the robots before it have answered
            begun = min(view + length - 1 - start, end - start) if view else 0  # the others have seen nothing yet
            under_way = belief[due:begun]
            under_way.move(known)
            under_way.see(ratios)
            active = min(view + length - start, end - start)
            if begun < active:
                first = evidence.alone(view)
                belief[begun:active].see(first)
                ratios = np.vstack([*[ratios] * (begun - due), *[first] * (active - begun)])
            answers = view >= start
            if answers:
                out[new[view]] = log_odds(belief[due : due + 1], known)[0]
            if shown[view] > 1:
                robots = belief[due:active]
                repeats = Repeats.of(robots, ratios, known)
                for frame in range(new[view] + 1, new[view] + shown[view]):
                    repeats.go_on(known)
                    if answers:
                        out[frame] = log_odds(repeats[:1].either(), known)[0]
                either = repeats.either()
                robots.on[:], robots.off[:] = either.on, either.off

    with ThreadPoolExecutor(usable_cores(), "everplace-sequence") as pool:
        for _ in pool.map(fill, range(0, len(new), size)):
            pass
    return out


def log_odds(belief: Belief, model: RouteModel) -> NDArray[np.float64]:
    """Returns B×N log(w / (1 - w)) of what every place is worth as an answer (`RouteModel.worth`).

    1 - w is summed up from the other states, so that certainty keeps its digits.
    """
    p = belief.places
    rest = np.zeros_like(p)
    np.cumsum(p[:, :-2], axis=1, out=rest[:, 2:])
    rest[:, :-2] += np.cumsum(p[:, :1:-1], axis=1)[:, ::-1]
    rest += (1 - model.beside) * beside(p)
    rest += belief.off[:, None]
    odds: NDArray[np.float64] = np.log(model.worth(p)) - np.log(rest)
    return odds
