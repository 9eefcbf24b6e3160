"""metrics.csv: rows in order, continued by a resumed run."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from everplace.errors import CheckpointError
from everplace.training.metrics_table import METRICS_FILE, MetricsTable, read_metrics


def test_rows_come_back_by_column(tmp_path: Path) -> None:
    table = MetricsTable(tmp_path, keep_epochs=0)
    table.append({"epoch": 1.0, "seconds": 0.5, "bound": -1234.5678, "private": 3.0})
    table.append({"epoch": 2.0, "seconds": 1.5, "bound": -1.25, "held_out_recall_at_1": 0.75})
    metrics = read_metrics(tmp_path)
    assert metrics["epoch"].tolist() == [1, 2]
    assert metrics["bound"].tolist() == [-1234.57, -1.25]
    assert math.isnan(metrics["held_out_recall_at_1"][0])
    assert metrics["held_out_recall_at_1"][1] == 0.75
    assert np.isnan(metrics["place"]).all()
    assert "private" not in metrics
    assert (tmp_path / METRICS_FILE).read_text().startswith("epoch,seconds,learning_rate,bound,")


def test_a_resumed_run_keeps_the_rows_it_does_not_repeat(tmp_path: Path) -> None:
    first = MetricsTable(tmp_path, keep_epochs=0)
    for epoch in range(1, 5):
        first.append({"epoch": epoch, "bound": -epoch})
    resumed = MetricsTable(tmp_path, keep_epochs=2)
    resumed.append({"epoch": 3, "bound": -30})
    assert read_metrics(tmp_path)["bound"].tolist() == [-1, -2, -30]


def test_a_run_from_the_start_forgets_old_rows(tmp_path: Path) -> None:
    MetricsTable(tmp_path, keep_epochs=0).append({"epoch": 1, "bound": -1})
    MetricsTable(tmp_path, keep_epochs=0).append({"epoch": 1, "bound": -2})
    assert read_metrics(tmp_path)["bound"].tolist() == [-2]


@pytest.mark.parametrize("text", ["a,b\n1,2\n", "epoch,bound\nx,1\n", "epoch,bound\n1,low\n", "epoch\n1,2,3\n"])
def test_what_is_no_table_of_metrics_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / METRICS_FILE).write_text(text)
    with pytest.raises(CheckpointError, match=r"metrics\.csv is no table of metrics"):
        read_metrics(tmp_path)


def test_a_missing_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"metrics\.csv cannot be read"):
        read_metrics(tmp_path)
