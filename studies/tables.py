"""Cells of the tables."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from typing import Any

SCORES: dict[str, Callable[[dict[str, Any]], float]] = {
    "recall@1": lambda of: float(of["recall_at"]["1"]),
    "recall@5": lambda of: float(of["recall_at"]["5"]),
    "recall@10": lambda of: float(of["recall_at"]["10"]),
    "auc_pr": lambda of: float(of["auc_pr"]),
    "AP": lambda of: float(of["average_precision"]),
    "R@100%P": lambda of: float(of["recall_at_100_precision"]),
    "EP": lambda of: float(of["extended_precision"]),
}
"""How metrics.json says each score, by its column."""


def spread(values: Sequence[float], digits: int = 3) -> str:
    """The mean over seeds and its standard deviation; a value that is the same for all stands alone."""
    mean = f"{statistics.mean(values):.{digits}f}"
    return f"{mean} ± {statistics.stdev(values):.{digits}f}" if len(set(values)) > 1 else mean
