"""Real processes, killed and interrupted: what is resumed ends exactly as what was never stopped."""

from __future__ import annotations

import csv
import json
import multiprocessing
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import Any

import pytest
from tests.forked import ForkedProcess

from everplace.model.checkpoint import load_checkpoint
from everplace.route.route import Route
from everplace.training.config import TrainConfig
from everplace.training.fit import train
from everplace.training.resume_state import load_state

MakeConfig = Callable[..., TrainConfig]

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no such signals on Windows")

_PATIENCE = 90.0


@pytest.fixture(scope="module")
def processes() -> ForkServerContext:
    """Starts processes that have imported everything and compute with one thread."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["everplace.training.fit"])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", "1")
        starter = context.Process()
        starter.start()
        starter.join()
    return context


def started(processes: ForkServerContext, route: Route, config: TrainConfig, out: Path) -> Any:
    """A process that trains, or goes on training."""
    process = processes.Process(target=train, args=(route, config, out), kwargs={"resume": True, "save_every": 0.0})
    process.start()
    return process


def wait_until(seen: Callable[[], bool], process: Any) -> bool:
    """Waits for what is to be seen; False when the process ended before."""
    end = time.monotonic() + _PATIENCE
    while not seen():
        if not process.is_alive():
            return False
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.001)
    return True


def rows(out: Path) -> list[list[str]]:
    """metrics.csv without its header and the column of seconds."""
    path = out / "metrics.csv"
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return [[value for name, value in row.items() if name != "seconds"] for row in csv.DictReader(file)]


def outcome(out: Path) -> tuple[Any, ...]:
    """All that a run comes to, but for the time it took."""
    progress = json.loads((out / "resume" / "state.json").read_text())["progress"]
    progress.pop("seconds")
    names = {str(path.relative_to(out)) for path in out.rglob("*") if "tfevents" not in path.name}
    return json.loads((out / "checkpoint.json").read_text()), rows(out), progress, names


@pytest.mark.slow
def test_a_run_killed_at_any_moment_and_resumed_equals_one_that_was_not(
    processes: ForkServerContext, route: Route, make_config: MakeConfig, tmp_path: Path
) -> None:
    config = make_config(epochs=5, batch_size=4)
    whole = started(processes, route, config, tmp_path / "whole")
    whole.join()
    assert whole.exitcode == 0
    expected = outcome(tmp_path / "whole")
    assert [int(row[0]) for row in expected[1]] == [1, 2, 3, 4, 5]

    out = tmp_path / "killed"

    def writing(where: str) -> bool:
        return any(out.glob(where))

    moments: list[Callable[[], bool]] = [
        (out / "config.toml").is_file,
        # Between the tensors of the first checkpoint and its JSON, if the kill is quick enough.
        lambda: writing("checkpoint-*.safetensors"),
        lambda: len(rows(out)) >= 1,
        lambda: len(rows(out)) >= 2 and writing(".checkpoint-*.part.*"),
        lambda: len(rows(out)) >= 3 and writing("resume/.state-*.part.*"),
    ]
    kills = 0
    for seen in moments:
        process = started(processes, route, config, out)
        if wait_until(seen, process):
            process.kill()
            kills += 1
        process.join()
        if kills:
            # Whatever moment it was: what stands there can be read.
            load_state(out)
            assert not (out / "checkpoint.json").exists() or load_checkpoint(out)
    assert kills >= 4
    last = started(processes, route, config, out)
    last.join()
    assert last.exitcode == 0
    assert outcome(out) == expected


_INTERRUPTED = """
import signal, sys
from pathlib import Path
from everplace.route.route import open_route
from everplace.training.config import TrainConfig
from everplace.training.fit import train

config = TrainConfig.build(model="vae", image_size=(32, 32), held_out_gap=2, batch_size=8, epochs=10_000)
try:
    train(open_route(sys.argv[1]), config, Path(sys.argv[2]), save_every=0)
except KeyboardInterrupt:
    # The next Ctrl-C must work again.
    sys.exit(130 if signal.getsignal(signal.SIGINT) is signal.default_int_handler else 3)
"""


@pytest.mark.slow
def test_ctrl_c_is_a_keyboard_interrupt_and_leaves_nothing_half_written(route_path: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    process = ForkedProcess("-c", _INTERRUPTED, route_path, out, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    end = time.monotonic() + _PATIENCE
    while not rows(out):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    shown, complaint = process.communicate(timeout=_PATIENCE)
    assert process.returncode == 130, complaint
    assert (shown, complaint) == ("", "")
    assert not [path.name for path in out.rglob("*") if ".part" in path.name]
    epochs = len(rows(out))
    state = load_state(out)
    # The state is written after the metrics: at most the last epoch has to be done again.
    assert state is None or state.progress.epoch in (epochs - 1, epochs)
    assert load_checkpoint(out).about["epoch"] <= epochs
