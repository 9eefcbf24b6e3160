"""`RouteModel` written out: evidence, the matrix of all transitions, sums over it, every path by enumeration."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.match.route_model import RouteModel, likelihood_ratios

MODELS = (
    RouteModel(),
    RouteModel(
        steps=(0.2, 0.3, 0.1, 0.4),
        turn=0.3,
        jump=0.2,
        leave=0.15,
        enter=0.4,
        separation=1.0,
        outlier=0.05,
        doubt=0.0,
        background=2.0,
        repeat=3.0,
    ),
    RouteModel(
        steps=(1.0,),
        turn=0.01,
        jump=1e-6,
        leave=0.5,
        enter=0.9,
        separation=4.0,
        outlier=0.5,
        doubt=2.0,
        background=0.5,
        repeat=1.0,
    ),
)


def transitions(model: RouteModel, places: int) -> NDArray[np.float64]:
    """(2N+1)×(2N+1): along the route at 0 .. N-1, against it at N .. 2N-1, off the map at 2N; from row to column."""
    off = 2 * places
    T = np.zeros((off + 1, off + 1))
    for direction, place in product((0, 1), range(places)):
        start = direction * places + place
        T[start, off] += model.leave
        T[start, :off] += model.jump / off
        for heading, (offset, step) in product((0, 1), enumerate(model.steps)):
            p = model.stay * step * (model.turn if heading != direction else 1 - model.turn)
            end = place + (-offset if heading else offset)
            T[start, heading * places + end if 0 <= end < places else off] += p
    T[off, :off] = model.enter / off
    T[off, off] = 1 - model.enter
    return T


def evidence(model: RouteModel, S: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """M×N likelihood ratios and M shares of what is new, each frame from all before it; for scores without gaps."""
    from scipy.stats import zscore

    frames, places = S.shape
    z = zscore(S, axis=1) if places > 1 else np.full(S.shape, np.nan)
    ratios, news, changes = np.empty(S.shape), np.ones(frames), np.empty(frames)
    for i in range(frames):
        # The assumed frames before the first: half of mean 0 and deviation 1 above, half below.
        assumed = np.tile([[1.0], [-1.0]], places)
        values = np.vstack([assumed, np.minimum(z[:i], 2)])
        weights = np.append([model.background / 2] * 2, news[:i])
        mean = np.average(values, axis=0, weights=weights)
        spread = np.sqrt(np.average((values - mean) ** 2, axis=0, weights=weights))
        ratios[i] = likelihood_ratios((z[i] - mean) / spread, model)
        if i and places > 1:
            changes[i] = 1 - np.corrcoef((z[i] - mean) / spread, (z[i - 1] - mean) / spread)[0, 1]
            usual = np.average(np.append(0.5, changes[1:i]), weights=np.append(5.0, news[1:i]))
            news[i] = np.clip(changes[i] / (model.repeat * usual), 0, 1)
    return ratios, news


def likelihoods(model: RouteModel, S: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """M×(2N+1) likelihoods of frames that are all new, and M shares of what is new."""
    ratios, news = evidence(model, S)
    return np.hstack([ratios, ratios, np.ones((len(S), 1))]), news


def beginning(model: RouteModel, places: int) -> NDArray[np.float64]:
    return np.append(np.full(2 * places, model.start / (2 * places)), 1 - model.start)


def forward(model: RouteModel, S: NDArray[Any], begin: int = 0) -> NDArray[np.float64]:
    """(M-begin)×(2N+1): P(state i | frames begin .. i), the evidence being that of the whole traverse."""
    T = transitions(model, S.shape[1])
    seen, news = likelihoods(model, S)
    rows = [beginning(model, S.shape[1]) * seen[begin]]
    for ratios, new in zip(seen[begin + 1 :], news[begin + 1 :], strict=True):
        rows.append((new * rows[-1] @ T + (1 - new) * rows[-1]) * ratios**new)
    return np.array([row / row.sum() for row in rows])


def every_path(model: RouteModel, S: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """All (2N+1)^M paths and their probabilities with the frames."""
    T, start = transitions(model, S.shape[1]), beginning(model, S.shape[1])
    seen, news = likelihoods(model, S)
    paths = np.array(list(product(range(2 * S.shape[1] + 1), repeat=len(S))))
    p = start[paths[:, 0]] * seen[0, paths[:, 0]]
    for frame in range(1, len(S)):
        new = news[frame]
        steps = new * T + (1 - new) * np.eye(len(T))
        p = p * steps[paths[:, frame - 1], paths[:, frame]] * seen[frame, paths[:, frame]] ** new
    return paths, p


def drive(path: list[int], places: int, *, seed: int = 0, separation: float = 3.0) -> NDArray[np.float64]:
    """Synthetic scores of a drive along a path of places; -1: a frame that is nowhere on the map."""
    S = np.random.default_rng(seed).normal(size=(len(path), places))
    for frame, place in enumerate(path):
        if place >= 0:
            S[frame, place] += separation
    return S
