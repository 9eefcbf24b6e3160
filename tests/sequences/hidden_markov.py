"""`RouteModel` written out: the matrix of all transitions, sums over all of it, and every path by enumeration.

A state is one of 3N+1, going or, in the second half of 2(3N+1), standing at the view before.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.sequences import frame_change
from everplace.sequences.evidence import likelihood_ratios, standardised
from everplace.sequences.route_model import RouteModel

MODELS = (
    RouteModel(),
    RouteModel(
        even=(0.1, 0.7, 0.2),
        steps=(0.2, 0.3, 0.1, 0.4),
        pace=0.2,
        evenly=0.4,
        forward=0.3,
        turn=0.3,
        jump=0.2,
        leave=0.15,
        enter=0.4,
        separation=1.0,
        spread=0.0,
        outlier=0.05,
        doubt=0.0,
        repeat=3.0,
        stand=0.3,
        blank=0.8,
        beside=0.2,
    ),
    RouteModel(
        even=(0.0, 1.0),
        steps=(1.0,),
        turn=0.01,
        jump=1e-6,
        leave=0.5,
        enter=0.9,
        separation=4.0,
        spread=2.0,
        outlier=0.5,
        doubt=2.0,
        repeat=1.0,
        stand=0.1,
        beside=0.2,
    ),
)


def transitions(model: RouteModel, places: int) -> NDArray[np.float64]:
    """(3N+1)×(3N+1): at the map's pace, at another, against the route, at N places each; then off the map."""
    off = 3 * places
    change = [
        [1 - model.pace - model.turn, model.pace, model.turn],
        [model.pace, 1 - model.pace - model.turn, model.turn],
        [model.turn / 2, model.turn / 2, 1 - model.turn],
    ]
    T = np.zeros((off + 1, off + 1))
    for gait, place in product(range(3), range(places)):
        start = gait * places + place
        T[start, off] += model.leave
        T[start, :off] += model.jump * anywhere(model, places)
        for then in range(3):
            for offset, step in enumerate(model.steps if then else model.even):
                p = (1 - model.jump - model.leave) * step * change[gait][then]
                end = place + (-offset if then == 2 else offset)
                T[start, then * places + end if 0 <= end < places else off] += p
    T[off, :off] = model.enter * anywhere(model, places)
    T[off, off] = 1 - model.enter
    return T


def worth(model: RouteModel, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """What every place is worth as an answer: it is right with p, and beside the true place with that of the next."""
    padded = [0.0, *p, 0.0]
    return np.array([padded[j] + model.beside * (padded[j - 1] + padded[j + 1]) for j in range(1, len(p) + 1)])


@contextmanager
def correlations_of_few_places() -> Iterator[None]:
    """Lets maps of two places tell what is new, so that small cases have it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(frame_change, "_FEWEST", 2)
        yield


def anywhere(model: RouteModel, places: int) -> NDArray[np.float64]:
    evenly = model.forward * model.evenly
    return np.repeat([evenly, model.forward - evenly, 1 - model.forward], places) / places


def changes(model: RouteModel, S: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """M: the frame that each frame shows, itself or an earlier one, and the change that brought it; no gaps in S."""
    evidence = np.log(likelihood_ratios(standardised(S), model))
    frames, measured = [0], [np.inf]
    for frame in range(1, len(S)):
        before, after = evidence[frames[-1]], evidence[frame]
        change = np.inf
        if S.shape[1] >= 3:  # neighbours have a correlation
            step = 1 - np.mean([np.corrcoef(row[:-1], row[1:])[0, 1] for row in (before, after)])
            change = (1 - np.corrcoef(before, after)[0, 1]) / step if step > 0 else np.inf
        same = change < model.repeat
        frames.append(frames[-1] if same else frame)
        measured.append(measured[-1] if same else change)
    return np.array(frames), np.array(measured)


def shown(model: RouteModel, S: NDArray[Any]) -> NDArray[np.int64]:
    """M: the frame that each frame shows, itself or an earlier one; for scores without gaps and constant rows."""
    return changes(model, S)[0]


def ratios(model: RouteModel, S: NDArray[Any], begin: int = 0) -> NDArray[np.float64]:
    """M×N: what each frame, or the one that it repeats, says of the places, seen from `begin` on."""
    shows, change = changes(model, S)
    with np.errstate(invalid="ignore"):  # one place has no deviation
        z = (S - S.mean(axis=1, keepdims=True)) / S.std(axis=1, keepdims=True)
    rows = []
    for frame in range(len(S)):
        view = shows[frame]
        r = min(max(1 - 2 * change[frame], 0.0), 0.999)
        if r > 0 and view > begin:
            rows.append((z[view] - r * z[shows[view - 1]]) / np.sqrt(1 - r**2))
        else:
            rows.append(z[view])
    return likelihood_ratios(np.array(rows), model)


def repeated(model: RouteModel, seen: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """3N+1: how likely a frame that says this of the places comes again, the robot standing or going on."""
    places = len(seen)
    shows = 1 - model.outlier * seen.mean() / seen
    standing, going = [], []
    for gait, place in product(range(3), range(places)):
        following = place + (-1 if gait == 2 else 1)
        inside = 0 <= following < places
        apart = np.log(seen[following] / seen[place]) if inside else np.inf
        standing.append(model.stand * shows[place])
        going.append(model.blank * (1 - shows[place]) + shows[place] * np.exp(-((apart / 0.03) ** 2) / 2))
    off = model.stand * (1 - model.outlier) + model.blank * model.outlier
    return np.array([*standing, off]), np.array([*going, 0.0])


def beginning(model: RouteModel, places: int) -> NDArray[np.float64]:
    start = model.enter / (model.enter + model.leave)
    return np.append(start * anywhere(model, places), 1 - start)


def kernels(model: RouteModel, S: NDArray[Any], begin: int = 0) -> Iterator[NDArray[np.float64]]:
    """2(3N+1)×2(3N+1) for every frame after `begin`: from each state to each, times what the frame says of it."""
    T, shows, seen = transitions(model, S.shape[1]), shown(model, S), ratios(model, S, begin)
    nothing, same = np.zeros_like(T), np.eye(len(T))
    for frame in range(begin + 1, len(S)):
        if shows[frame] == frame:
            step = T * np.append(np.tile(seen[frame], 3), 1)
            yield np.block([[step, nothing], [step, nothing]])
        elif shows[frame - 1] == frame - 1:
            stands, goes = repeated(model, seen[frame])
            yield np.block([[goes[:, None] * T, np.diag(stands)], [nothing, nothing]])
        else:
            yield np.block([[T, nothing], [nothing, same]])


def forward(model: RouteModel, S: NDArray[Any], begin: int = 0) -> NDArray[np.float64]:
    """(M - begin)×(3N+1): P(state i | frames `begin` .. i); `begin` is new."""
    places = S.shape[1]
    first = beginning(model, places) * np.append(np.tile(ratios(model, S, begin)[begin], 3), 1)
    rows = [np.append(first, np.zeros_like(first)) / first.sum()]
    for kernel in kernels(model, S, begin):
        row = rows[-1] @ kernel
        rows.append(row / row.sum())
    ways: NDArray[np.float64] = np.array(rows).reshape(len(S) - begin, 2, -1)
    known: NDArray[np.float64] = ways.sum(axis=1)
    return known


def every_path(model: RouteModel, S: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """All possible paths through 3N+1 states, standing or going, and their probabilities with the frames."""
    places = S.shape[1]
    states = 3 * places + 1
    p = beginning(model, places) * np.append(np.tile(ratios(model, S)[0], 3), 1)
    paths = np.arange(states)[:, None]
    for kernel in kernels(model, S):
        from_path, to = np.nonzero(kernel[paths[:, -1]])
        p = p[from_path] * kernel[paths[from_path, -1], to]
        paths = np.hstack([paths[from_path], to[:, None]])
    return paths % states, p


def drive(path: list[int], places: int, *, seed: int = 0, separation: float = 3.0) -> NDArray[np.float64]:
    """Synthetic scores of a drive along a path of places; -1: a frame that is nowhere on the map."""
    S = np.random.default_rng(seed).normal(size=(len(path), places))
    for frame, place in enumerate(path):
        if place >= 0:
            S[frame, place] += separation
    return S
