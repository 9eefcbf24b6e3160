"""How descriptors are matched: standardised or not, frame by frame or over sequences, and what comes out best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.choices import SequenceMethod, Standardisation
from everplace.describe.files.descriptors import Descriptors
from everplace.match.similarity import best_columns, similarity, top_k
from everplace.match.standardise import standardise
from everplace.sequences.sequence_search import search_sequences

__all__ = ["Matching", "best_matches", "compare_descriptors"]


@dataclass(frozen=True)
class Matching:
    """Options of the match; each is named wherever a result of it is.

    Attributes:
        standardise: Subtract each traverse's mean descriptor (`centre`), also divide by its spread (`full`).
        sequence: Number of last frames that score each place; 1: frame by frame.
        sequence_method: How, see `everplace.sequences.sequence_search`.
    """

    standardise: Standardisation | None = None
    sequence: int = 1
    sequence_method: SequenceMethod = "filter"

    def metrics(self) -> dict[str, str | int | None]:
        """What metrics.json says of the match."""
        return {
            "standardise": self.standardise,
            "sequence": self.sequence,
            "sequence_method": self.sequence_method if self.sequence > 1 else None,
        }

    def __str__(self) -> str:
        parts = [f"standardised ({self.standardise})"] if self.standardise else []
        if self.sequence > 1:
            counted = ", stops not counted" if self.sequence_method == "filter" else ""
            parts.append(f"sequences of {self.sequence} ({self.sequence_method}{counted})")
        return ", ".join(parts) or "plain"


def compare_descriptors(query: Descriptors, database: Descriptors, matching: Matching) -> NDArray[np.floating[Any]]:
    """Scores every query against every database frame, under the options of the match.

    Args:
        query: M descriptors.
        database: N descriptors of the same method and settings.
        matching: The options; each side is standardised by its own traverse.

    Returns:
        M×N, higher = more alike.

    Raises:
        ConfigError: The descriptors are words, which cannot be standardised, or the sequence is shorter than 1.
        DescriptorsError: The two do not come from the same method, settings and dimension.
    """
    S = similarity(*_standardised(query, database, matching))
    return S if matching.sequence == 1 else search_sequences(S, matching.sequence, matching.sequence_method)


def best_matches(
    query: Descriptors, database: Descriptors, k: int, matching: Matching
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Finds the K best database frames of every query, best first; equal scores go to the lower index.

    Without sequences the M×N similarity is never held; with them it is.

    Args:
        query: M descriptors.
        database: N descriptors.
        k: Matches for each query; at most N are returned.
        matching: As for `compare_descriptors`, as are the errors.

    Returns:
        Indices and scores, M×min(k, N).

    Raises:
        ConfigError: `k` is below 1.
    """
    if matching.sequence == 1:
        return top_k(*_standardised(query, database, matching), k)
    return best_columns(compare_descriptors(query, database, matching), k)


def _standardised(query: Descriptors, database: Descriptors, matching: Matching) -> tuple[Descriptors, Descriptors]:
    if matching.standardise is None:
        return query, database
    return standardise(query, matching.standardise), standardise(database, matching.standardise)
