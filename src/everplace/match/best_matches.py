"""The best matches of every query under the options of the match."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors
from everplace.match.similarity import best_columns, similarity, top_k
from everplace.match.standardise import Standardisation, standardise
from everplace.sequences.sequence_search import SequenceMethod, search_sequences

__all__ = ["best_matches", "compared"]


def compared(
    query: Descriptors, database: Descriptors, standardised: Standardisation | None
) -> tuple[Descriptors, Descriptors]:
    """The two sides as they are compared: each standardised by its own mean (and spread), or as they are."""
    if standardised is None:
        return query, database
    return standardise(query, standardised), standardise(database, standardised)


def best_matches(
    query: Descriptors,
    database: Descriptors,
    k: int,
    *,
    standardised: Standardisation | None = None,
    sequence: int = 1,
    sequence_method: SequenceMethod = "filter",
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Finds the K best database frames of every query, best first; equal scores go to the lower index.

    Without sequences the M×N similarity is never held; with them it is.

    Args:
        query: M descriptors.
        database: N descriptors.
        k: Matches for each query; at most N are returned.
        standardised: See `everplace.match.standardise`.
        sequence: Number of last frames that score each place; 1 scores every frame alone.
        sequence_method: See `everplace.sequences.sequence_search`.

    Returns:
        Indices and scores, M×min(k, N).

    Raises:
        ConfigError: `k` or `sequence` is below 1.
        DescriptorsError: The two do not come from the same method, settings and dimension.
    """
    query, database = compared(query, database, standardised)
    if sequence == 1:
        return top_k(query, database, k)
    return best_columns(search_sequences(similarity(query, database), sequence, sequence_method), k)
