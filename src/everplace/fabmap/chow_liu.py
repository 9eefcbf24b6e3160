"""The Chow-Liu tree: how the words of a vocabulary occur together, as far as pairs can tell.

Chow and Liu, "Approximating Discrete Probability Distributions with Dependence Trees", IEEE Transactions on Information
Theory 14(3), 1968; for words of images Cummins and Newman, "FAB-MAP: Probabilistic Localization and Mapping in the
Space of Appearance", IJRR 27(6), 2008.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ChowLiuTree", "WordCounts", "learn_tree", "mutual_information"]

_KEPT, _FLOOR = 0.98, 0.01
"""A relative frequency f becomes the probability 0.98 f + 0.01, so that nothing is impossible (openFABMAP)."""


@dataclass
class WordCounts:
    """In how many frames each word, and each pair of words, was seen.

    Attributes:
        frames: Number of frames.
        together: W×W float64; the diagonal counts single words.
    """

    frames: int
    together: NDArray[np.float64]

    @classmethod
    def none(cls, words: int) -> WordCounts:
        """Counts of no frame."""
        return cls(0, np.zeros((words, words)))

    def add(self, words: NDArray[Any]) -> None:
        """Counts some frames: B×W, 0 or 1. All pairs are one matrix product."""
        seen = words.astype(np.float32)  # exact: the counts of a block stay far below 2^24
        self.together += seen.T @ seen
        self.frames += len(seen)


@dataclass(frozen=True, eq=False)
class ChowLiuTree:
    """p(z_1 ... z_W) as a product of p(z_q | z_parent(q)), and of p(z_root).

    Attributes:
        parent: (W,) int64, the parent of each word; the root is its own.
        present: (W,) p(z_q = 1), inside (0, 1) like the others.
        after_present: (W,) p(z_q = 1 | z_parent(q) = 1); p(z_q = 1) for the root.
        after_absent: (W,) p(z_q = 1 | z_parent(q) = 0); p(z_q = 1) for the root.
    """

    parent: NDArray[np.int64]
    present: NDArray[np.float64]
    after_present: NDArray[np.float64]
    after_absent: NDArray[np.float64]

    def __len__(self) -> int:
        """Number of words W."""
        return len(self.parent)

    def conditional(self, words: NDArray[np.bool_]) -> NDArray[np.float64]:
        """p(z_q = 1 | z_parent(q)) where the parents are as seen: words M×W to M×W."""
        return np.where(words[:, self.parent], self.after_present, self.after_absent)


def mutual_information(counts: WordCounts) -> NDArray[np.float64]:
    """Mutual information of every pair of words, from relative frequencies.

    Args:
        counts: Of at least one frame.

    Returns:
        W×W in nats, symmetric, at least 0; the diagonal is the entropy of each word.
    """
    n, both = counts.frames, counts.together
    alone = np.diag(both)
    joint = {
        (1, 1): both,
        (1, 0): alone[:, None] - both,
        (0, 1): alone[None, :] - both,
        (0, 0): n - alone[:, None] - alone[None, :] + both,
    }
    marginal = {1: alone / n, 0: 1.0 - alone / n}
    information = np.zeros_like(both)
    for (one, other), seen in joint.items():
        apart = np.outer(marginal[one], marginal[other])
        frequency = seen / n
        ratio = np.divide(frequency, apart, out=np.ones_like(both), where=seen > 0)
        information += frequency * np.log(ratio)
    return np.maximum(information, 0.0)


def learn_tree(counts: WordCounts) -> ChowLiuTree:
    """The tree whose edges carry the most mutual information; its root is an end of the strongest edge.

    Args:
        counts: Of at least one frame.
    """
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    information = mutual_information(counts)
    np.fill_diagonal(information, 0.0)
    root = int(information.max(axis=1).argmax())
    # Positive everywhere: SciPy takes 0 for "no edge", and words without any information must hang somewhere too.
    spanning = minimum_spanning_tree(1.0 + information.max() - information)
    _, before = breadth_first_order(spanning, root, directed=False)
    parent = np.asarray(before, np.int64)
    parent[root] = root
    n, alone = counts.frames, np.diag(counts.together)
    words = np.arange(len(parent))
    both = counts.together[words, parent]
    present = _smoothed(alone, n)
    after_present, after_absent = _smoothed(both, alone[parent]), _smoothed(alone - both, n - alone[parent])
    after_present[root] = after_absent[root] = present[root]
    return ChowLiuTree(parent, present, after_present, after_absent)


def _smoothed(seen: NDArray[np.float64], of: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """A frequency as a probability inside (0, 1); of nothing seen at all it is the smallest."""
    total = np.broadcast_to(np.asarray(of, np.float64), seen.shape)
    smoothed: NDArray[np.float64] = _KEPT * np.divide(seen, total, out=np.zeros_like(seen), where=total > 0) + _FLOOR
    return smoothed
