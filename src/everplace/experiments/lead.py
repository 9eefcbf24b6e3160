"""The sentences that reports begin with: what was found, and what the sequences did to it."""

from __future__ import annotations

from collections.abc import Mapping

from everplace.experiments.captions import matching_words
from everplace.match.matching import Matching
from everplace.scoring.retrieval import Retrieval
from everplace.scoring.scores import Scores

__all__ = ["comparison_lead", "evaluation_lead", "sequence_sentence"]


def evaluation_lead(result: Retrieval, label: str) -> str:
    """What one method found between two traverses.

    Args:
        result: What was found.
        label: What the report calls the method.
    """
    query, database = result.query.name, result.database.name
    if result.scores is None:
        return (
            f"{label} proposes a frame of {database} for each of the {len(result.query):,} frames of {query}; which "
            "proposals are right, nobody knows."
        )
    sought, scores = result.scores.queries_with_match, result.scores
    first, five = (round(scores.recall_at[count] * sought) for count in (1, 5))
    return (
        f"{label} finds {first:,} of {sought:,} places of {query} in {database} at its first guess "
        f"({_percent(scores.recall_at[1])}), and {five:,} among its first five."
    )


def comparison_lead(found: Mapping[str, float], pairs: int) -> str:
    """Which of several methods finds most.

    Args:
        found: Recall@1 by label, the mean over all pairs.
        pairs: How many ordered pairs of conditions there are.
    """
    best, *others = sorted(found, key=lambda label: -found[label])  # of equals the first of the table
    over = "both directions" if pairs == 2 else f"{pairs} pairs of conditions"
    lead = f"{best} finds most: {_percent(found[best])} of the places at its first guess, in the mean over {over}"
    return lead + (f"; then {', '.join(f'{one} {_percent(found[one])}' for one in others)}." if others else ".")


def sequence_sentence(matching: Matching, alone: Mapping[str, Scores], together: Mapping[str, Scores]) -> str:
    """What matching over sequences changed; empty where frames were matched one by one.

    Args:
        matching: How descriptors were compared.
        alone: Scores frame by frame, by what they are of.
        together: Those over sequences.
    """
    if matching.sequence == 1 or not alone:
        return ""
    changes = [
        f"{of}: recall@1 {alone[of].recall_at[1]:.3f} without and {together[of].recall_at[1]:.3f} with them, auc_pr "
        f"{alone[of].auc_pr:.3f} and {together[of].auc_pr:.3f}"
        for of in alone
    ]
    return f"Places are scored over {matching_words(matching)}; {'; '.join(changes)}."


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
