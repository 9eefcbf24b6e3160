"""A comparison that was killed goes on; what was done is not done again."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from tests.experiments.comparing import MEASURED, OPTIONS, compare, refused
from tests.forked import ForkedProcess

from everplace.audit.leakage import Audit, Probe
from everplace.describe.registry import open_describer
from everplace.experiments.comparison_parts import MethodResult, PairResult, Part, keep_pictures
from everplace.route.route import open_route
from everplace.scoring.precision_table import precision_table
from everplace.scoring.scores import evaluate, precision_recall


def result(audit: Audit | None = None) -> MethodResult:
    S = np.array([[0.1, 0.30000001192, -np.inf], [0.5, 0.2, 0.2]], np.float32)
    truth = np.array([[False, True, False], [False, False, True]])
    told = {"mean_probability": 0.1, "above_half": 1}
    pair = PairResult(
        evaluate(S, truth), precision_recall(S, truth), precision_table(S, truth), evaluate(-S, truth), told
    )
    return MethodResult({("a", "b"): pair}, 3, 1 / 3, True, 123.4, "", audit)


def test_a_kept_result_is_the_same_to_the_last_bit(tmp_path: Path) -> None:
    part = Part(tmp_path, "hub:some/one:x?y=1", "0123")
    assert part.load() is None
    part.save(result())
    back = part.load()
    assert back is not None
    assert (back.costs(), back.beside_other_work, back.audit) == (result().costs(), True, None)
    there, here = back.pairs["a", "b"], result().pairs["a", "b"]
    assert (there.scores, there.new_place) == (here.scores, here.new_place)
    assert there.precision_table == here.precision_table
    assert there.frame_by_frame == here.frame_by_frame != here.scores
    for name in ("recall", "precision", "threshold"):
        np.testing.assert_array_equal(getattr(there.curve, name), getattr(here.curve, name), strict=True)


def test_a_damaged_part_is_made_again(tiny_route: Path, tmp_path: Path) -> None:
    part = Part(tmp_path, "sad", "0123")
    part.save(result())
    (part.directory / "result.json").write_text((part.directory / "result.json").read_text()[:-20])
    assert part.load() is None
    summer = open_route(tiny_route)["summer"]
    made = part.described(open_describer("sad"), 0, summer)
    (part.directory / "descriptors-0.h5").write_bytes(b"\x89HDF")
    again = part.described(open_describer("sad"), 0, summer)
    np.testing.assert_array_equal(again.values, made.values)


@pytest.mark.slow
def test_a_finished_comparison_is_read_and_a_method_can_be_added(finished_copy: Path) -> None:
    out = finished_copy / "c"
    assert OPTIONS[:2] == ("--methods", "sad,hog")
    (other,) = out.glob("parts/hog-*")
    shutil.rmtree(other)  # as if the comparison had been of sad alone
    (kept,) = out.glob("parts/*/result.json")
    document = json.loads(kept.read_text())
    # A figure that no method reaches shows that it was read, not measured again.
    kept.write_text(json.dumps(document | {"ms_per_image": 12345.0}))
    metrics = compare(finished_copy / "tiny", out, "--methods", "hog,sad", *OPTIONS[2:])
    assert metrics["pairs"][0]["methods"]["sad"]["ms_per_image"] == 12345.0
    assert list(metrics["pairs"][0]["methods"]) == ["hog", "sad"]
    assert list(json.loads((out / "manifest.json").read_text())["methods"]) == ["hog", "sad"]


@pytest.mark.slow
def test_a_comparison_that_failed_at_once_takes_the_repaired_images(tiny_route: Path, tmp_path: Path) -> None:
    image, out = tiny_route / "winter" / "5.png", tmp_path / "c"
    whole = image.read_bytes()
    image.write_bytes(whole[:300])
    assert "5.png" in refused(tiny_route, out, "--methods", "sad")
    image.write_bytes(whole)
    assert list(compare(tiny_route, out, "--methods", "sad")["mean_auc_pr"]) == ["sad"]
    image.write_bytes(whole + b"a")
    assert "with other settings (traverses.1.sha256 was" in refused(tiny_route, out, "--methods", "sad")


@pytest.mark.slow
def test_a_comparison_killed_at_any_moment_continues(tiny_route: Path, tmp_path: Path) -> None:
    out = tmp_path / "killed"
    options = ["--methods", "sad,hog"]
    command = ["-m", "everplace.cli.main", "compare", tiny_route, *options, "--out", out]
    for moment in ("parts/sad-*/descriptors-0.h5", "parts/sad-*/result.json"):
        process = ForkedProcess(*command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while not any(out.glob(moment)):
            assert process.poll() is None
            time.sleep(0.002)
        process.kill()
        assert process.wait() == -signal.SIGKILL
    assert not (out / "metrics.json").exists()
    assert not any(out.glob("parts/hog-*/result.json"))
    done = {path: (path.stat().st_ino, path.stat().st_mtime_ns) for path in out.glob("parts/sad-*/*")}
    assert len(done) == 3
    for place in (
        out,
        out / "parts",
        next(out.glob("parts/sad-*")),
    ):
        (place / ".manifest.123-0123abcd.part.json").write_text("{")

    metrics = compare(tiny_route, out, *options)
    assert {path: (path.stat().st_ino, path.stat().st_mtime_ns) for path in out.glob("parts/sad-*/*")} == done
    assert not any(out.rglob(".*"))
    whole = compare(tiny_route, tmp_path / "whole", *options)
    for one, other in zip(metrics["pairs"], whole["pairs"], strict=True):
        for method in ("sad", "hog"):
            for values in (one["methods"][method], other["methods"][method]):
                measured = {name: values.pop(name) for name in MEASURED}
                assert measured["ms_per_image"] > 0
                assert measured["peak_memory_mb"] > 0
    assert metrics == whole


def test_an_audit_is_kept(tmp_path: Path) -> None:
    audit = Audit(
        condition_from_z_p=Probe(0.5, 0.6, 0.5),
        condition_from_z_c=None,
        recall_at_1={"z_p": 0.7, "z_c": 0.1, "z": 0.6},
        recall_chance=0.1,
        swap=None,
        active_dimensions={"z_p": 96, "z_c": 3},
        kl={"z_p": 200.0, "z_c": 2.5},
        kl_per_dimension={"z_p": [0.1, 0.2], "z_c": [0.0]},
        places=12,
        frames=24,
        divided=True,
        tolerance=3,
    )
    part = Part(tmp_path, "vae", "0")
    part.save(result(audit))
    back = part.load()
    assert back is not None
    assert back.audit == audit


def test_pictures_of_an_earlier_call_are_removed_and_no_other_file(tmp_path: Path) -> None:
    out = tmp_path / "c"
    out.mkdir()
    keep_pictures(out, [])
    assert not list(out.iterdir())
    for name in ("a-swap.png", "b-swap.png", "mine-swap.png", "../other.png"):
        (out / name).write_bytes(b"")
    keep_pictures(out, ["a-swap.png", "b-swap.png"])
    keep_pictures(out, ["b-swap.png"])
    assert sorted(path.name for path in out.glob("*.png")) == ["b-swap.png", "mine-swap.png"]
    (out / "parts" / "pictures.json").write_text('["../other.png", "gone.png", ".", "..", "b-swap.png"]')
    keep_pictures(out, [])
    assert [path.name for path in out.glob("*.png")] == ["mine-swap.png"]
    assert (tmp_path / "other.png").exists()
    (out / "parts" / "pictures.json").write_text("damaged")
    keep_pictures(out, [])
    assert (out / "mine-swap.png").exists()
