"""Sums over vectors from which mean and covariance follow: they add up over blocks, drives and machines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk

__all__ = ["Moments"]

_ROWS = 1024  # vectors handled at once in double precision


@dataclass(frozen=True, eq=False)
class Moments:
    """The weighted sums of order 0, 1 and 2 of vectors of F numbers.

    What was added can be taken away again by adding up the other parts; sums are in double precision.

    Attributes:
        weight: Sum of the weights, at least 0.
        total: (F,), the weighted sum.
        products: F×F, the weighted sum of outer products, symmetric.
    """

    weight: float
    total: NDArray[np.float64]
    products: NDArray[np.float64]

    @classmethod
    def none(cls, features: int) -> Moments:
        """Those of no vector."""
        return cls(0.0, np.zeros(features), np.zeros((features, features)))

    @classmethod
    def of(cls, vectors: NDArray[np.floating], weights: NDArray[np.float64] | None = None) -> Moments:
        """Those of vectors.

        Args:
            vectors: N×F.
            weights: (N,), at least 0; None: 1 each.
        """
        count, features = vectors.shape
        weighted = np.ones(count) if weights is None else weights
        total = np.zeros(features)
        # Of a symmetric matrix only one half is computed, and mirrored at the end.
        half = np.zeros((features, features), order="F")
        for start in range(0, count, _ROWS):
            rows = slice(start, start + _ROWS)
            scaled = vectors[rows] * np.sqrt(weighted[rows])[:, None]
            total += weighted[rows] @ vectors[rows]
            half = dsyrk(1.0, scaled.T, beta=1.0, c=half, lower=1, overwrite_c=1)
        products = half + half.T
        products[np.diag_indices(features)] /= 2
        return cls(float(weighted.sum()), total, products)

    def __add__(self, other: Moments) -> Moments:
        """Those of the vectors of both."""
        return Moments(self.weight + other.weight, self.total + other.total, self.products + other.products)

    @property
    def features(self) -> int:
        """F."""
        return len(self.total)

    @property
    def mean(self) -> NDArray[np.float64]:
        """(F,); zeros of no vector."""
        return self.total / max(self.weight, np.finfo(np.float64).tiny)

    def second_moment(self) -> NDArray[np.float64]:
        """F×F: the mean outer product, about 0; zeros of no vector."""
        return self.products / max(self.weight, np.finfo(np.float64).tiny)

    def covariance(self) -> NDArray[np.float64]:
        """F×F: the mean outer product about the mean; zeros of no vector."""
        mean = self.mean
        return self.second_moment() - np.outer(mean, mean)
