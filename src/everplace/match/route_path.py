"""Where on the route a whole traverse went, looking back: forward-backward smoothing and the best path.

Both are exact for `RouteModel` and keep about 2√M rows of states in memory: every √M-th row is kept on the way
forward, and the rows between are computed again on the way back.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.match.route_filter import Answer, Belief, answer
from everplace.match.route_model import RouteModel, checked_scores, likelihood_ratios

__all__ = ["best_path", "smooth_route"]


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
    frames, places = S.shape
    exits = model.exits(places)
    answers: list[Answer] = []
    kept = [_first_belief(S, model)]
    for start, end in pairwise(_segments(frames)):
        kept.append(_forward(S[start + 1 : end + 1], kept[-1], model, exits)[-1])
    later_on, later_off = np.ones((2, places)), 1.0
    edges = _segments(frames)
    for index in range(len(edges) - 1, -1, -1):
        start, end = edges[index], edges[index + 1] if index + 1 < len(edges) else frames
        beliefs = _forward(S[start + 1 : end], kept[index], model, exits)
        for frame in range(end - 1, start - 1, -1):
            if frame + 1 < frames:
                later_on, later_off = _look_back(
                    likelihood_ratios(S[frame + 1], model), later_on, later_off, model, exits
                )
            belief = beliefs[frame - start]
            on, off = belief.on[0] * later_on, float(belief.off[0]) * later_off
            answers.append(answer(on.sum(axis=0) / (on.sum() + off), reach))
    return answers[::-1]


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
    frames, places = S.shape
    best = np.full(2 * places + 1, np.log(model.start / (2 * places)))
    best[-1] = np.log(1 - model.start)
    best += _log_ratios(S[0], model)
    edges = _segments(frames)
    kept = [best]
    for start, end in pairwise(edges):
        kept.append(_best_steps(S[start + 1 : end + 1], kept[-1], model)[0])
    states = np.empty(frames, np.int64)
    for index in range(len(edges) - 1, -1, -1):
        start, end = edges[index], edges[index + 1] if index + 1 < len(edges) else frames - 1
        best, came_from = _best_steps(S[start + 1 : end + 1], kept[index], model)
        if end == frames - 1:
            states[end] = best.argmax()
        for frame in range(end, start, -1):
            states[frame - 1] = came_from[frame - start - 1, states[frame]]
    return np.where(states == 2 * places, -1, states % places)


def _segments(frames: int) -> list[int]:
    """The first frames of segments of about √M frames."""
    return list(range(0, frames, max(1, int(np.sqrt(frames)))))


def _first_belief(S: NDArray[Any], model: RouteModel) -> Belief:
    belief = Belief.start(model, 1, S.shape[1])
    belief.see(likelihood_ratios(S[:1], model))
    return belief


def _forward(S: NDArray[Any], belief: Belief, model: RouteModel, exits: NDArray[np.float64]) -> list[Belief]:
    """The given belief and those after each of the frames."""
    beliefs = [belief]
    for scores in S:
        belief = Belief(belief.on.copy(), belief.off.copy())
        belief.move(model, exits)
        belief.see(likelihood_ratios(scores, model)[None])
        beliefs.append(belief)
    return beliefs


def _look_back(
    ratios: NDArray[np.float64],
    later_on: NDArray[np.float64],
    later_off: float,
    model: RouteModel,
    exits: NDArray[np.float64],
) -> tuple[NDArray[np.float64], float]:
    """How well each state explains the frames after it, up to a factor: the backward recursion."""
    places = len(ratios)
    seen = later_on * ratios
    mean = float(seen.mean())
    ahead = seen * model.steps[0]
    for offset, probability in enumerate(model.steps[1:places], start=1):
        ahead[0, :-offset] += probability * seen[0, offset:]
        ahead[1, offset:] += probability * seen[1, :-offset]
    on = model.stay * model.turned(ahead) + model.jump * mean + exits * later_off
    off = model.enter * mean + (1 - model.enter) * later_off
    largest = max(float(on.max()), off)
    return on / largest, off / largest


def _log_ratios(scores: NDArray[Any], model: RouteModel) -> NDArray[np.float64]:
    """2N+1: both directions and off the map."""
    ratios = np.log(likelihood_ratios(scores, model))
    return np.concatenate([ratios, ratios, [0.0]])


def _best_steps(
    S: NDArray[Any], best: NDArray[np.float64], model: RouteModel
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Goes on from the log-probabilities of the best paths to 2N+1 states.

    Returns:
        Those after the last of the F frames, and F×(2N+1) states where the best paths came from.
    """
    places = len(best) // 2
    nowhere = 2 * places
    jump = model.jump / nowhere
    log_exits = np.log(model.exits(places)).ravel()
    came_from = np.empty((len(S), nowhere + 1), np.int32)
    for frame, scores in enumerate(S):
        origin = int(best[:-1].argmax())
        options = ((best[origin] + np.log(jump), origin), (best[-1] + np.log(model.enter / nowhere), nowhere))
        after = np.full(nowhere + 1, max(options)[0])
        source = np.full(nowhere + 1, max(options)[1], np.int32)
        for to in (0, 1):
            for start in (0, 1):
                direction = 1 - model.turn if start == to else model.turn
                for offset, probability in enumerate(model.steps[:places]):
                    # A step along the route can also have been a jump that ended there.
                    weight = np.log(model.stay * direction * probability + jump)
                    here, there = slice(0, places - offset), slice(offset, places)
                    target, begin = (there, here) if to == 0 else (here, there)
                    _keep_better(
                        after[to * places :][target],
                        source[to * places :][target],
                        best[start * places :][begin] + weight,
                        start * places + begin.start,
                    )
        exit_from = int((best[:-1] + log_exits).argmax())
        options = ((best[exit_from] + log_exits[exit_from], exit_from), (best[-1] + np.log(1 - model.enter), nowhere))
        after[-1], source[-1] = max(options)
        best = after + _log_ratios(scores, model)
        best -= best.max()
        came_from[frame] = source
    return best, came_from


def _keep_better(after: NDArray[np.float64], source: NDArray[np.int32], value: NDArray[np.float64], first: int) -> None:
    """Replaces what is worse by the value and its origin, `first` and the following states."""
    better = value > after
    after[better] = value[better]
    source[better] = first + np.flatnonzero(better)
