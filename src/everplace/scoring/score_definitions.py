"""What each score is, in one sentence: what tables and reports say beside the numbers of `everplace.scoring.scores`."""

from __future__ import annotations

__all__ = ["SCORE_DEFINITIONS"]

SCORE_DEFINITIONS = {
    "pair": "Each frame of the query traverse asks the whole database traverse; every ordered pair is a pair.",
    "curve": "Each query proposes its best database frame; precision = correct proposals / proposals, recall = correct "
    "proposals / queries that have a true match, one point for each distinct score.",
    "recall@N": "Share of the queries that have a true match for which one is among the N best database frames.",
    "auc_pr": "Area under the curve: trapezoids over recall, and the rectangle from recall 0 to the first point.",
    "AP": "Average precision over all pairs of a query and a database frame, as scikit-learn's.",
    "R@100%P": "Largest recall of the curve that is reached without a wrong proposal.",
    "EP": "Extended precision: mean of the precision at the lowest recall and R@100%P.",
}
"""By the score's column in the tables."""
