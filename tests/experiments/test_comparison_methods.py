"""The methods of a study: named, opened, fitted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.experiments.comparing import compare, refused, untrained_run

from everplace.errors import CheckpointError, ConfigError, ImageError
from everplace.experiments.comparison_methods import fit_and_open
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import open_route

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


def test_what_a_method_lacks_is_known_before_another_is_fitted(tiny_route: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    fitting = ["--fit-frames", ":6", "--epochs", "1", "--image-size", "32", "32"]
    metrics = compare(tiny_route, out, "--methods", "sad,cae", "--frames", "6:", *fitting)
    assert list(metrics["left_out"]) == ["cae"]
    assert "too few to hold out 2 behind a gap of 10" in metrics["left_out"]["cae"]
    assert f"cae was left out: {metrics['left_out']['cae']}" in (out / "table.md").read_text()
    assert not (out / "runs").exists()
    said = refused(tiny_route, tmp_path / "none", "--methods", "cae,vae", "--frames", "6:", *fitting)
    assert "none of them can run: traverse summer has 6 frames" in said
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_drives_that_are_not_aligned_leave_out_what_needs_the_same_places(tiny_route: Path, tmp_path: Path) -> None:
    (tiny_route / "route.toml").write_text("aligned = false\n")
    methods = ["fabmap", "cp-vae", "cae"]
    ready = fit_and_open(open_route(tiny_route), methods, "0:8", tmp_path / "out", settings=SMALL)
    assert list(ready.describers) == ["cae"]
    assert list(ready.left_out) == ["fabmap", "cp-vae"]  # as they were named
    assert "cp-vae learns from the same places" in ready.left_out["cp-vae"]


@pytest.mark.slow
def test_a_fit_that_fails_leaves_its_method_out_and_may_be_tried_with_other_settings(
    tiny_route: Path, tmp_path: Path
) -> None:
    route, out = open_route(tiny_route), tmp_path / "out"
    for frames in ("0:6", "0:8"):
        ready = fit_and_open(route, ["cae", "fabmap", "hog"][frames == "0:8" :], frames, out, settings=SMALL)
        assert "too few for words = 1500" in ready.left_out["fabmap"]
        assert "other settings" not in ready.left_out["fabmap"]
    assert list(ready.describers) == ["hog"]
    assert [path.name for path in (out / "runs").iterdir()] == ["cae"]


def test_a_damaged_image_is_to_be_repaired_and_leaves_no_method_out(tiny_route: Path, tmp_path: Path) -> None:
    image = tiny_route / "summer" / "0.png"
    image.write_bytes(image.read_bytes()[:60])
    with pytest.raises(ImageError, match=r"0\.png"):
        fit_and_open(open_route(tiny_route), ["cae", "hog"], "0:8", tmp_path / "out", settings=SMALL)


@pytest.mark.slow
def test_other_settings_are_refused_before_anything_is_fitted(tiny_route: Path, tmp_path: Path) -> None:
    route, out = open_route(tiny_route), tmp_path / "out"
    fit_and_open(route, ["vae"], "0:8", out, settings=SMALL)
    with pytest.raises(
        ConfigError, match=r"out holds a study with other settings \(vae: seed was 0 and is now 1\); name"
    ):
        fit_and_open(route, ["cae", "vae"], "0:8", out, settings={**SMALL, "seed": 1})
    assert not (out / "runs" / "cae").exists()
    (tiny_route / "summer" / "0.png").write_bytes((tiny_route / "summer" / "1.png").read_bytes())
    with pytest.raises(ConfigError, match=r"other settings \(vae: was trained on other images than .*tiny\); name"):
        fit_and_open(route, ["vae", "hog"], "0:8", out, settings=SMALL)
    (out / "runs" / "vae" / "config.toml").write_text("a = [")
    with pytest.raises(CheckpointError, match=r"config\.toml was not written by this version"):
        fit_and_open(route, ["vae", "hog"], "0:8", out, settings=SMALL)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--minutes", "-1"], "--minutes: Input should be greater than 0, not -1.0"),
        (["--minutes", "1", "--epochs", "1"], "--epochs and --minutes exclude each other"),
        (["--image-size", "33", "64"], "--image-size: 33x64 is not a multiple of 32"),
        (["--seed", str(2**32)], "--seed: Input should be less than"),
    ],
)
def test_settings_of_fitting_are_checked_where_nothing_is_fitted(
    unchanged_tiny_route: Path, tmp_path: Path, options: list[str], says: str
) -> None:
    assert says in refused(unchanged_tiny_route, tmp_path / "out", "--methods", "sad", *options)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_method_that_is_fitted_is_added_to_a_comparison_in_which_none_was(tmp_path: Path) -> None:
    route, out = tmp_path / "route", tmp_path / "out"
    render_route(route, render_config({"places": 30, "size": (32, 64), "conditions": ("summer", "winter")}))
    compare(route, out, "--methods", "sad", "--frames", "20:", "--seed", "7")
    kept = {path: path.stat().st_mtime_ns for path in out.glob("parts/sad-*/*")}
    fitting = ["--fit-frames", ":16", "--epochs", "1", "--image-size", "32", "32"]
    metrics = compare(route, out, "--methods", "sad,cae", "--frames", "20:", *fitting)
    assert list(metrics["mean_auc_pr"]) == ["sad", "cae"]
    assert {path: path.stat().st_mtime_ns for path in out.glob("parts/sad-*/*")} == kept
    assert json.loads((out / "manifest.json").read_text())["fit"] == {
        "frames": ":16", "seed": 0, "epochs": 1, "image_size": [32, 32],
        "conditions": [], "drop_dark": False, "drop_stationary": False,
    }  # fmt: skip
    said = refused(route, out, "--methods", "sad,cae", "--frames", "20:", *fitting, "--seed", "7")
    assert "holds a study with other settings (cae: seed was 0 and is now 7)" in said
