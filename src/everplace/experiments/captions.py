"""The words in which reports and pictures say what was asked of what, how it was compared and what counted as right."""

from __future__ import annotations

from everplace.describe.files.descriptors import Metric
from everplace.match.matching import Matching
from everplace.scoring.retrieval import MatchRule

__all__ = [
    "UNKNOWN",
    "match_caption",
    "match_note",
    "matching_words",
    "matrix_caption",
    "pair_words",
    "right_words",
    "score_words",
]

UNKNOWN = "what is right is not known"
"""What pictures say where the traverses are not aligned."""

_SCORES: dict[Metric, str] = {
    "cosine": "cosine similarity",
    "mean-absolute-difference": "negative mean absolute difference",
    "place-posterior": "log probability of the place",
}


def pair_words(query: str, database: str) -> str:
    """Which traverse asks and which one answers."""
    return f"query {query}, database {database}"


def right_words(truth: MatchRule) -> str:
    """Which matches count as right: a part of a sentence, such as "within ±1 frames"."""
    if truth.pairs is not None:
        return f"among the {truth}"
    return f"within {truth}" if truth.radius is None else str(truth)


def score_words(metric: Metric, matching: Matching) -> str:
    """What the number of a match is."""
    if matching.sequence > 1:
        of = {"filter": "log-odds", "seqslam": "score", "mean": f"mean {_SCORES[metric]}"}[matching.sequence_method]
        return f"{of} over sequences of {matching.sequence}"
    return _SCORES[metric]


def matching_words(matching: Matching) -> str:
    """How descriptors were compared."""
    return "descriptors compared as they are" if matching == Matching() else str(matching)


def match_note(truth: MatchRule | None, score: str) -> str:
    """What a gallery of matches says of its signs and numbers; `score` as of `score_words`."""
    if truth is None:
        return f"{UNKNOWN}; number: {score}"
    return f"right: {right_words(truth)}; number: {score}"


def match_caption(truth: MatchRule | None, score: str) -> str:
    """How to read a gallery of matches; `score` as of `score_words`."""
    if truth is None:
        return f"Best matches, spread over the queries; {UNKNOWN}. The number below a proposed frame: {score}."
    return (
        f"Right and wrong matches. A proposed frame counts as right {right_words(truth)}, so it need not be the very "
        f"frame that stands as the true one; the number below it: {score}."
    )


def matrix_caption(query: str, database: str, truth: MatchRule | None, score: str) -> str:
    """How to read a similarity matrix; `score` as of `score_words`."""
    read = (
        f"Each row is a frame of the query {query}, each column one of the database {database}; the brighter, the more "
        f"alike ({score})."
    )
    if truth is None:
        return f"{read} Ring: the best match of a query; {UNKNOWN}. Wanted: one bright line, and the rings on it."
    return (
        f"{read} White outline: the frames that count as right, {right_words(truth)}. Ring: the best match "
        "of a query, where it is right; cross: where it is wrong. Wanted: bright within the outline and dark elsewhere."
    )
