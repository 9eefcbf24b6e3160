"""Where on the route a whole traverse went, looking back: forward-backward smoothing and the best path.

Both are exact for `RouteModel`, with the evidence of `RouteEvidence`, and keep a few √M rows of states in memory: every
√M-th row is kept on the way forward, and the rows between are computed again on the way back.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.match.route_evidence import RouteEvidence
from everplace.match.route_filter import Answer, Belief, answer
from everplace.match.route_model import RouteModel, checked_scores

__all__ = ["best_path", "smooth_route"]

_LEAST = 1e-300  # stands for 0 where a logarithm is taken


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
    edges = _segments(frames)
    evidence = RouteEvidence(places, model)
    start = Belief.start(model, 1, places)
    ratios, new = evidence.weigh(S[0])
    start.see(ratios[None])
    kept = [(_Past(start, ratios, new), evidence.copy())]
    for begin, end in pairwise(edges):
        last = _forward(S[begin + 1 : end + 1], kept[-1][0], evidence, model, exits)[-1]
        kept.append((last, evidence.copy()))
    later_on, later_off = np.ones((2, places)), 1.0
    after: _Past | None = None
    for index in range(len(edges) - 1, -1, -1):
        end = edges[index + 1] if index + 1 < len(edges) else frames
        for past in reversed(_forward(S[edges[index] + 1 : end], *kept[index], model, exits)):
            if after is not None:
                later_on, later_off = _look_back(after, later_on, later_off, model, exits)
            belief = past.belief
            on, off = belief.on[0] * later_on, float(belief.off[0]) * later_off
            answers.append(answer(on.sum(axis=0) / (on.sum() + off), reach))
            after = past
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
    evidence = RouteEvidence(places, model)
    best += _log_ratios(evidence.weigh(S[0])[0])
    edges = _segments(frames)
    kept = [(best, evidence.copy())]
    for start, end in pairwise(edges):
        best = _best_steps(*evidence.weigh_all(S[start + 1 : end + 1]), best, model)[0]
        kept.append((best, evidence.copy()))
    states = np.empty(frames, np.int64)
    for index in range(len(edges) - 1, -1, -1):
        start, end = edges[index], edges[index + 1] if index + 1 < len(edges) else frames - 1
        best, evidence = kept[index]
        best, came_from = _best_steps(*evidence.weigh_all(S[start + 1 : end + 1]), best, model)
        if end == frames - 1:
            states[end] = best.argmax()
        for frame in range(end, start, -1):
            states[frame - 1] = came_from[frame - start - 1, states[frame]]
    return np.where(states == 2 * places, -1, states % places)


def _segments(frames: int) -> list[int]:
    """The first frames of segments of about √M frames."""
    return list(range(0, frames, max(1, int(np.sqrt(frames)))))


@dataclass(frozen=True, slots=True, eq=False)
class _Past:
    """What is known at a frame from it and those before.

    Attributes:
        belief: After the frame.
        ratios: N: what the frame said, to the power of `new`.
        new: What was new in it.
    """

    belief: Belief
    ratios: NDArray[np.float64]
    new: float


def _forward(
    S: NDArray[Any], past: _Past, evidence: RouteEvidence, model: RouteModel, exits: NDArray[np.float64]
) -> list[_Past]:
    """What was known at the frame before the given ones, and at each of them, which `evidence` takes."""
    pasts = [past]
    for scores in S:
        ratios, new = evidence.weigh(scores)
        ratios **= new
        belief = Belief(pasts[-1].belief.on.copy(), pasts[-1].belief.off.copy())
        belief.move(model, exits, np.array([new]))
        belief.see(ratios[None])
        pasts.append(_Past(belief, ratios, new))
    return pasts


def _look_back(
    after: _Past,
    later_on: NDArray[np.float64],
    later_off: float,
    model: RouteModel,
    exits: NDArray[np.float64],
) -> tuple[NDArray[np.float64], float]:
    """How well each state explains the frames after it, up to a factor: the backward recursion."""
    places = len(after.ratios)
    seen = later_on * after.ratios
    mean = float(seen.mean())
    ahead = seen * model.steps[0]
    for offset, probability in enumerate(model.steps[1:places], start=1):
        ahead[0, :-offset] += probability * seen[0, offset:]
        ahead[1, offset:] += probability * seen[1, :-offset]
    on = model.stay * model.turned(ahead) + model.jump * mean + exits * later_off
    off = model.enter * mean + (1 - model.enter) * later_off
    on, off = seen + after.new * (on - seen), later_off + after.new * (off - later_off)
    largest = max(float(on.max()), off)
    return on / largest, off / largest


def _log_ratios(ratios: NDArray[np.float64]) -> NDArray[np.float64]:
    """2N+1: both directions and off the map."""
    logs = np.log(ratios)
    return np.concatenate([logs, logs, [0.0]])


def _best_steps(
    ratios: NDArray[np.float64], news: NDArray[np.float64], best: NDArray[np.float64], model: RouteModel
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Goes on from the log-probabilities of the best paths to 2N+1 states.

    Returns:
        Those after the last of the F frames, and F×(2N+1) states where the best paths came from.
    """
    places = len(best) // 2
    nowhere = 2 * places
    exits = model.exits(places).ravel()
    came_from = np.empty((len(news), nowhere + 1), np.int32)
    for frame, new in enumerate(np.maximum(news, _LEAST)):
        jump, enter = new * model.jump / nowhere, new * model.enter
        origin = int(best[:-1].argmax())
        options = ((best[origin] + np.log(jump), origin), (best[-1] + np.log(enter / nowhere), nowhere))
        after = np.full(nowhere + 1, max(options)[0])
        source = np.full(nowhere + 1, max(options)[1], np.int32)
        for to in (0, 1):
            for start in (0, 1):
                direction = 1 - model.turn if start == to else model.turn
                for offset, probability in enumerate(model.steps[:places]):
                    # A step along the route can also have been a jump that ended there, or none at all.
                    still = 1 - new if offset == 0 and start == to else 0.0
                    weight = np.log(new * model.stay * direction * probability + jump + still)
                    here, there = slice(0, places - offset), slice(offset, places)
                    target, begin = (there, here) if to == 0 else (here, there)
                    _keep_better(
                        after[to * places :][target],
                        source[to * places :][target],
                        best[start * places :][begin] + weight,
                        start * places + begin.start,
                    )
        leaving = best[:-1] + np.log(new * exits)
        exit_from = int(leaving.argmax())
        after[-1], source[-1] = max((leaving[exit_from], exit_from), (best[-1] + np.log(1 - enter), nowhere))
        best = after + _log_ratios(ratios[frame] ** news[frame])
        best -= best.max()
        came_from[frame] = source
    return best, came_from


def _keep_better(after: NDArray[np.float64], source: NDArray[np.int32], value: NDArray[np.float64], first: int) -> None:
    """Replaces what is worse by the value and its origin, `first` and the following states."""
    better = value > after
    after[better] = value[better]
    source[better] = first + np.flatnonzero(better)
