"""`everplace adapt` as a person meets it: what it says, what it writes, and what it leaves when it is killed."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import signal
from pathlib import Path

import pytest
from tests.forked import ForkedProcess

from everplace.cli import main
from everplace.describe.registry import load


def call(*arguments: str | Path) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main.run([str(argument) for argument in arguments])
    return status, out.getvalue(), err.getvalue()


@pytest.mark.slow
def test_it_prints_what_it_made_and_the_run_is_a_method(unchanged_tiny_route: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    status, out, err = call(
        "adapt", "hog16", unchanged_tiny_route, "--dimensions", "8", "--prior", "none", "--out", run, "--json"
    )
    assert status == 0, err
    told = json.loads(out)
    assert told.items() >= {
        "method": "hog16", "map": "summer", "places": 12, "dimension": 8, "self_taught": False, "prior": "none",
        "prior_weight": 0.0, "pairs": 12,
    }.items()  # fmt: skip
    assert told["drives"] == [{"name": "winter", "frames": 12, "pairs": 12, "share": 1.0, "right": None}]
    assert sorted(path.suffix for path in run.iterdir()) == [".json", ".safetensors", ".toml"]
    commands: list[list[str | Path]] = [
        ["describe", run, unchanged_tiny_route / "winter", "--out", tmp_path / "w.h5"],
        ["evaluate", unchanged_tiny_route, "--method", run, "--query", "winter", "--database", "summer", "--out",
         tmp_path / "e"],
        ["compare", unchanged_tiny_route, "--methods", f"{run},hog16", "--out", tmp_path / "c"],
    ]  # fmt: skip
    for command in commands:
        status, _, err = call(*command)
        assert status == 0, err
    assert json.loads((tmp_path / "e" / "metrics.json").read_text())["dimension"] == 8


@pytest.mark.slow
def test_the_first_condition_named_is_the_map(unchanged_tiny_route: Path, tmp_path: Path) -> None:
    given = ["adapt", "hog16", str(unchanged_tiny_route), "--conditions", "winter,summer", "--dimensions", "3"]
    status, out, err = call(*given, "--out", tmp_path / "run", "--json")
    assert status == 0, err
    assert json.loads(out)["map"] == "winter"


@pytest.mark.slow
def test_fewer_dimensions_and_no_prior_are_said(unchanged_tiny_route: Path, tmp_path: Path) -> None:
    status, out, err = call("adapt", "hog", unchanged_tiny_route, "--conditions", "summer", "--out", tmp_path / "run")
    assert (status, load(tmp_path / "run").dimension) == (0, 11)
    lines = [line for line in err.splitlines() if line.startswith("everplace: ")]
    assert lines == [
        "everplace: --dimensions 96 was lowered to 11, as the map's 12 different views do not allow more",
        "everplace: no prior comes with everplace for hog, so none was used",
    ]
    assert "dimension" in out


@pytest.mark.slow
def test_a_prior_goes_from_one_route_to_another(unchanged_tiny_route: Path, tmp_path: Path) -> None:
    summer = [str(unchanged_tiny_route), "--conditions", "summer", "--dimensions", "4"]
    given = ["adapt", "hog16", str(unchanged_tiny_route), "--prior", "none", "--dimensions", "4"]
    assert call(*given, "--out", tmp_path / "a", "--save-prior", tmp_path / "w0")[0] == 0
    status, out, err = call("adapt", "hog16", *summer, "--prior", tmp_path / "w0", "--out", tmp_path / "b", "--json")
    assert status == 0, err
    assert json.loads(out)["prior"] == str(tmp_path / "w0")
    status, _, err = call("adapt", "hog", *summer, "--prior", tmp_path / "w0", "--out", tmp_path / "c")
    assert status == 2
    assert "the prior is of the method hog16" in err
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["hog16", "{route}", "--out", "{tmp}/used"], "already exists and is not empty"),
        (["hog16", "{route}", "--out", "{route}/run"], "lies in the route"),
        (["hog16", "{route}", "--out", "{tmp}/x", "--dimensions", "0"], "--dimensions"),
        (["hog16", "{route}", "--out", "{tmp}/x", "--frames", ":2"], "has 2 frames"),
        (["hog16", "{route}", "--out", "{tmp}/x", "--teach-frames", "5"], "--teach-frames '5' is not A:B"),
        (["hog16", "{route}", "--out", "{tmp}/x", "--teach-frames", "12:"], "begin --teach-frames lower"),
        (["hog16", "{route}", "--out", "{tmp}/x", "--conditions", "summer", "--self-taught"], "--self-taught wants"),
        (["hog16", "{route}", "--out", "{tmp}/x", "--conditions", "fog"], "has no traverse or condition 'fog'"),
        (["hog16", "{route}", "--out", "{tmp}/x", "--prior", "{tmp}/none"], "cannot be read"),
        (["hog16", "{route}", "--out", "{tmp}/x", "--prior", "{tmp}/used/kept"], "or it is damaged"),
        (["hog16", "{unaligned}", "--out", "{tmp}/x"], "let the drives be matched with --self-taught"),
        (["hog17", "{route}", "--out", "{tmp}/x"], "there is no method or run directory 'hog17'"),
        (["sad+hog16", "{route}", "--out", "{tmp}/x"], "cannot be joined"),
        (["hog16", "{tmp}/nowhere", "--out", "{tmp}/x"], "nowhere"),
    ],
)
def test_a_mistake_is_one_sentence_and_leaves_nothing(
    tiny_route: Path, tmp_path: Path, given: list[str], says: str
) -> None:
    unaligned = tmp_path / "unaligned"
    shutil.copytree(tiny_route, unaligned)
    (unaligned / "route.toml").write_text("aligned = false\n")
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "kept").write_text("x")
    before = sorted(tmp_path.rglob("*"))
    status, out, err = call(
        "adapt", *(one.format(route=tiny_route, tmp=tmp_path, unaligned=unaligned) for one in given)
    )
    assert (status, out) == (2, ""), err
    assert len(err.strip().splitlines()) == 1, err
    assert says in err
    assert sorted(tmp_path.rglob("*")) == before


def test_a_frame_that_cannot_be_decoded_is_named(tiny_route: Path, tmp_path: Path) -> None:
    (tiny_route / "winter" / "5.png").write_bytes(b"no image")
    status, _, err = call("adapt", "hog16", tiny_route, "--out", tmp_path / "x")
    assert status == 2
    assert "winter/5.png" in err
    assert not (tmp_path / "x").exists()


KILLED = """
import os, signal, sys
from everplace.cli import main
from everplace.describe.runs import adapted
from everplace.mapping import route_learning

def write_and_die(out, *given):
    adapted.write_adapted(out, *given)
    os.kill(os.getpid(), signal.SIGKILL)

route_learning.write_adapted = write_and_die
main.run(sys.argv[1:])
"""


@pytest.mark.slow
def test_what_is_killed_while_it_writes_is_not_there_and_the_next_one_cleans_up(
    unchanged_tiny_route: Path, tmp_path: Path
) -> None:
    out = tmp_path / "runs" / "adapted"
    given = ["adapt", "hog16", str(unchanged_tiny_route), "--dimensions", "4", "--out", str(out)]
    assert ForkedProcess("-c", KILLED, *given).wait() == -signal.SIGKILL
    assert not out.exists()
    (left,) = out.parent.iterdir()
    assert left.name.endswith(".part")
    assert call(*given)[0] == 0
    assert [path.name for path in out.parent.iterdir()] == ["adapted"]
