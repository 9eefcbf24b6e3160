"""Where on the route a whole traverse went, looking back: forward-backward smoothing and the best path.

Both are exact for `RouteModel` and keep about 3√M rows of states in memory, or 64 MB of them where that is more: the
first row of every segment is kept on the way forward, and the rows between are computed again on the way back.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.sequences.belief import Belief, Course
from everplace.sequences.evidence import repeat_likelihoods
from everplace.sequences.frame_change import DriveEvidence
from everplace.sequences.route_filter import Answer, answer, log_odds
from everplace.sequences.route_model import GAITS, RouteModel, checked_scores

__all__ = ["best_path", "smooth_odds", "smooth_route"]

_MEMORY = 64 << 20
"""Bytes of states and ratios that a segment may take however few its frames are."""


def smooth_route(S: NDArray[Any], model: RouteModel | None = None, *, reach: int = 1) -> list[Answer]:
    """Answers every frame from the whole traverse, the frames after it included (forward-backward algorithm).

    Args:
        S: M×N scores; rows and columns in the order of travel; NaN: none.
        model: The assumptions; None: the defaults.
        reach: Neighbours on either side that `Answer.probability` counts as the same place.

    Returns:
        M answers; the last is that of `RouteFilter`.

    Raises:
        DescriptorsError: S is no matrix of numbers.
    """
    S = checked_scores(S)
    model = RouteModel() if model is None else model
    return [answer(on, model, reach) for on, _ in _smoothed(S, model)][::-1]


def smooth_odds(S: NDArray[Any], model: RouteModel | None = None) -> NDArray[np.float32]:
    """Scores every place for every frame from the whole traverse, as `filter_windows` does from the last frames.

    Args:
        S: M×N scores; rows and columns in the order of travel; NaN: none.
        model: The assumptions; None: the defaults.

    Returns:
        M×N log-odds of what every place is worth as an answer.

    Raises:
        DescriptorsError: S is no matrix of numbers.
    """
    S = checked_scores(S)
    model = RouteModel() if model is None else model
    odds = np.empty(S.shape, np.float32)
    for frame, (on, off) in zip(range(len(S) - 1, -1, -1), _smoothed(S, model), strict=True):
        odds[frame] = log_odds(Belief(on[None, None], np.array([off])), model)[0]
    return odds


def _smoothed(S: NDArray[Any], model: RouteModel) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Yields N probabilities of the places, and that of being off the map, for every frame, the last first."""
    drive, places = _Drive(S, model), S.shape[1]
    exits = model.exits(places)
    kept = [Course.begin(drive.ratios(0), model)]
    edges = _segments(*S.shape)
    for start, end in pairwise(edges):
        kept.append(_forward(drive, start, end + 1, kept[-1])[-1])
    later = _Later(np.ones((len(GAITS), places)), 1.0)
    standing = later
    for start, end in reversed([*pairwise([*edges, len(S)])]):
        courses = _forward(drive, start, end, kept.pop())
        for frame in range(end - 1, start - 1, -1):
            if frame + 1 < len(S):
                later, standing = _look_back(drive, frame + 1, later, standing, exits)
            course = courses[frame - start]
            if course.repeats is None:
                on, off = later.weigh(course.belief)
            else:
                ways = later.weigh(course.repeats.going), standing.weigh(course.repeats.standing)
                on, off = ways[0][0] + ways[1][0], ways[0][1] + ways[1][1]
            total = float(on.sum() + off)
            yield on / total, float(off) / total


def best_path(S: NDArray[Any], model: RouteModel | None = None) -> NDArray[np.int64]:
    """Finds the most probable path of a whole traverse (Viterbi algorithm).

    Args:
        S: M×N scores; rows and columns in the order of travel; NaN: none.
        model: The assumptions; None: the defaults.

    Returns:
        M places, indices into the database; -1: not on the map.

    Raises:
        DescriptorsError: S is no matrix of numbers.
    """
    S = checked_scores(S)
    model = RouteModel() if model is None else model
    drive, states = _Drive(S, model), len(GAITS) * S.shape[1] + 1
    on = np.broadcast_to(model.start * model.anywhere(S.shape[1]), (len(GAITS), S.shape[1]))
    begun = np.log(np.append(on, 1 - model.start)) + _log_states(drive.ratios(0))
    kept = [np.append(begun, np.full(states, -np.inf))]
    edges = _segments(*S.shape)
    for start, end in pairwise(edges):
        kept.append(_best_steps(drive, start, end + 1, kept[-1])[0])
    found = np.empty(len(S), np.int64)
    for start, end in reversed([*pairwise([*edges, len(S)])]):
        # One frame into the next segment, to come from the state found there.
        best, came_from = _best_steps(drive, start, min(end + 1, len(S)), kept.pop())
        if end == len(S):
            found[-1] = best.argmax()
        for frame in range(min(end, len(S) - 1), start, -1):
            found[frame - 1] = came_from[frame - start - 1, found[frame]]
    found %= states
    found[found == states - 1] = -1
    return np.where(found < 0, found, found % S.shape[1])


class _Drive:
    """The frames of a traverse as the recursions need them, at random access."""

    def __init__(self, S: NDArray[Any], model: RouteModel) -> None:
        self.model = model
        self._evidence = DriveEvidence(S, model)
        self._view = np.arange(len(self._evidence.new)).repeat(self._evidence.shown)
        # A segment is gone through forwards and then backwards, by the same ratios.
        self._kept: OrderedDict[int, NDArray[np.float64]] = OrderedDict()
        self._most = _segment(*S.shape) + 2

    def ratios(self, frame: int) -> NDArray[np.float64]:
        """N: what the last new frame says of the places."""
        view = int(self._view[frame])
        if view not in self._kept:
            self._kept[view] = self._evidence.after_others(view, view + 1)[0]
            if len(self._kept) > self._most:
                self._kept.popitem(last=False)
        return self._kept[view]

    def is_new(self, frame: int) -> bool:
        return frame == 0 or bool(self._view[frame] != self._view[frame - 1])


def _segment(frames: int, places: int) -> int:
    """Frames of a segment: √M, or more where their states fit into a small part of memory."""
    return max(1, int(np.sqrt(frames)), _MEMORY // (8 * (len(GAITS) + 1) * places))


def _segments(frames: int, places: int) -> list[int]:
    """The first frames of all segments."""
    return list(range(0, frames, _segment(frames, places)))


def _forward(drive: _Drive, start: int, end: int, course: Course) -> list[Course]:
    """The given course at frame `start`, and at each frame until `end`."""
    courses = [course]
    for frame in range(start + 1, end):
        course = course.copy()
        course.follow(drive.ratios(frame), drive.is_new(frame), drive.model)
        courses.append(course)
    return courses


@dataclass(frozen=True, eq=False)
class _Later:
    """How well each state explains the frames after it, up to a factor: 3×N, and off the map."""

    on: NDArray[np.float64]
    off: float

    def weigh(self, belief: Belief) -> tuple[NDArray[np.float64], float]:
        """N: every place, and off the map, with all frames known, up to the same factor."""
        return (belief.on[0] * self.on).sum(axis=0), float(belief.off[0]) * self.off

    def before_motion(self, model: RouteModel, exits: NDArray[np.float64]) -> _Later:
        """The same a frame earlier."""
        places = self.on.shape[1]
        anywhere = float((self.on * model.anywhere(places)).sum())
        ahead = np.zeros_like(self.on)
        for gait, way in enumerate(GAITS):
            for offset, probability in enumerate(model.moves(gait)[:places]):
                here, there = slice(0, places - offset), slice(offset, places)
                origin, target = (here, there) if way > 0 else (there, here)
                ahead[gait, origin] += probability * self.on[gait, target]
        on = model.stay * (model.changes @ ahead) + model.jump * anywhere + exits * self.off
        return _Later(on, model.enter * anywhere + (1 - model.enter) * self.off)


def _look_back(
    drive: _Drive, frame: int, going: _Later, standing: _Later, exits: NDArray[np.float64]
) -> tuple[_Later, _Later]:
    """The backward recursion from one frame to the one before it, for a robot that goes on and one that stands.

    Where the earlier frame is new, no robot stands yet, and the first is that of all.
    """
    model = drive.model
    if drive.is_new(frame):
        before = _Later(going.on * drive.ratios(frame), going.off).before_motion(model, exits)
        largest = max(float(before.on.max()), before.off)
        before = _Later(before.on / largest, before.off / largest)
        return before, before
    before = going.before_motion(model, exits)
    if drive.is_new(frame - 1):
        stands, goes = repeat_likelihoods(drive.ratios(frame), model)
        before = _Later(goes * before.on + stands * standing.on, model.repeats * standing.off)
    return before, standing


def _log_states(values: NDArray[np.float64], off: float = 1.0) -> NDArray[np.float64]:
    """3N+1: the logarithms of N or 3×N values, and of that off the map; 0 has none."""
    on = np.broadcast_to(values, (len(GAITS), values.shape[-1]))
    with np.errstate(divide="ignore"):
        logs: NDArray[np.float64] = np.log(np.append(on, off))
    return logs


def _best_steps(
    drive: _Drive, start: int, end: int, best: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Goes on from the log-probabilities of the best paths at frame `start` to each of 3N+1 states, going and standing.

    Returns:
        Those at the last frame before `end`, 2(3N+1), and for every frame after `start` the states that the best paths
        to these came from.
    """
    states = len(best) // 2
    came_from = np.empty((end - start - 1, 2 * states), np.int32)
    here = np.arange(states, dtype=np.int32)
    for frame in range(start + 1, end):
        going, standing = best[:states], best[states:]
        origins = here
        if drive.is_new(frame):
            origins = np.where(standing > going, here + states, here).astype(np.int32)
            going, standing = np.maximum(going, standing), np.full(states, -np.inf)
        elif drive.is_new(frame - 1):
            stands, goes = repeat_likelihoods(drive.ratios(frame), drive.model)
            standing = going + _log_states(stands, drive.model.repeats)
            going = going + _log_states(goes, 0.0)
        stood = here if drive.is_new(frame - 1) else here + states
        going, source = _best_motion(going, drive.model)
        if drive.is_new(frame):
            going += _log_states(drive.ratios(frame))
        came_from[frame - start - 1] = np.append(origins[source], stood)
        best = np.append(going, standing)
        best -= best.max()
    return best, came_from


def _best_motion(best: NDArray[np.float64], model: RouteModel) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """The log-probability of the best path to each of 3N+1 states after a motion, and the state before it."""
    nowhere = len(best) - 1
    places = nowhere // len(GAITS)
    exits, anywhere = model.exits(places).ravel(), model.anywhere(places).repeat(places)
    origin = int(best[:-1].argmax())
    begun, source_state = max((best[origin] + np.log(model.jump), origin), (best[-1] + np.log(model.enter), nowhere))
    after = np.append(begun + np.log(anywhere), 0.0)
    source = np.full(nowhere + 1, source_state, np.int32)
    for to, way in enumerate(GAITS):
        for start in range(len(GAITS)):
            for offset, probability in enumerate(model.moves(to)[:places]):
                # A step along the route can also have been a jump that ended there.
                step = model.stay * model.changes[start, to] * probability + model.jump * anywhere[to * places]
                here, there = slice(0, places - offset), slice(offset, places)
                begin, target = (here, there) if way > 0 else (there, here)
                _keep_better(
                    after[to * places :][target],
                    source[to * places :][target],
                    best[start * places :][begin] + np.log(step),
                    start * places + begin.start,
                )
    leaving = best[:-1] + np.log(exits)
    exit_from = int(leaving.argmax())
    after[-1], source[-1] = max((leaving[exit_from], exit_from), (best[-1] + np.log(1 - model.enter), nowhere))
    return after, source


def _keep_better(after: NDArray[np.float64], source: NDArray[np.int32], value: NDArray[np.float64], first: int) -> None:
    """Replaces what is worse by the value and its origin, `first` and the following states."""
    better = value > after
    after[better] = value[better]
    source[better] = first + np.flatnonzero(better)
