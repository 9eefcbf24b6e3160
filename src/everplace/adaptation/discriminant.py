"""The linear projection that tells places apart whatever their condition, in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse.linalg
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

__all__ = ["PlaceScatter", "Projection", "add_ridge", "leading_directions"]

_WHOLE = 2048
"""Features up to which all of an eigenproblem is reduced; of larger ones only the leading vectors are iterated for."""


@dataclass(frozen=True, eq=False)
class Projection:
    """An affine map of features, x to `weight` x + `bias`.

    Attributes:
        weight: (D, F).
        bias: (D,).
    """

    weight: NDArray[np.float64]
    bias: NDArray[np.float64]

    @classmethod
    def standardised(
        cls, directions: NDArray[np.float64], mean: NDArray[np.float64], second_moment: NDArray[np.float64]
    ) -> Projection:
        """The map along directions whose output has mean 0 and, on average over D, variance 1.

        Args:
            directions: (D, F).
            mean: (F,), of the features it is to be standardised for.
            second_moment: F×F, mean outer product of the same.
        """
        variance = np.einsum("df,fg,dg->d", directions, second_moment, directions, optimize=True)
        variance -= np.square(directions @ mean)
        weight = directions / np.sqrt(max(float(variance.mean()), np.finfo(np.float64).tiny))
        return cls(weight, -weight @ mean)

    def apply(self, features: NDArray[np.floating]) -> NDArray[np.float32]:
        """Maps N×F features to N×D, in single precision."""
        weight, bias = self.weight.astype(np.float32), self.bias.astype(np.float32)
        return features.astype(np.float32, copy=False) @ weight.T + bias


def leading_directions(
    between: NDArray[np.float64], within: NDArray[np.float64], dimensions: int
) -> NDArray[np.float64]:
    """The directions in which places differ most, measured by how much one place differs from itself.

    The leading generalised eigenvectors of B v = λ W v: Fisher's linear discriminant with places as classes.

    Args:
        between: B, F×F, symmetric.
        within: W, F×F, symmetric and positive definite (see `add_ridge`); overwritten.
        dimensions: D, at most F.

    Returns:
        (D, F), the strongest first.
    """
    features = len(within)
    if features <= _WHOLE or 4 * dimensions > features:
        subset = [features - dimensions, features - 1]
        # OpenBLAS's threads wait awake between thousands of short steps, which takes longer than one thread takes for
        # all of them, and many times longer beside other work. (Results differ in the 13th digit.)
        with threadpool_limits(1, user_api="blas"):
            _, vectors = scipy.linalg.eigh(between, within, subset_by_index=subset, overwrite_b=True)
        return vectors.T[::-1]
    lower = scipy.linalg.cholesky(within, lower=True, overwrite_a=True)
    half = scipy.linalg.solve_triangular(lower, between, lower=True)
    whitened = scipy.linalg.solve_triangular(lower, half.T, lower=True, overwrite_b=True)
    start = np.random.default_rng(0).standard_normal(features)  # ARPACK's own would make each call another one
    _, vectors = scipy.sparse.linalg.eigsh(whitened, dimensions, which="LA", v0=start, tol=1e-6)
    return scipy.linalg.solve_triangular(lower, vectors, lower=True, trans="T").T[::-1]


def add_ridge(within: NDArray[np.float64], ridge: float) -> None:
    """Adds ridge tr(W)/F I to W, so that directions are kept out in which a few frames happen to agree (Friedman 1989).

    Args:
        within: W, F×F; changed in place.
        ridge: In units of the mean variance within places; positive.
    """
    features = len(within)
    within[np.diag_indices(features)] += ridge * np.trace(within) / features + np.finfo(np.float64).tiny


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

        Args:
            dimensions: D, at most F.
            ridge: See `add_ridge`; in units of the scatter within places alone, without `nuisance`.
            nuisance: F×F, further scatter that does not tell places apart; counted as scatter within places.

        Returns:
            The projection; over the frames taken in its output has mean 0 and, on average over D, variance 1.
        """
        within = self.within()
        add_ridge(within, ridge)
        if nuisance is not None:
            within += nuisance
        directions = leading_directions(self.between(), within, dimensions)
        frames = self._places * len(self._sums)
        return Projection.standardised(directions, self._sums.sum(axis=0) / frames, self._frames / frames)
