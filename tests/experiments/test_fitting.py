"""The methods of a study: named, opened, fitted."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.experiments.comparing import untrained_run

from everplace.data.route import open_route
from everplace.experiments.fitting import fit_and_open

SMALL = {"epochs": 1, "image_size": (32, 32), "held_out_gap": 0, "batch_size": 4, "fully_connected": False}
"""Settings with which a network is fitted to the first places of the tiny route in a moment."""


@pytest.mark.slow
@pytest.mark.parametrize("run_first", [True, False])
def test_a_run_named_like_a_fitted_method_stands_beside_it(tiny_route: Path, tmp_path: Path, run_first: bool) -> None:
    other = str(untrained_run(tmp_path / "other" / "cae"))
    methods = [other, "cae"] if run_first else ["cae", other]
    ready = fit_and_open(open_route(tiny_route), methods, "0:8", tmp_path / "out", settings=SMALL)
    fitted = str(tmp_path / "out" / "runs" / "cae")
    assert ready.sources == ({"cae": other, "cae-2": fitted} if run_first else {"cae": fitted, "cae-2": other})
    assert list(ready.describers) == ["cae", "cae-2"]


def test_a_run_is_called_by_the_name_of_its_directory(
    tiny_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = untrained_run(tmp_path / "mine")
    untrained_run(run / "cae")
    (run / "sub").mkdir()
    (tmp_path / "linked").symlink_to(run)
    monkeypatch.chdir(run)
    methods = [".", "sub/..", "../linked", "../mine", str(run), "./cae", "hog", "hog"]
    ready = fit_and_open(open_route(tiny_route), methods, "", tmp_path / "out", settings={})
    assert list(ready.describers) == ["mine", "mine-2", "linked", "mine-3", "mine-4", "cae", "hog"]
