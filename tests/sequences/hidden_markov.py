"""`RouteModel` written out: the matrix of all transitions, sums over all of it, and every path by enumeration."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.sequences import frame_change
from everplace.sequences.route_model import RouteModel, likelihood_ratios

MODELS = (
    RouteModel(),
    RouteModel(
        steps=(0.2, 0.3, 0.1, 0.4),
        forward=0.3,
        turn=0.3,
        jump=0.2,
        leave=0.15,
        enter=0.4,
        separation=1.0,
        outlier=0.05,
        doubt=0.0,
        repeat=3.0,
        beside=0.2,
    ),
    RouteModel(
        steps=(1.0,), turn=0.01, jump=1e-6, leave=0.5, enter=0.9, separation=4.0, outlier=0.5, doubt=2.0, repeat=1.0
    ),
)


def transitions(model: RouteModel, places: int) -> NDArray[np.float64]:
    """(2N+1)×(2N+1): along the route at 0 .. N-1, against it at N .. 2N-1, off the map at 2N; from row to column."""
    off = 2 * places
    T = np.zeros((off + 1, off + 1))
    for direction, place in product((0, 1), range(places)):
        start = direction * places + place
        T[start, off] += model.leave
        T[start, :off] += model.jump * anywhere(model, places)
        for heading, (offset, step) in product((0, 1), enumerate(model.steps)):
            p = model.stay * step * (model.turn if heading != direction else 1 - model.turn)
            end = place + (-offset if heading else offset)
            T[start, heading * places + end if 0 <= end < places else off] += p
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
    return np.repeat([model.forward, 1 - model.forward], places) / places


def shown(model: RouteModel, S: NDArray[Any]) -> NDArray[np.int64]:
    """M: the frame that each frame shows, itself or an earlier one; for scores without gaps and constant rows."""
    evidence, frames = np.log(likelihood_ratios(S, model)), [0]
    for frame in range(1, len(S)):
        before, after = evidence[frames[-1]], evidence[frame]
        same = False
        if S.shape[1] >= 3:  # neighbours have a correlation
            step = 1 - np.mean([np.corrcoef(row[:-1], row[1:])[0, 1] for row in (before, after)])
            same = step > 0 and 1 - np.corrcoef(before, after)[0, 1] < model.repeat * step
        frames.append(frames[-1] if same else frame)
    return np.array(frames)


def likelihoods(model: RouteModel, S: NDArray[Any]) -> NDArray[np.float64]:
    """M×(2N+1)."""
    ratios = likelihood_ratios(S, model)
    return np.hstack([ratios, ratios, np.ones((len(S), 1))])


def beginning(model: RouteModel, places: int) -> NDArray[np.float64]:
    return np.append(model.start * anywhere(model, places), 1 - model.start)


def forward(model: RouteModel, S: NDArray[Any]) -> NDArray[np.float64]:
    """M×(2N+1): P(state i | frames 0 .. i)."""
    T, seen, shows = transitions(model, S.shape[1]), likelihoods(model, S), shown(model, S)
    rows = [beginning(model, S.shape[1]) * seen[0]]
    for frame in range(1, len(S)):
        rows.append(rows[-1] @ T * seen[frame] if shows[frame] == frame else rows[-1])
    return np.array([row / row.sum() for row in rows])


def every_path(model: RouteModel, S: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """All possible paths through 2N+1 states and their probabilities with the frames."""
    T, seen, start = transitions(model, S.shape[1]), likelihoods(model, S), beginning(model, S.shape[1])
    paths = np.array(list(product(range(2 * S.shape[1] + 1), repeat=len(S))))
    shows = shown(model, S)
    p = start[paths[:, 0]] * seen[0, paths[:, 0]]
    for frame in range(1, len(S)):
        before, now = paths[:, frame - 1], paths[:, frame]
        p = p * (T[before, now] * seen[frame, now] if shows[frame] == frame else before == now)
    return paths, p


def drive(path: list[int], places: int, *, seed: int = 0, separation: float = 3.0) -> NDArray[np.float64]:
    """Synthetic scores of a drive along a path of places; -1: a frame that is nowhere on the map."""
    S = np.random.default_rng(seed).normal(size=(len(path), places))
    for frame, place in enumerate(path):
        if place >= 0:
            S[frame, place] += separation
    return S
