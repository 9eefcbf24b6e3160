"""How descriptors are matched: standardised or not, frame by frame or over sequences, and what comes out best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.choices import ScoreKind, SequenceMethod, Standardisation
from everplace.describe.files.descriptors import Descriptors, Metric
from everplace.errors import ConfigError
from everplace.fabmap.place_posterior import PlacePosterior
from everplace.match.similarity import best_columns, similarity, similarity_blocks, top_k
from everplace.match.standardise import standardise
from everplace.sequences.route_model import RouteModel
from everplace.sequences.sequence_search import search_sequences

__all__ = ["Matches", "Matching", "best_matches", "compare_descriptors", "find_matches"]

_KINDS: dict[Metric, ScoreKind] = {
    "cosine": "cosine",
    "mean-absolute-difference": "negative-difference",
    "place-posterior": "log-probability",
}


@dataclass(frozen=True)
class Matching:
    """Options of the match; each is named wherever a result of it is.

    Attributes:
        standardise: Subtract each traverse's mean descriptor (`centre`), also divide by its spread (`full`), or
            subtract the mean of the frames so far (`running`), as a robot can that is still under way.
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

    def score_kind(self, metric: Metric) -> ScoreKind:
        """What the score of a match is, for descriptors of this metric; a mean over a sequence stays what it is of."""
        if self.sequence == 1 or self.sequence_method == "mean":
            return _KINDS[metric]
        return "log-odds" if self.sequence_method == "filter" else "seqslam"

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


@dataclass(frozen=True, eq=False)
class Matches:
    """The best matches of a drive.

    Attributes:
        indices: M×K into the database, best first.
        scores: M×K; -inf where no frame is left to be a match.
        kind: What the scores are.
        on_map: (M,) probability that the database holds the place at all, where the method knows it.
    """

    indices: NDArray[np.int64]
    scores: NDArray[np.float32]
    kind: ScoreKind
    on_map: NDArray[np.floating[Any]] | None

    def probability(self) -> NDArray[np.float64]:
        """M×K in [0, 1]: that a match shows the place.

        Raises:
            ConfigError: The scores are no probabilities.
        """
        scores = self.scores.astype(np.float64)
        if self.kind == "log-odds":
            return np.asarray(0.5 * (1 + np.tanh(scores / 2)))
        if self.kind == "log-probability":
            return np.asarray(np.exp(scores))
        raise ConfigError(
            f"`min_probability` does not apply: the scores ({self.kind}) are no probabilities; add `sequence` L with "
            "the filter, or describe both with a run of fabmap"
        )

    def accepted(self, min_probability: float | None = None) -> NDArray[np.bool_]:
        """M×K: the matches that exist, and of at least this probability.

        Raises:
            ConfigError: A probability is asked for, but the scores are none.
        """
        exist = self.scores > -np.inf
        return exist if min_probability is None else exist & (self.probability() >= min_probability)


def find_matches(
    query: Descriptors, database: Descriptors, k: int, matching: Matching, *, exclude: int | None = None
) -> Matches:
    """Finds what `best_matches` finds, and how probable it is that there is anything to find.

    Args:
        query: M descriptors.
        database: N descriptors.
        k: Matches for each query.
        matching: As for `compare_descriptors`, as are the errors.
        exclude: Frames nearer than this in one and the same drive are no match, so that a drive that is matched with
            itself shows where it comes back; None: all may match.

    Raises:
        ConfigError: `k` or `exclude` is below 1, or frames are to be excluded and the drives are not the same one.
    """
    kind = matching.score_kind(query.metric)
    if exclude is not None:
        if exclude < 1:
            raise ConfigError(f"`exclude` {exclude} is not possible; give a number of frames of at least 1")
        if query.names != database.names:
            raise ConfigError("`exclude` is for one and the same drive, but the two name other frames; leave it out")
    if matching.sequence > 1:
        S = similarity(*_standardised(query, database, matching))
        _exclude(S, 0, exclude, np.nan)
        S = search_sequences(S, matching.sequence, matching.sequence_method)
        _exclude(S, 0, exclude, -np.inf)
        return Matches(*best_columns(S, k), kind, _on_map(S) if kind == "log-odds" else None)
    new_place = None
    if kind == "log-probability":
        new_place = PlacePosterior(query.values, database.values).log_new_place().astype(np.float64)
    if exclude is None:
        on_map = None if new_place is None else -np.expm1(new_place)
        return Matches(*best_matches(query, database, k, matching), kind, on_map)
    found = []
    for rows, S in similarity_blocks(*_standardised(query, database, matching)):
        _exclude(S, rows.start, exclude, -np.inf)
        if new_place is not None:  # what the excluded places had is shared among those that are left, and a new one
            left = np.logaddexp(np.logaddexp.reduce(S.astype(np.float64), axis=1), new_place[rows])
            np.subtract(S, left[:, None].astype(np.float32), out=S)
            new_place[rows] -= left
        found.append(best_columns(S, k))
    indices, scores = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return Matches(indices, scores, kind, None if new_place is None else -np.expm1(new_place))


def _exclude(S: NDArray[np.floating[Any]], first: int, exclude: int | None, value: float) -> None:
    """Writes a value over the scores of frames that are nearer than `exclude`; row 0 is the frame `first`."""
    if exclude is not None:
        for row in range(len(S)):
            S[row, max(first + row - exclude + 1, 0) : first + row + exclude] = value


def _on_map(log_odds: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """(M,) the probability of all places together, from what each is worth with a share of its neighbours'.

    Both bounds hold from below. The sum is tight but at the ends of the map, where neighbours are missing.
    """
    worth = 0.5 * (1 + np.tanh(log_odds.astype(np.float64) / 2))
    return np.asarray(np.maximum(worth.sum(axis=1) / (1 + 2 * RouteModel().beside), worth.max(axis=1)))


def _standardised(query: Descriptors, database: Descriptors, matching: Matching) -> tuple[Descriptors, Descriptors]:
    if matching.standardise is None:
        return query, database
    start = database.values.mean(axis=0, dtype=np.float64)
    return standardise(query, matching.standardise, start=start), standardise(database, matching.standardise)
