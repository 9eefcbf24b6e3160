"""The linear projection that tells places apart whatever their condition, in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

__all__ = ["PlaceScatter", "Projection"]


@dataclass(frozen=True, eq=False)
class Projection:
    """An affine map of features, x to `weight` x + `bias`.

    Attributes:
        weight: (D, F).
        bias: (D,).
    """

    weight: NDArray[np.float64]
    bias: NDArray[np.float64]


class PlaceScatter:
    """How features vary from place to place, and at one place from traverse to traverse.

    Places are taken in block by block; only sums are kept, of F×F numbers.
    """

    def __init__(self, traverses: int, features: int) -> None:
        """Starts with no place.

        Args:
            traverses: T, at least 2.
            features: F.
        """
        self._places = 0
        self._sums = np.zeros((traverses, features))
        self._frames = np.zeros((features, features))
        self._merged = np.zeros((features, features))

    def add(self, features: NDArray[np.float32]) -> None:
        """Takes in P places.

        Args:
            features: (T, P, F); row p of every traverse shows the same place.
        """
        frames = features.reshape(-1, features.shape[2]).astype(np.float64)
        merged = features.sum(axis=0, dtype=np.float64)
        self._places += features.shape[1]
        self._sums += features.sum(axis=1, dtype=np.float64)
        self._frames += frames.T @ frames
        self._merged += merged.T @ merged

    def between(self) -> NDArray[np.float64]:
        """F×F: covariance over places of one traverse's features with another's, a mean over all ordered pairs."""
        traverses = len(self._sums)
        means = self._sums / self._places
        total = means.sum(axis=0)
        same = self._frames - self._places * means.T @ means
        pairs: NDArray[np.float64] = self._merged - self._places * np.outer(total, total) - same
        return pairs / (self._places * traverses * (traverses - 1))

    def within(self) -> NDArray[np.float64]:
        """F×F: half the mean outer product of the difference of two traverses at a place, all pairs alike.

        The traverses' means are left in: what a condition changes everywhere is a difference within places. Zeros
        before the first place.
        """
        traverses = len(self._sums)
        if not self._places:
            return np.zeros_like(self._frames)
        other: NDArray[np.float64] = (self._merged - self._frames) / (traverses - 1)
        return (self._frames - other) / (self._places * traverses)

    def discriminant(self, dimensions: int, ridge: float, nuisance: NDArray[np.float64] | None = None) -> Projection:
        """The directions in which places differ most, measured by how much one place differs from itself.

        Fisher's linear discriminant with places as classes; its ridge (Friedman 1989) keeps directions out in which a
        few training frames happen to agree.

        Args:
            dimensions: D, at most F.
            ridge: Added to the scatter within places, in units of its mean variance; positive.
            nuisance: F×F, further scatter that does not tell places apart; counted as scatter within places.

        Returns:
            The projection; over the frames taken in its output has mean 0 and, on average over D, variance 1.
        """
        within = self.within()
        features = len(within)
        within[np.diag_indices(features)] += ridge * np.trace(within) / features + np.finfo(np.float64).tiny
        if nuisance is not None:
            within += nuisance
        _, vectors = scipy.linalg.eigh(
            self.between(), within, subset_by_index=[features - dimensions, features - 1], overwrite_b=True
        )
        weight = vectors.T[::-1]
        frames = self._places * len(self._sums)
        mean = self._sums.sum(axis=0) / frames
        variance = np.einsum("df,fg,dg->d", weight, self._frames / frames, weight, optimize=True)
        variance -= np.square(weight @ mean)
        weight = weight / np.sqrt(max(float(variance.mean()), np.finfo(np.float64).tiny))
        return Projection(weight, -weight @ mean)
