"""The command as a person meets it: real processes, exit statuses, one clear sentence for every mistake."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from tests.forked import ForkedProcess

from everplace.cli import main

COMMANDS = [
    "demo", "train", "adapt", "methods", "describe", "match", "evaluate", "compare", "show swap", "show constant",
    "show translate", "show matrix", "show matches", "export", "data render", "data inspect", "data pack",
    "data align", "data fetch", "data import", "data list", "serve",
]  # fmt: skip

SAD = ["--method", "sad", "--query", "summer", "--database", "winter"]
EXCLUSIVE = "--epochs and --minutes exclude each other; give one of them"


LIMITED = """
import resource, signal, sys
from everplace.cli import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
sys.exit(main.run(sys.argv[2:]))
"""


def run(*arguments: str | Path, limit_file_size: int | None = None, fresh: bool = False) -> tuple[int, str, str]:
    """Runs a command in a process of its own, a fresh interpreter where that matters: status, stdout, stderr."""
    command = ["-m", "everplace.cli.main"] if limit_file_size is None else ["-c", LIMITED, str(limit_file_size)]
    environment = {**os.environ, "NO_COLOR": "1", "TERM": "dumb", "COLUMNS": "200"}
    options: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": environment}
    with (
        subprocess.Popen([sys.executable, *command, *map(str, arguments)], text=True, **options)
        if fresh
        else ForkedProcess(*command, *arguments, **options)
    ) as process:
        out, err = process.communicate()
    return process.returncode, out, err


def call(*arguments: str | Path) -> tuple[int, str, str]:
    """The same without a process of its own, which would import torch each time: status, stdout, stderr."""
    printed, err = io.BytesIO(), io.StringIO()
    with (
        io.TextIOWrapper(printed, "utf-8", newline="", write_through=True) as out,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        status = main.run([str(argument) for argument in arguments])
        return status, printed.getvalue().decode(), err.getvalue()


def refused(*arguments: str | Path, status: int = 2) -> str:
    """Calls a command that must fail and returns the one sentence that says why."""
    ended, out, err = call(*arguments)
    assert ended == status, err
    lines = err.strip().splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith("everplace: ")
    assert out == ""
    return lines[0]


def test_the_version_is_printed() -> None:
    assert call("--version") == (0, f"everplace {version('everplace')}\n", "")


def test_a_name_that_is_not_utf8_is_printed_escaped(tiny_route: Path, tmp_path: Path) -> None:
    out = os.fsencode(tmp_path) + b"/x\xff.h5"
    command = [sys.executable, "-m", "everplace.cli.main", "describe", "sad", str(tiny_route / "summer"), "--out"]
    command.append(os.fsdecode(out))
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8:strict"}
    for more, told in ([], "x\\xff.h5"), (["--json"], "x\\udcff.h5"):
        done = subprocess.run([*command, *more], capture_output=True, env=environment, check=False)
        assert done.returncode == 0, done.stderr
        assert told.encode() in done.stdout
    assert json.loads(done.stdout)["out"] == os.fsdecode(out)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["train", "{route}", "--model", "vae", "--out", "{route}"], "lies in the route"),
        (["compare", "{route}", "--methods", "sad", "--out", "{route}/comparison"], "lies in the route"),
        (["evaluate", "{route}", *SAD, "--out", "{route}/x"], "lies in the route"),
        (["data", "align", "{route}", "--by", "images", "--out", "{route}/aligned"], "lies in the route"),
        (["show", "matrix", "{route}", *SAD, "--out", "{route}/summer/0.png"], "lies in a traverse"),
        (["data", "inspect", "{route}", "--sheet", "{route}/summer/0.png"], "lies in a traverse"),
        (["describe", "sad", "{route}", "--out", "{out}.h5"], "give one of them, such as {route}/(linked|summer)"),
        (["data", "render", "--out", "{route}/summer/0.png/x"], "cannot be a directory"),
        (["demo", "--out", "{route}/summer/0.png"], "cannot be a directory"),
        (["data", "pack", "{route}", "--cache", "{route}/summer/0.png"], "--cache .* cannot be a directory"),
        (["data", "pack", "{route}", "--cache", "{route}/cache"], "--cache .* lies in the route"),
        (["describe", "sad", "{route}/summer", "--out", "{route}/summer/0.png"], "lies in a traverse"),
        (["evaluate", "{route}", *SAD, "--out", "{route}/linked"], "lies in the route"),
        (["evaluate", "{route}", *SAD, "--out", "{elsewhere}/x"], "lies in the route"),
        (["evaluate", "{route}", *SAD, "--out", "{relative}/x"], "lies in the route"),
        (["data", "inspect", "{route}", "--sheet", "{route}/linked/0.png"], "lies in a traverse"),
        (["data", "inspect", "{route}", "--sheet", "{relative}/summer/0.png"], "lies in a traverse"),
        (["compare", "{route}", "--methods", "hub:x,sad", "--out", "{out}"], "hub:x names no entry"),
    ],
)
def test_no_output_harms_an_input(
    tiny_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], says: str
) -> None:
    def files() -> dict[Path, bytes]:
        return {path: path.read_bytes() for path in sorted(tmp_path.rglob("*")) if path.is_file()}

    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(tiny_route / "summer", elsewhere)
    (tiny_route / "linked").symlink_to(elsewhere)
    monkeypatch.chdir(tmp_path)
    before = files()
    told = {
        "route": tiny_route,
        "relative": tiny_route.relative_to(tmp_path),
        "elsewhere": elsewhere,
        "out": tmp_path / "out",
    }
    assert re.search(says.format(**told), refused(*(argument.format(**told) for argument in arguments)))
    assert files() == before


def test_matches_do_not_replace_the_descriptors(tiny_route: Path, tmp_path: Path) -> None:
    for name in ("summer", "winter"):
        assert call("describe", "sad", tiny_route / name, "--out", tmp_path / f"{name}.h5")[0] == 0
    before = (tmp_path / "winter.h5").read_bytes()
    inputs = tmp_path / "summer.h5", tmp_path / "winter.h5"
    (tmp_path / "link.h5").symlink_to("winter.h5")
    for out in tmp_path / "winter.h5", tmp_path / "link.h5", tmp_path / "x" / ".." / "winter.h5":
        assert "is a file that is read" in refused("match", *inputs, "--out", out)
    assert (tmp_path / "winter.h5").read_bytes() == before


def test_ctrl_c_while_the_command_loads_is_one_sentence() -> None:
    code = """
import sys
class Interrupts:
    def find_spec(self, name, path=None, target=None):
        if name == "everplace.cli.main":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupts())
from everplace.__main__ import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "everplace: stopped\n")


def test_torchs_threads_are_told_how_to_wait_before_it_is_imported() -> None:
    script = """
import atexit, os, sys
atexit.register(lambda: print(os.environ.get("GOMP_SPINCOUNT"), "torch" in sys.modules))
sys.argv = ["everplace", "--version"]
from everplace.__main__ import main
main()
"""
    environment = {
        name: value for name, value in os.environ.items() if name not in ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")
    }
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "1000 False")


def test_a_terminal_without_utf8_gets_escapes() -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "everplace", "data", "inspect", "é"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("everplace: the route \\xe9 does not exist")


@pytest.mark.slow
def test_a_traverse_against_itself_is_warned_of(tiny_route: Path, tmp_path: Path) -> None:
    arguments: list[str | Path] = [tiny_route, "--method", "sad", "--query", "winter", "--database", "winter"]
    for command, out in (["evaluate"], "out"), (["show", "matrix"], "matrix.png"):
        status, _, err = call(*command, *arguments, "--out", tmp_path / out)
        assert status == 0
        assert "query and database are both 'winter', so every frame finds itself" in err
    status, _, err = call("evaluate", *arguments[:-1], "summer", "--out", tmp_path / "two")
    assert (status, err) == (0, "")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(command: str) -> None:
    status, out, _ = call(*command.split(), "--help")
    assert status == 0
    assert f"Example: everplace {command}" in out


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; sys.argv = ['everplace', '--help']\n"
        "from everplace.cli.main import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'torch', 'lightning', 'cv2', 'sklearn', 'scipy', 'matplotlib', 'plotly', 'h5py', 'numpy', 'PIL'}\n"
        "sys.exit(','.join(sorted(heavy & set(sys.modules))) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["train", "route", "--image-size", "32"], "requires 2 arguments; see everplace train --help"),
        (["data", "render", "--image-size", "33"], "requires 2 arguments; see everplace data render --help"),
        (["nothing", "--image-size", "33"], "see everplace --help"),
    ],
)
def test_wrong_usage_leads_to_the_help_of_the_command(arguments: list[str], says: str) -> None:
    status, out, err = call(*arguments)
    assert (status, out) == (2, "")
    assert says in err
    assert len(err.splitlines()) == 1


def test_a_wrong_setting_is_told_by_the_file_that_gives_it(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text("foo = 1\n")
    options: list[str | Path] = ["train", "route", "--model", "cp-vae", "--out", tmp_path / "run"]
    options += ["--config", tmp_path / "own.toml"]
    status, _, err = call(*options)
    assert status == 2
    assert "own.toml: foo: there is no such setting; known are model, " in err
    status, _, err = call(*options, "--minutes", "-1")
    wrong = "--minutes: Input should be greater than 0, not -1.0 (minutes: Stop after so much training time.)"
    assert (status, err) == (2, f"everplace: {wrong}\n")
    assert not (tmp_path / "run").exists()


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = "import sys, everplace; sys.exit(','.join(sorted({'torch', 'cv2', 'numpy'} & set(sys.modules))) or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def way(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole way once: a rendered route, a short training, descriptors, matches, an evaluation."""
    base = tmp_path_factory.mktemp("way")
    # With the fully connected chain a model of this size takes 90 MB.
    (base / "small.toml").write_text("fully_connected = false\n")
    steps: list[list[str | Path]] = [
        ["data", "render", "--out", base / "route", "--places", "60", "--image-size", "32", "64",
         "--conditions", "summer,winter"],
        ["train", base / "route", "--model", "cp-vae", "--frames", ":40", "--image-size", "32", "64", "--epochs", "2",
         "--config", base / "small.toml", "--out", base / "run", "--json"],
        ["describe", base / "run", base / "route" / "winter", "--out", base / "winter.h5", "--json"],
        ["describe", base / "run", base / "route" / "summer", "--out", base / "summer.h5"],
        ["match", base / "summer.h5", base / "winter.h5", "--top", "3", "--out", base / "matches.csv"],
        ["evaluate", base / "route", "--method", base / "run", "--database", "summer", "--query", "winter", "--frames",
         "20:", "--out", base / "result", "--json"],
    ]  # fmt: skip
    for step in steps:
        status, out, err = call(*step)
        assert status == 0, err
        if "--json" in step:
            (base / f"{step[0]}.json").write_text(json.dumps(json.loads(out)))
        (base / f"{step[0]}.err").write_text(err)
    return base


def test_training_leaves_a_run_directory(way: Path) -> None:
    summary = json.loads((way / "train.json").read_text())
    assert summary["epochs"] == 2
    assert summary["places"] == 26  # 40, less a tenth held out and a gap of 10
    assert {path.name for path in (way / "run").iterdir()} >= {
        "checkpoint.json",
        "config.toml",
        "metrics.csv",
        "resume",
    }
    with (way / "run" / "metrics.csv").open() as file:
        assert [row["epoch"] for row in csv.DictReader(file)] == ["1", "2"]


def test_descriptor_files_hold_what_the_contract_says(way: Path) -> None:
    with h5py.File(way / "winter.h5") as file:
        values = file["descriptors"]
        assert values.shape == (60, 96)
        assert values.dtype == np.float32
        assert [name.decode() for name in file["names"][:2]] == ["00000", "00001"]
        assert file.attrs["method"] == "cp-vae"


def test_matches_are_ranked(way: Path) -> None:
    with (way / "matches.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["query", "database", "score", "rank", "score_kind"]
    assert len(rows) == 60 * 3
    assert [row["rank"] for row in rows[:3]] == ["1", "2", "3"]
    assert float(rows[0]["score"]) >= float(rows[1]["score"]) >= float(rows[2]["score"])


def test_an_evaluation_writes_metrics_and_a_report(way: Path) -> None:
    metrics = json.loads((way / "result" / "metrics.json").read_text())
    assert metrics == json.loads((way / "evaluate.json").read_text())
    assert set(metrics) >= {
        "recall_at", "auc_pr", "average_precision", "recall_at_100_precision", "extended_precision", "queries",
        "database", "tolerance", "dimension", "ms_per_image", "audit",
    }  # fmt: skip
    assert set(metrics["recall_at"]) == {"1", "5", "10"}
    assert (metrics["queries"], metrics["database"], metrics["dimension"]) == (40, 40, 96)
    assert 0 < metrics["audit"]["swap"]["mean_image"] < 1
    page = (way / "result" / "report.html").read_text()
    assert "<h1>cp-vae (no fully connected chain): query winter, database summer</h1>" in page
    for picture in ("similarity", "matches", "swap", "constant", "translation"):
        assert (way / "result" / f"{picture}.png").read_bytes().startswith(b"\x89PNG")


def test_show_warns_of_places_that_were_trained_on(way: Path, tmp_path: Path) -> None:
    pair = ["--method", str(way / "run"), "--query", "winter", "--database", "summer", "--out", str(tmp_path / "a.png")]
    status, _, err = call("show", "matrix", way / "route", *pair)
    assert status == 0
    assert re.search(r"\d+ of the tested places were among those that .*run was trained on", err)
    assert call("show", "matrix", way / "route", *pair, "--frames", "50:")[::2] == (0, "")


@pytest.mark.parametrize("what", ["swap", "constant", "translate", "matrix", "matches"])
def test_show_draws_a_picture(way: Path, tmp_path: Path, what: str) -> None:
    model: list[str | Path] = [way / "run", way / "route", "--frames", "40:"]
    pair: list[str | Path] = [
        way / "route",
        "--method",
        "hog",
        "--database",
        "summer",
        "--query",
        "winter",
        "--frames",
        "40:",
    ]
    status, out, err = call(
        "show", what, *(model if what in ("swap", "constant", "translate") else pair), "--out", tmp_path / "a.png"
    )
    assert status == 0, err
    assert str(tmp_path / "a.png") in out
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("methods", ["sad,hog", pytest.param("{way}/run,sad,hog", marks=pytest.mark.slow)])
def test_compare_names_every_pair_and_method(way: Path, tmp_path: Path, methods: str) -> None:
    given = methods.format(way=way)
    status, out, err = call("compare", way / "route", "--methods", given, "--frames", "40:", "--out", tmp_path / "c")
    assert status == 0, err
    assert "trained" not in err
    table = (tmp_path / "c" / "table.md").read_text()
    assert out == table
    assert "**Query summer, database winter**" in table
    assert "**Query winter, database summer**" in table
    names = [Path(method).name for method in given.split(",")]
    assert sorted(re.findall(r"^\| (sad|hog|run) \|", table, re.MULTILINE)) == sorted(2 * names)
    assert {path.name for path in (tmp_path / "c").iterdir()} >= {"metrics.json", "report.html", "pr_curves.png"}


def test_testing_on_trained_places_is_said(way: Path) -> None:
    # 26 places in the gradient, 10 of a gap, 4 held out to choose the epoch: positions 20 to 25 and 36 to 39.
    assert json.loads((way / "evaluate.json").read_text())["trained_places_tested"] == 10
    assert (way / "evaluate.err").read_text().startswith("everplace: 10 of the tested places")


def test_a_training_run_is_not_overwritten(way: Path) -> None:
    again: list[str | Path] = [
        "train",
        way / "route",
        "--model",
        "cp-vae",
        "--config",
        way / "small.toml",
        "--image-size",
        "32",
        "64",
        "--epochs",
        "2",
        "--out",
        way / "run",
    ]
    before = (way / "run" / "checkpoint.json").read_bytes()
    assert "--resume" in refused(*again)
    assert "epochs" in refused(*again[:-4], "--epochs", "3", "--frames", ":40", "--out", way / "run", "--resume")
    assert (way / "run" / "checkpoint.json").read_bytes() == before


def test_a_checkpoint_that_was_tampered_with_is_refused(way: Path, tmp_path: Path) -> None:
    run_copy = tmp_path / "run"
    run_copy.mkdir()
    for path in (way / "run").iterdir():
        if path.is_file():
            (run_copy / path.name).write_bytes(path.read_bytes())
    (weights,) = run_copy.glob("*.safetensors")
    data = bytearray(weights.read_bytes())
    data[len(data) // 2] ^= 1
    weights.write_bytes(data)
    said = refused("describe", run_copy, way / "route" / "winter", "--out", tmp_path / "x.h5")
    assert weights.name in said
    assert not (tmp_path / "x.h5").exists()


def test_a_run_of_another_version_is_refused(way: Path, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    document = json.loads((way / "run" / "checkpoint.json").read_text())
    (tmp_path / "run" / "checkpoint.json").write_text(json.dumps(document | {"format": 99}))
    (tmp_path / "run" / "config.toml").write_text("")
    assert "format 99" in refused("describe", tmp_path / "run", way / "route" / "winter", "--out", tmp_path / "x.h5")


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["train", "{route}", "--model", "cp-vaee", "--out", "{out}"], "cp-vaee"),
        (["train", "{route}", "--model", "cp-vae", "--image-size", "33", "64", "--out", "{out}"], "multiple of 32"),
        (["train", "{route}", "--model", "c-vae", "--conditions", "summer", "--out", "{out}"], "condition"),
        (["train", "{route}", "--model", "vae", "--frames", "4-9", "--out", "{out}"], "4-9"),
        (["train", "{route}", "--model", "vae", "--conditions", "monsoon", "--out", "{out}"], "monsoon"),
        (["train", "{route}", "--model", "vae", "--recipe", "secret", "--out", "{out}"], "secret"),
        (["train", "{route}", "--model", "vae", "--minutes", "1", "--epochs", "1", "--out", "{out}"], EXCLUSIVE),
        (["compare", "{route}", "--methods", "hog", "--minutes", "1", "--epochs", "1", "--out", "{out}"], EXCLUSIVE),
        (["data", "inspect", "{route}", "--sheet", "{out}.gif"], "--sheet {out}.gif must end in .png"),
        (["data", "align", "{route}", "--by", "images", "--out", "{out}", "--picture", "{out}.gif"], "--picture {out}"),
        (["train", "{out}", "--model", "vae", "--out", "{out}2"], "does not exist"),
        (["train", "{route}", "--model", "fabmap", "--epochs", "3", "--out", "{out}"], "--epochs does not apply"),
        (["compare", "{route}", "--methods", "fabmap", "--out", "{out}"], "--fit-frames"),
        (["describe", "sadd", "{route}/summer", "--out", "{out}"], "sadd"),
        (["describe", "sad", "{route}/autumn", "--out", "{out}"], "autumn"),
        (["match", "{out}", "{out}", "--out", "{out}"], "out"),
        (["evaluate", "{route}", "--method", "sad", "--database", "x", "--query", "summer", "--out", "{out}"], "x"),
        (["compare", "{route}", "--methods", "vae", "--out", "{out}"], "--fit-frames"),
        (["compare", "{route}", "--methods", "sad,hgo", "--out", "{out}"], "hgo"),
        (["compare", "{route}", "--methods", ",", "--out", "{out}"], "no method"),
        (["describe", "sad", "{route}/summer", "--out", "{route}"], "is a directory"),
        (
            [
                "evaluate",
                "{route}",
                "--method",
                "sad",
                "--database",
                "winter",
                "--query",
                "summer",
                "--out",
                "{route}/summer/0.png",
            ],
            "is a file",
        ),
        (
            [
                "show",
                "matches",
                "{route}",
                "--method",
                "sad",
                "--database",
                "winter",
                "--query",
                "summer",
                "--out",
                "{out}.gif",
            ],
            ".png",
        ),
        (["compare", "{route}", "--methods", "vae", "--fit-frames", "0:9", "--out", "{out}"], "share"),
        (["data", "render", "--out", "{out}", "--conditions", "hail"], "hail"),
        (["data", "inspect", "{out}"], "does not exist"),
    ],
)
def test_every_mistake_gets_one_sentence(tiny_route: Path, tmp_path: Path, arguments: list[str], names: str) -> None:
    out = tmp_path / "out"
    filled = [argument.format(route=tiny_route, out=out) for argument in arguments]
    assert names.format(out=out) in refused(*filled)
    assert not out.exists()
    assert not list(tmp_path.rglob(".*"))


@pytest.mark.parametrize(
    "arguments",
    [
        ["describe", "sad", "{route}/summer", "--out", "{fifo}"],
        ["match", "none.h5", "none.h5", "--out", "{fifo}"],
        ["show", "swap", "no-run", "{route}", "--out", "{fifo}"],
        ["data", "inspect", "{route}", "--sheet", "{fifo}"],
        ["export", "no-run", "--onnx", "{fifo}"],
        ["evaluate", "{route}", "--method", "sad", "--database", "a", "--query", "b", "--out", "{fifo}"],
    ],
)
def test_what_is_no_file_is_refused_before_any_work(tiny_route: Path, tmp_path: Path, arguments: list[str]) -> None:
    fifo = tmp_path / ("x.onnx" if arguments[0] == "export" else "x.png")
    os.mkfifo(fifo)
    said = refused(*(argument.format(route=tiny_route, fifo=fifo) for argument in arguments))
    assert f"{fifo} " in said
    assert "a FIFO or a socket; name a file" in said or "cannot be a directory" in said
    assert fifo.is_fifo()


def test_an_unknown_key_of_a_config_is_named(tiny_route: Path, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("[weights]\nplaec = 3.0\n")
    said = refused("train", tiny_route, "--model", "cp-vae", "--config", tmp_path / "c.toml", "--out", tmp_path / "run")
    assert "weights.plaec" in said
    assert not (tmp_path / "run").exists()


def test_a_config_of_two_lengths_is_named_unless_an_option_chooses(tiny_route: Path, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("epochs = 1\nminutes = 1\n")
    arguments: list[str | Path] = ["train", tiny_route, "--model", "vae", "--config", tmp_path / "c.toml"]
    said = refused(*arguments, "--out", tmp_path / "run")
    assert f"--config {tmp_path / 'c.toml'} gives both epochs and minutes; keep one of them" in said
    # The length is settled: the next mistake is named.
    assert "monsoon" in refused(*arguments, "--epochs", "1", "--conditions", "monsoon", "--out", tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("what", ["swap", "constant", "translate"])
def test_show_says_which_models_it_divides(tiny_route: Path, tmp_path: Path, what: str) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "checkpoint.json").write_text('{"format": 1, "model": {"kind": "fabmap", "words": 8}}')
    said = refused("show", what, tmp_path / "run", tiny_route, "--out", tmp_path / "x.png")
    assert "run is a run of fabmap, which has no z_p and z_c" in said
    assert said.endswith("give the run of a c-vae or a cp-vae")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["evaluate", "{route}", "--method", "{run}", "--database", "summer", "--query", "winter"], "stopped"),
        (["describe", "{run}", "{route}/summer"], "stopped"),
        (["compare", "{route}", "--methods", "{run}"], "stopped; what was finished is kept"),
    ],
)
def test_ctrl_c_says_what_is_kept_only_where_something_is(
    tiny_route: Path, tmp_path: Path, arguments: list[str], said: str
) -> None:
    waits = tmp_path / "run"
    waits.mkdir()
    (waits / "config.toml").touch()
    os.mkfifo(waits / "checkpoint.json")  # the command waits for what comes out of it
    filled = [argument.format(route=tiny_route, run=waits) for argument in arguments]
    command = ["-m", "everplace.cli.main", *filled, "--out", tmp_path / "out"]
    opened = None
    with ForkedProcess(*command, stderr=subprocess.PIPE) as process:
        try:
            deadline = time.monotonic() + 60
            while opened is None:
                assert process.poll() is None
                assert time.monotonic() < deadline
                time.sleep(0.05)
                with contextlib.suppress(OSError):  # until the command has opened it too
                    opened = os.open(waits / "checkpoint.json", os.O_WRONLY | os.O_NONBLOCK)
            err = _interrupted(process)
        finally:
            process.kill()  # or a failure would wait for it for ever
            if opened is not None:
                os.close(opened)
    assert process.returncode == 130
    assert err.splitlines()[-1] == f"everplace: {said}"


def _interrupted(process: subprocess.Popen[str]) -> str:
    """What a command that waits says on Ctrl-C; again if the first came between Python's last look and the wait."""
    for _ in range(4):
        process.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=15)[1]
    raise AssertionError("it does not stop on Ctrl-C")


def test_a_full_disk_leaves_nothing_behind(tiny_route: Path, tmp_path: Path) -> None:
    status, _, err = run("describe", "hog", tiny_route / "summer", "--out", tmp_path / "x.h5", limit_file_size=4096)
    assert status == 1
    assert len(err.strip().splitlines()) == 1
    assert "x.h5" in err
    assert [path.name for path in tmp_path.iterdir() if path != tiny_route] == []


@pytest.mark.slow
def test_in_processes_of_their_own_the_commands_write_one_json_document(way: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    model: list[str | Path] = ["--model", "cp-vae", "--config", way / "small.toml", "--image-size", "32", "64"]
    status, told, err = run(
        "train", way / "route", *model, "--frames", ":40", "--epochs", "2", "--out", out, "--json", fresh=True
    )
    assert status == 0, err
    expected = json.loads((way / "train.json").read_text())
    measured = {"run": str(out), "seconds": json.loads(told)["seconds"]}
    assert json.loads(told) == expected | measured
    pair = ["--database", "summer", "--query", "winter", "--frames", "40:", "--json"]
    status, told, err = run("evaluate", way / "route", "--method", out, *pair, "--out", tmp_path / "result", fresh=True)
    assert (status, err) == (0, "")
    metrics = json.loads(told)
    assert metrics == json.loads((tmp_path / "result" / "metrics.json").read_text())
    assert metrics["trained_places_tested"] == 0


@pytest.mark.slow
def test_ctrl_c_ends_with_130_and_the_run_can_go_on(tmp_path: Path) -> None:
    assert call("data", "render", "--out", tmp_path / "route", "--places", "60", "--image-size", "32", "32",
                "--conditions", "summer,winter")[0] == 0  # fmt: skip
    command = ["train", str(tmp_path / "route"), "--model", "vae", "--image-size", "32", "32", "--epochs", "100000",
               "--save-every", "0", "--out", str(tmp_path / "run")]  # fmt: skip
    process = ForkedProcess("-m", "everplace.cli.main", *command, stderr=subprocess.PIPE)
    deadline = time.monotonic() + 60
    while not (tmp_path / "run" / "resume" / "state.json").exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert said.strip().splitlines()[-1].startswith("everplace: stopped")
    assert not list((tmp_path / "run").rglob("*.part*"))


@pytest.mark.parametrize("command", [[], ["train"], ["data", "align"], ["show", "matrix"]])
def test_the_short_option_for_help_is_the_long_one(command: list[str]) -> None:
    assert call(*command, "-h") == call(*command, "--help")
    assert call(*command, "-h")[0] == 0


def test_the_recipes_are_named_in_the_help() -> None:
    assert "faithful|best" in call("train", "-h")[1]


@pytest.mark.parametrize("names", [",", ",,"])
@pytest.mark.parametrize("command", ["train", "compare", "data render"])
def test_a_list_without_a_name_is_refused(command: str, names: str, tiny_route: Path, tmp_path: Path) -> None:
    more = {"train": "--model vae", "compare": "--methods sad", "data render": ""}[command].split()
    given: list[str | Path] = [*([tiny_route] if more else []), *more]
    said = refused(*command.split(), *given, "--conditions", names, "--out", tmp_path / "out")
    assert f"--conditions {names!r} names nothing; write names separated by commas" in said
    assert not (tmp_path / "out").exists()
