"""Self-teaching on a rendered route: right pairs however the drive went, and none where it went elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies.teaching import Views, measure, trials, views_of

from everplace.describe.registry import open_describer
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import Route, open_route

pytestmark = pytest.mark.slow
MOST = {
    "as driven": 0.6,
    "0.5 to 2 times as fast": 0.6,
    "with stops": 0.5,
    "a third in reverse": 0.5,
    "with a detour of a fifth": 0.55,
    "camera turned by 2 degrees": 0.25,
    "camera turned by 4 degrees": 0.0,
    "camera turned by 6 degrees": 0.0,
    "the same drive twice": 0.6,
    "map with a loop": 0.5,
    "map there and back": 0.0,
    "map with a stop of 500 frames": 0.55,
    "the same with the noise of a camera": 0.55,
    "one along the route, one of elsewhere": 0.6,
}
"""Share of a drive's frames that has to be learnt from, by trial."""


@pytest.fixture(scope="session")
def views(tmp_path_factory: pytest.TempPathFactory) -> Views:
    """300 places in summer and winter, and 80 of another world in winter, by few numbers."""

    def world(name: str, **options: Any) -> Route:
        out = tmp_path_factory.mktemp("worlds") / name
        render_route(out, render_config({"size": (32, 64), **options}))
        return open_route(out)

    here = world("here", places=300, conditions=("summer", "winter"), seed=3)
    there = world("there", places=80, conditions=("winter",), seed=4)
    described = views_of(open_describer("hog16"), here["summer"], here["winter"], there["winter"], 140, 145)
    return described.reduced(256)


@pytest.fixture(scope="session")
def measured(views: Views) -> dict[str, dict[str, Any]]:
    return {trial.what: measure(trial, views, 48) for trial in trials(views)}


@pytest.mark.parametrize("what", MOST)
def test_pairs_are_right_and_teach(measured: dict[str, dict[str, Any]], what: str) -> None:
    row = measured[what]
    assert row["recall"] >= MOST[what]
    assert row["precision"] is None or row["precision"] > 0.9
    assert row["taught"] >= row["alone"] - 0.05


def test_a_drive_of_elsewhere_teaches_nothing(measured: dict[str, dict[str, Any]]) -> None:
    row = measured["a drive of elsewhere"]
    assert (row["pairs"], row["precision"], row["recall"]) == (0, None, None)
    assert row["taught"] == row["alone"]
    beside, without = measured["one along the route, one of elsewhere"], measured["as driven"]
    assert (beside["pairs"], beside["taught"]) == (without["pairs"], without["taught"])


def test_what_was_driven_is_learnt_from(measured: dict[str, dict[str, Any]]) -> None:
    assert measured["as driven"]["taught"] > measured["as driven"]["alone"]
    assert measured["the same drive twice"]["taught"] == pytest.approx(measured["as driven"]["taught"], abs=0.04)


def test_a_stop_of_the_map_does_not_change_what_one_drive_knows(measured: dict[str, dict[str, Any]]) -> None:
    assert measured["map with a stop of 500 frames"]["alone"] == measured["as driven"]["alone"]


def test_every_trial_is_tested(views: Views) -> None:
    made = trials(views)
    assert {trial.what for trial in made} == {*MOST, "a drive of elsewhere"}
    assert len(made) == len(MOST) + 1
    for trial in made:
        for drive in (*trial.drives, *([trial.map_drive] if trial.map_drive else [])):
            assert drive.values.shape == (len(drive.places), 256)
            assert drive.places.max() < 300
            same = drive.places >= 0
            assert "turned" in trial.what or np.isin(drive.places[same], np.arange(300)).all()


def test_the_study_writes_a_table(shared_data: Path, run_study: Callable[..., None], tmp_path: Path) -> None:
    run_study("teaching", shared_data, tmp_path / "out", "--dimensions", "24", "--only", "a drive of elsewhere")
    table = (tmp_path / "out" / "table.md").read_text()
    assert "| a drive of elsewhere | " in table
    assert "as driven" not in table
