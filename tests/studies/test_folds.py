"""The study of folds: no model is tested on what it saw, and the whole of it on a small route."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from studies.folds import FOLDS, GAP, cut
from studies.paired import Found, together

from everplace.errors import RouteError
from everplace.model.checkpoint import load_checkpoint


@given(st.integers(FOLDS * GAP, 20_000))
def test_the_folds_cover_all_places_once_and_the_longest_rest_is_trained_on(places: int) -> None:
    folds = cut(places)
    assert [place for fold in folds for place in range(fold.start, fold.end)] == list(range(places))
    for fold in folds:
        first, last = map(int, fold.trained.split(":"))
        gap = max(first - fold.end, fold.start - last)
        assert gap == GAP
        assert last - first == max(fold.start, places - fold.end) - GAP


def test_too_few_places_are_refused() -> None:
    with pytest.raises(RouteError, match="99 places here, too few for 5 folds"):
        cut(FOLDS * GAP - 1)


def test_drives_through_all_folds_keep_their_places_apart() -> None:
    parts = [
        Found(np.array([0, 1]), np.array([True, False])),
        Found(np.array([0, 0, 2]), np.array([False, True, True])),
    ]
    whole = together(parts, [0, 2])
    assert whole.place.tolist() == [0, 1, 2, 2, 4]
    assert whole.right.tolist() == [True, False, False, True, True]


@pytest.mark.slow
def test_every_fold_is_tested_by_a_model_that_never_saw_it(
    make_landscapes: Callable[[Path, int], Path], run_study: Callable[..., None], tmp_path: Path
) -> None:
    make_landscapes(tmp_path / "nordland64", 203)
    options = ["--seeds", "3", "--epochs", "1", "--drives", "2", "--length", "4"]
    run_study("folds", tmp_path, tmp_path / "out", *options)
    runs = sorted((tmp_path / "out" / "runs").iterdir())
    assert len(runs) == FOLDS
    for run in runs:
        _, start, _, end, _, seed = run.name.split("-")
        seen = load_checkpoint(run).seen_stems
        assert seen
        assert not seen & {str(place) for place in range(int(start) - GAP, int(end) + GAP)}
        assert seed == "3"
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert list(metrics) == ["`best`, seed 3", "HOG"]
    for of in metrics.values():
        one = of["all places"]
        places = [40, 41, 40, 41, 41]
        assert one["recorded"] == pytest.approx(np.average([fold["recorded"] for fold in of["folds"]], weights=places))
        assert one["difference"] == pytest.approx(one["resampled"] - one["recorded"])
        single = [fold["one frame"][0] for fold in of["folds"]]
        assert one["one frame"] == pytest.approx(np.average(single, weights=places))
        assert one["one frame"] > 0.9
    table = (tmp_path / "out" / "table.md").read_text()
    assert "| 162:203 | 0:142 | `best`, seed 3 |" in table
    assert "| 0:40 | none | HOG |" in table
