"""Whether a search finds less on other drives than on the recorded one, past the same places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Found", "found_on", "paired_difference", "together"]

STRETCH = 20
"""Places that are drawn together: neighbours are right and wrong together."""

SAMPLES = 10_000


@dataclass(frozen=True)
class Found:
    """What a search found on one drive, of the frames that show a place of the map.

    Attributes:
        place: M: the place that each frame shows.
        right: M: whether it was found.
    """

    place: NDArray[np.int64]
    right: NDArray[np.bool_]


def found_on(S: NDArray[Any], truth: NDArray[np.bool_], shown: NDArray[np.int64]) -> Found:
    """What the best scores find.

    Args:
        S: M×N scores.
        truth: M×N.
        shown: M: the place that each frame shows.
    """
    mapped = truth.any(axis=1)
    return Found(shown[mapped], truth[np.arange(len(S)), S.argmax(axis=1)][mapped])


def together(parts: Sequence[Found], starts: Sequence[int]) -> Found:
    """One drive through all parts; `starts` are the places at which they begin."""
    places = [part.place + start for part, start in zip(parts, starts, strict=True)]
    return Found(np.concatenate(places), np.concatenate([part.right for part in parts]))


def paired_difference(recorded: Found, drives: Sequence[Found]) -> dict[str, float]:
    """The mean recall@1 of other drives less that of the recorded one, and how sure that is.

    Args:
        recorded: Of the drive as recorded.
        drives: Of the others, at least one.

    Returns:
        `difference`; `low` and `high`, its 95 % interval by bootstrap over stretches of 20 places, drawn alike for all
        drives; `no worse`, the share of drives with at least the recall of the recorded one.
    """
    stretches = int(recorded.place.max()) // STRETCH + 1
    before = _by_stretch(recorded, stretches)
    after = np.mean([_by_stretch(drive, stretches) for drive in drives], axis=0)
    shares = np.full(stretches, 1 / stretches)
    drawn = np.random.default_rng(0).multinomial(stretches, shares, SAMPLES)
    low, high = np.quantile(_recall(drawn @ after) - _recall(drawn @ before), (0.025, 0.975))
    recall = float(recorded.right.mean())
    each = np.array([drive.right.mean() for drive in drives])
    return {
        "difference": float(each.mean() - recall),
        "low": float(low),
        "high": float(high),
        "no worse": float((each >= recall).mean()),
    }


def _by_stretch(found: Found, stretches: int) -> NDArray[np.float64]:
    """Stretches×2: the share of a drive's frames that are in each stretch and right, and that are in it."""
    counted = [np.bincount(found.place // STRETCH, weights, stretches) for weights in (found.right, None)]
    return np.stack(counted, axis=1) / len(found.place)


def _recall(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    recall: NDArray[np.float64] = sums[:, 0] / sums[:, 1]
    return recall
