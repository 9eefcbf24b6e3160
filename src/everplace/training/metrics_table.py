"""metrics.csv: one row an epoch, written whole, continued by a resumed run."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import CheckpointError
from everplace.files import readable, write_text
from everplace.model.posterior import BLOCKS

__all__ = ["METRICS_FILE", "MetricsTable", "read_metrics"]

METRICS_FILE = "metrics.csv"

_COLUMNS = (
    "epoch",
    "seconds",
    "learning_rate",
    "bound",
    "image",
    "condition",
    "place",
    *(f"kl_{block}" for block in BLOCKS),
    *(f"active_{block}" for block in BLOCKS),
    "sigma",
    "held_out_bound",
    "held_out_recall_at_1",
    "held_out_auc_pr",
)


class MetricsTable:
    """The rows of metrics.csv; a value that an epoch does not have stays empty."""

    def __init__(self, run: Path, keep_epochs: int) -> None:
        self._path = run / METRICS_FILE
        self._rows: list[dict[str, str]] = []
        if keep_epochs and self._path.is_file():
            rows = [row for row in _read_rows(self._path) if int(row["epoch"]) <= keep_epochs]
            self._rows = [{name: row.get(name, "") for name in _COLUMNS} for row in rows]

    def append(self, row: dict[str, float]) -> None:
        """Adds an epoch and writes the file anew.

        Raises:
            StorageError: Writing failed; the file is as it was.
        """
        self._rows.append({key: f"{value:.6g}" for key, value in row.items() if key in _COLUMNS})
        text = io.StringIO()
        writer = csv.DictWriter(text, _COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._rows)
        write_text(self._path, text.getvalue())


def read_metrics(run: Path) -> dict[str, NDArray[np.float64]]:
    """Reads metrics.csv by column, one value an epoch; what is empty becomes NaN.

    Raises:
        CheckpointError: The file is missing or is no table of numbers.
    """
    path = run / METRICS_FILE
    rows = _read_rows(path)
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in (rows[0] if rows else _COLUMNS)}


def _read_rows(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        for row in rows:
            int(row["epoch"])
            for value in row.values():
                float(value or "nan")
    except OSError as error:
        raise CheckpointError(f"{readable(path)} cannot be read ({error.strerror}); train the run again") from None
    except (KeyError, TypeError, ValueError):
        raise CheckpointError(f"{readable(path)} is no table of metrics; restore it or train again") from None
    return rows
