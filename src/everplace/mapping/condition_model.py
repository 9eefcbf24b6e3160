"""Which of a map's conditions a frame shows, or that it shows none of them: linear discriminant analysis.

A condition not seen before is another thing than a place the map does not know: the first is told by how a frame looks
(`everplace.mapping.image_statistics`), the second by how it scores (`everplace.mapping.calibration`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.special
from numpy.typing import NDArray

from everplace.errors import CheckpointError, DescriptorsError
from everplace.mapping.reliability import STRETCH

__all__ = ["ConditionModel"]

_RIDGE = 0.02
"""Added to the variance of every feature, in units of its variance within conditions."""
_SEEN = 0.995
"""Share of a condition's frames that lie within its limit. The last few are tunnels and the like, far outside."""
_LEAST = 1e-4
"""Standard deviation below which a feature does not vary: a thirtieth of a step of 8 bits."""


@dataclass(frozen=True, eq=False)
class ConditionModel:
    """Normal distributions of features, one a condition, with one covariance.

    Attributes:
        conditions: K names.
        means: (K, F).
        precision: F×F, the inverse of the covariance.
        limits: (K,) squared Mahalanobis distance within which a condition's frames lie.
    """

    conditions: tuple[str, ...]
    means: NDArray[np.float64]
    precision: NDArray[np.float64]
    limits: NDArray[np.float64]

    @classmethod
    def fit(cls, features: NDArray[np.floating[Any]], conditions: Sequence[str]) -> ConditionModel:
        """Fits it to the frames of a map.

        The limits are those of stretches of 24 frames that the fit did not see, so that other places of a known
        condition stay within them.

        Args:
            features: N×F, the frames of each condition in the order of travel.
            conditions: N names; one condition is enough.

        Raises:
            DescriptorsError: There is no frame, or not one condition for each.
        """
        X = np.asarray(features, np.float64)
        if X.ndim != 2 or not len(X) or len(X) != len(conditions):
            raise DescriptorsError(
                f"features of shape {X.shape} with {len(conditions)} conditions make no model; give one for each frame"
            )
        names = tuple(dict.fromkeys(conditions))
        of = np.array([names.index(condition) for condition in conditions])
        stretch = np.empty(len(X), np.int64)
        for number in range(len(names)):
            stretch[of == number] = np.arange((of == number).sum()) // STRETCH
        distances = np.empty(len(X))
        for half in (0, 1):
            held = stretch % 2 == half
            # A condition of one stretch has no other frames to be seen from.
            rest = ~held if set(of[~held].tolist()) == set(range(len(names))) else np.ones(len(X), bool)
            means, precision = _normal(X[rest], of[rest], len(names))
            distances[held] = _distances(X[held], means, precision)[np.arange(held.sum()), of[held]]
        limits = [float(np.quantile(distances[of == number], _SEEN)) for number in range(len(names))]
        return cls(names, *_normal(X, of, len(names)), np.array(limits))

    def posterior(self, features: NDArray[np.floating[Any]]) -> dict[str, float]:
        """The probability of every known condition, if the frame shows one of them.

        Args:
            features: (F,).

        Returns:
            By name; they sum to 1.
        """
        squares = _distances(np.asarray(features, np.float64)[None], self.means, self.precision)[0]
        return dict(zip(self.conditions, scipy.special.softmax(-squares / 2).tolist(), strict=True))

    def unseen(self, features: NDArray[np.floating[Any]]) -> bool:
        """Whether a frame looks like none of the known conditions.

        Args:
            features: (F,).
        """
        return bool(self.unseen_rows(np.asarray(features)[None])[0])

    def unseen_rows(self, features: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
        """`unseen` of each of N frames.

        Args:
            features: N×F.
        """
        squares = _distances(np.asarray(features, np.float64), self.means, self.precision)
        outside: NDArray[np.bool_] = np.all(squares > self.limits, axis=1)
        return outside

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What is saved; no array holds objects."""
        return {
            "conditions": np.array(self.conditions),
            "means": self.means,
            "precision": self.precision,
            "limits": self.limits,
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> ConditionModel:
        """Reads what `to_arrays` gave.

        Raises:
            CheckpointError: An array is missing or does not fit the others.
        """
        damaged = CheckpointError("the map's model of conditions is damaged; fit it again")
        try:
            names = tuple(map(str, arrays["conditions"].tolist()))
            means, precision, limits = (
                np.asarray(arrays[name], np.float64) for name in ("means", "precision", "limits")
            )
        except (KeyError, AttributeError, TypeError, ValueError):
            raise damaged from None
        features = means.shape[-1] if means.ndim == 2 else -1
        fits = means.shape[:1] == limits.shape == (len(names),) and precision.shape == (features, features)
        if not names or not fits:
            raise damaged
        return cls(names, means, precision, limits)


def _normal(
    X: NDArray[np.float64], of: NDArray[np.int64], conditions: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means of the conditions, and the inverse of the covariance that they share; each condition counts alike."""
    means = np.stack([X[of == number].mean(axis=0) for number in range(conditions)])
    away = (X - means[of]) * np.sqrt(1 / (conditions * np.bincount(of, minlength=conditions)))[of, None]
    covariance = away.T @ away
    covariance[np.diag_indices(len(covariance))] *= 1 + _RIDGE
    covariance[np.diag_indices(len(covariance))] += _LEAST**2
    return means, np.linalg.inv(covariance)


def _distances(
    X: NDArray[np.float64], means: NDArray[np.float64], precision: NDArray[np.float64]
) -> NDArray[np.float64]:
    """N×K: squared Mahalanobis distances."""
    away = X[:, None] - means
    squares: NDArray[np.float64] = np.einsum("nkd,de,nke->nk", away, precision, away, optimize=True)
    return squares
