"""The part of a report that helps to choose a threshold."""

from __future__ import annotations

from collections.abc import Mapping

from everplace.report.html import Section
from everplace.report.table_cells import Value
from everplace.scoring.precision_table import AtPrecision, good_enough_for

__all__ = ["precision_section"]


def precision_section(section: Section, label: str, table: Mapping[str, AtPrecision], score: str) -> None:
    """Adds what the matches of a method are good enough for, and the table that says why.

    Args:
        section: Where to.
        label: What the report calls the method.
        table: As of `everplace.scoring.precision_table.precision_table`.
        score: What the threshold is, as of `everplace.experiments.captions.score_words`.
    """
    section.paragraph(f"{label}: {good_enough_for(table)}")
    section.table(
        ["precision", "threshold", "recall", "95 % interval", "accepted", "of them wrong"],
        [_row(name, row) for name, row in table.items()],
        caption=f"{label}: a best match with a score of at least the threshold ({score}) is accepted. The interval of "
        "the recall comes from a bootstrap over stretches of consecutive queries.",
    )


def _row(name: str, row: AtPrecision) -> list[Value]:
    low, high = row.recall_interval
    threshold = "none gives it" if row.threshold is None and not row.accepted else row.threshold
    return [f"{name} %", threshold, row.recall, f"{low:.3f} to {high:.3f}", row.accepted, row.wrong]
