"""What one frame's scores say of the places, given those of the frame before it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.sequences.route_model import GAITS, RouteModel

__all__ = ["likelihood_ratios", "news", "repeat_likelihoods", "standardised"]

_LARGEST = 50.0  # nats a score may speak for a place before the others are heard: the sum of e^50 stays a double
_FARTHEST = 1e3  # standard deviations; only infinite scores lie farther out on any map of fewer than a million places
_ALIKE = 0.03  # nats by which the ratios of neighbouring places that look alike may differ


def standardised(scores: NDArray[Any]) -> NDArray[np.float64]:
    """Expresses each frame's scores in standard deviations from their mean.

    Args:
        scores: ...×N, higher = more alike; NaN: none. Infinities do not count for mean and deviation.

    Returns:
        ...×N; NaN where there is no score, and in a frame whose scores are all equal.
    """
    S = np.asarray(scores, np.float64)
    known = np.isfinite(S)
    complete = bool(known.all())
    count = max(S.shape[-1], 1) if complete else np.maximum(known.sum(axis=-1, keepdims=True), 1)
    where: Any = True if complete else known  # sums over a mask are slow
    mean = S.sum(axis=-1, keepdims=True, where=where) / count
    z: NDArray[np.float64] = S - mean
    spread = np.sqrt(np.square(z).sum(axis=-1, keepdims=True, where=where) / count)
    varies = spread > 1e-12 * np.abs(mean)  # less is rounding
    z /= np.where(varies, spread, np.nan)
    return z if complete else np.clip(z, -_FARTHEST, _FARTHEST, out=z)


def news(z: NDArray[np.float64], before: NDArray[np.float64], change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Takes from a frame's scores what the frame before has said of the same places.

    A place that looks like everything, or a veil of fog that is the same in all frames, gives the same places high
    scores frame after frame, whatever place is shown. The scores of such a background follow those of the last frame
    with a correlation r; the part that is new, (z - r z_before) / sqrt(1 - r²), is again one of standard deviation 1.
    A frame of a drive that moves on brings about the change of one step along the map, and is left as it is; from half
    a step down, r grows to 1 where nothing changes: r = 1 - 2 `change`.

    Args:
        z: ...×N, of `standardised`.
        before: ...×N: those of the frame before; NaN: nothing is known of the place.
        change: ...: what changed between the two (`everplace.sequences.frame_change.change_in_steps`).

    Returns:
        ...×N.
    """
    r = np.clip(1 - 2 * np.asarray(change), 0, 0.999)[..., None]
    if not r.any():
        return z
    fresh: NDArray[np.float64] = (z - r * np.nan_to_num(before)) / np.sqrt(1 - r * r)
    return fresh


def likelihood_ratios(z: NDArray[np.float64], model: RouteModel) -> NDArray[np.float64]:
    """Says how much likelier each frame's scores are if it shows the place than if it is not on the map.

    Background places are taken as N(0, 1) and the true place as N(d, 1), where d itself is drawn from
    N(`separation`, `spread`²) for every frame: one in fog says less of its place than one in clear weather, and both
    may be heard. Place j then has the likelihood e_j in units of that of background alone. A share ε = `outlier` of
    frames says nothing about the true place; these, and frames off the map, are taken to score as frames of a random
    place do, whatever the method's scores are like: their likelihood is the mean of e. So
    w_j = (1 - ε) e_j / mean(e) + ε, whose mean is 1: one frame by itself never speaks for the map, and only frames that
    agree on a path do. And no frame speaks against a place by more than 1 / ε, however well it fits another.
    Ratio_j = w_j exp(-`doubt` I), where I = log mean(w²) is what the frame says of the places, in nats (Rényi's
    information of order 2). A frame in fog says next to nothing, and is hardly doubted. "Not on the map" has ratio 1.

    Args:
        z: ...×N, of `standardised` or `news`. NaN: the place has no score, and is as likely as a random place; a frame
            that is all NaN says nothing, and all its ratios are 1.
        model: The assumptions.

    Returns:
        ...×N, positive.
    """
    variance = model.spread**2
    lowest = -model.separation / variance if variance else -np.inf  # below, fitting worse would speak for the place
    z = np.maximum(z, lowest)
    exponent = z * variance
    exponent += 2 * model.separation
    exponent *= z
    exponent -= model.separation**2
    exponent /= 2 * (1 + variance)
    e: NDArray[np.float64] = np.exp(np.minimum(exponent, _LARGEST, out=exponent), out=exponent)
    unscored = np.isnan(e)
    if unscored.any():
        count = np.maximum((~unscored).sum(axis=-1, keepdims=True), 1)
        random_place = e.sum(axis=-1, keepdims=True, where=~unscored) / count
        e = np.where(unscored, np.where(random_place > 0, random_place, 1.0), e)
    e *= (1 - model.outlier) / e.mean(axis=-1, keepdims=True)
    e += model.outlier
    e *= np.square(e).mean(axis=-1, keepdims=True) ** -model.doubt
    return e


def repeat_likelihoods(
    ratios: NDArray[np.float64], model: RouteModel
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Says how likely it is at every place that the frame comes again, because the robot stands or although it goes on.

    A frame that shows its place comes again where the robot stands, or where the next place of the map looks just the
    same. One that says nothing of its place (the share of `outlier` in its ratio) comes again on the way as well.

    Args:
        ratios: ...×N, of `likelihood_ratios`.
        model: The assumptions.

    Returns:
        ...×1×N: standing; and ...×3×N: going on, by gait.
    """
    shows = 1 - model.outlier * ratios.mean(axis=-1, keepdims=True) / ratios
    alike = np.exp(-np.square(np.diff(np.log(ratios)) / _ALIKE) / 2)
    going = (model.blank * (1 - shows))[..., None, :].repeat(len(GAITS), axis=-2)
    for gait, way in enumerate(GAITS):
        here = slice(None, -1) if way > 0 else slice(1, None)
        going[..., gait, here] += shows[..., here] * alike
    return model.stand * shows[..., None, :], going
