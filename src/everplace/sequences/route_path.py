"""Where on the route a whole traverse went, looking back: forward-backward smoothing and the best path.

Both are exact for `RouteModel` and keep about 2√M rows of states in memory: every √M-th row is kept on the way
forward, and the rows between are computed again on the way back.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.sequences.frame_change import new_frames
from everplace.sequences.route_filter import Answer, Belief, answer
from everplace.sequences.route_model import RouteModel, checked_scores, likelihood_ratios

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
    new, places = new_frames(S, model), S.shape[1]
    frames, exits = len(new), model.exits(places)
    answers: list[Answer] = []
    first = Belief.start(model, 1, places)
    first.see(likelihood_ratios(S[:1], model))
    kept = [first]
    for start, end in pairwise(_segments(frames)):
        kept.append(_forward(S[new[start + 1 : end + 1]], kept[-1], model)[-1])
    later_on, later_off = np.ones((2, places)), 1.0
    edges = _segments(frames)
    for index in range(len(edges) - 1, -1, -1):
        start, end = edges[index], edges[index + 1] if index + 1 < len(edges) else frames
        beliefs = _forward(S[new[start + 1 : end]], kept[index], model)
        for frame in range(end - 1, start - 1, -1):
            if frame + 1 < frames:
                ratios = likelihood_ratios(S[new[frame + 1]], model)
                later_on, later_off = _look_back(ratios, later_on, later_off, model, exits)
            belief = beliefs[frame - start]
            on, off = belief.on[0] * later_on, float(belief.off[0]) * later_off
            answers.append(answer(on.sum(axis=0) / (on.sum() + off), model, reach))
    return [answers[frames - 1 - frame] for frame in _last_new(new, len(S))]


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
    new, places = new_frames(S, model), S.shape[1]
    frames = len(new)
    on = np.broadcast_to(model.start * model.anywhere(places), (2, places))
    best = np.log(np.append(on, 1 - model.start)) + _log_ratios(S[0], model)
    edges = _segments(frames)
    kept = [best]
    for start, end in pairwise(edges):
        kept.append(_best_steps(S[new[start + 1 : end + 1]], kept[-1], model)[0])
    states = np.empty(frames, np.int64)
    for index in range(len(edges) - 1, -1, -1):
        start, end = edges[index], edges[index + 1] if index + 1 < len(edges) else frames - 1
        best, came_from = _best_steps(S[new[start + 1 : end + 1]], kept[index], model)
        if end == frames - 1:
            states[end] = best.argmax()
        for frame in range(end, start, -1):
            states[frame - 1] = came_from[frame - start - 1, states[frame]]
    return np.where(states == 2 * places, -1, states % places)[_last_new(new, len(S))]


def _last_new(new: NDArray[np.int64], frames: int) -> NDArray[np.int64]:
    """For every frame of a traverse which of its new ones it shows."""
    return np.arange(len(new)).repeat(np.diff(np.append(new, frames)))


def _segments(frames: int) -> list[int]:
    """The first frames of segments of about √M frames."""
    return list(range(0, frames, max(1, int(np.sqrt(frames)))))


def _forward(S: NDArray[Any], belief: Belief, model: RouteModel) -> list[Belief]:
    """The given belief and those after each of the frames."""
    beliefs = [belief]
    for scores in S:
        belief = Belief(belief.on.copy(), belief.off.copy())
        belief.move(model)
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
    anywhere = float((seen * model.anywhere(places)).sum())
    ahead = seen * model.steps[0]
    for offset, probability in enumerate(model.steps[1:places], start=1):
        ahead[0, :-offset] += probability * seen[0, offset:]
        ahead[1, offset:] += probability * seen[1, :-offset]
    on = model.stay * model.turned(ahead) + model.jump * anywhere + exits * later_off
    off = model.enter * anywhere + (1 - model.enter) * later_off
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
    exits, anywhere = model.exits(places).ravel(), model.anywhere(places).repeat(places)
    came_from = np.empty((len(S), nowhere + 1), np.int32)
    for frame, scores in enumerate(S):
        origin = int(best[:-1].argmax())
        begun, source_state = max(
            (best[origin] + np.log(model.jump), origin), (best[-1] + np.log(model.enter), nowhere)
        )
        after = np.append(begun + np.log(anywhere), 0.0)
        source = np.full(nowhere + 1, source_state, np.int32)
        for to in (0, 1):
            for start in (0, 1):
                direction = 1 - model.turn if start == to else model.turn
                for offset, probability in enumerate(model.steps[:places]):
                    # A step along the route can also have been a jump that ended there.
                    step = model.stay * direction * probability + model.jump * anywhere[to * places]
                    here, there = slice(0, places - offset), slice(offset, places)
                    target, begin = (there, here) if to == 0 else (here, there)
                    _keep_better(
                        after[to * places :][target],
                        source[to * places :][target],
                        best[start * places :][begin] + np.log(step),
                        start * places + begin.start,
                    )
        leaving = best[:-1] + np.log(exits)
        exit_from = int(leaving.argmax())
        after[-1], source[-1] = max((leaving[exit_from], exit_from), (best[-1] + np.log(1 - model.enter), nowhere))
        best = after + _log_ratios(scores, model)
        best -= best.max()
        came_from[frame] = source
    return best, came_from


def _keep_better(after: NDArray[np.float64], source: NDArray[np.int32], value: NDArray[np.float64], first: int) -> None:
    """Replaces what is worse by the value and its origin, `first` and the following states."""
    better = value > after
    after[better] = value[better]
    source[better] = first + np.flatnonzero(better)
