"""On which devices and with which precision training runs; two processes that train one model (DDP on the CPU)."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tests.forked import ForkedProcess

from everplace.errors import ConfigError
from everplace.model.checkpoint import load_checkpoint
from everplace.model.inference import default_device
from everplace.route.route import Route, open_route
from everplace.training.config import TrainConfig
from everplace.training.devices import (
    _interruptible,
    bf16_is_fast,
    deterministic_training,
    own_device,
    require_devices,
)
from everplace.training.fit import train
from everplace.training.frames import TrainingFrames, split_route
from everplace.training.metrics_table import read_metrics

MakeConfig = Callable[..., TrainConfig]


def test_bfloat16_is_used_only_where_the_device_multiplies_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx2": True, "avx512_bf16": False}, raising=False)
    assert not bf16_is_fast("cpu")
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": True}, raising=False)
    assert bf16_is_fast("cpu")


def test_no_more_devices_than_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    require_devices(2)
    with pytest.raises(ConfigError, match="`devices` 3 was asked for, but this machine has 2"):
        require_devices(3)


@pytest.fixture
def torch_settings() -> Iterator[None]:
    """Puts back what a test changes."""
    yield
    torch.use_deterministic_algorithms(False)
    torch.backends.cudnn.benchmark = False


@pytest.mark.usefixtures("torch_settings")
@pytest.mark.parametrize(("deterministic", "warn"), [(False, False), (True, False), (True, True)])
def test_training_leaves_the_settings_of_torch_as_they_were(
    route: Route, make_config: MakeConfig, tmp_path: Path, deterministic: bool, warn: bool
) -> None:
    torch.use_deterministic_algorithms(deterministic, warn_only=warn)
    torch.backends.cudnn.benchmark = True
    train(route, make_config(epochs=1), tmp_path / "run")
    assert torch.are_deterministic_algorithms_enabled() == deterministic
    assert torch.is_deterministic_algorithms_warn_only_enabled() == warn
    assert torch.backends.cudnn.benchmark


@pytest.mark.usefixtures("torch_settings")
@pytest.mark.parametrize("workspace", [None, ":16:8"])
def test_the_settings_of_torch_come_back(monkeypatch: pytest.MonkeyPatch, workspace: str | None) -> None:
    monkeypatch.delenv("CUBLAS_WORKSPACE_CONFIG", raising=False)
    if workspace is not None:
        monkeypatch.setenv("CUBLAS_WORKSPACE_CONFIG", workspace)
    filling: Any = torch.utils.deterministic
    torch.backends.cudnn.benchmark = True
    with deterministic_training():
        assert os.environ["CUBLAS_WORKSPACE_CONFIG"] == (workspace or ":4096:8")
        assert not filling.fill_uninitialized_memory
        torch.use_deterministic_algorithms(True)
        torch.backends.cudnn.benchmark = False
    assert os.environ.get("CUBLAS_WORKSPACE_CONFIG") == workspace
    assert filling.fill_uninitialized_memory
    assert torch.backends.cudnn.benchmark
    assert not torch.are_deterministic_algorithms_enabled()


def test_each_process_has_a_device_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    assert own_device(2).type == default_device().type
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.delenv("LOCAL_RANK", raising=False)
    assert own_device(4) == torch.device("cuda", 0)
    monkeypatch.setenv("LOCAL_RANK", "2")
    assert own_device(4) == torch.device("cuda", 2)
    assert own_device(1) == torch.device("cuda", 0)


def test_python_answers_ctrl_c_again_when_machines_have_met_or_never_meet() -> None:
    before = signal.getsignal(signal.SIGINT)
    with _interruptible():
        assert signal.getsignal(signal.SIGINT) == signal.SIG_DFL
    assert signal.getsignal(signal.SIGINT) == before
    with pytest.raises(OSError, match="never met"), _interruptible():
        raise OSError("never met")
    assert signal.getsignal(signal.SIGINT) == before


# Fabric starts the second process by running the script again.
_SCRIPT = """
import json, os, sys
from dataclasses import asdict
from pathlib import Path
from everplace.route.route import open_route
from everplace.training.config import TrainConfig
from everplace.training.fit import train
from everplace.training.frames import TrainingFrames

route, out, seen = map(Path, sys.argv[1:])
rank = os.environ.get("LOCAL_RANK", "0")
read = TrainingFrames.batch

def noted(frames, epoch, positions):
    with (seen / rank).open("a") as file:
        print(json.dumps([epoch, positions.tolist()]), file=file)
    return read(frames, epoch, positions)

TrainingFrames.batch = noted
config = TrainConfig.build(model="cp-vae", image_size=(32, 32), held_out_gap=2, batch_size=8, epochs=2, seed=6)
summary = train(open_route(route), config, out, devices=2, save_every=0)
(seen / f"{rank}.json").write_text(json.dumps(asdict(summary)))
"""


@pytest.mark.slow
def test_two_processes_train_one_run_on_the_frames_that_one_would_take(route_path: Path, tmp_path: Path) -> None:
    script, out, seen = tmp_path / "train.py", tmp_path / "run", tmp_path / "seen"
    script.write_text(_SCRIPT)
    seen.mkdir()
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "CUDA_VISIBLE_DEVICES": ""}
    done = subprocess.run(
        [sys.executable, script, route_path, out, seen],
        env=environment, capture_output=True, text=True, timeout=180, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""

    config = TrainConfig.build(model="cp-vae", image_size=(32, 32), held_out_gap=2, batch_size=8, epochs=2, seed=6)
    frames = TrainingFrames(split_route(open_route(route_path), config), config.augmentation, 8, seed=6)
    read = [[json.loads(line) for line in (seen / rank).read_text().splitlines()] for rank in ("0", "1")]
    for epoch in range(2):
        for batch, *parts in zip(frames.order(epoch), *(part[2 * epoch : 2 * epoch + 2] for part in read), strict=True):
            assert [part_epoch for part_epoch, _ in parts] == [epoch, epoch]
            assert all(len(positions) == 4 for _, positions in parts)
            assert sorted(np.concatenate([positions for _, positions in parts])) == sorted(batch)

    assert read_metrics(out)["epoch"].tolist() == [1, 2]
    assert load_checkpoint(out).about["epoch"] in (1, 2)
    first, second = (json.loads((seen / f"{rank}.json").read_text()) for rank in ("0", "1"))
    assert first["best_epoch"] == load_checkpoint(out).about["epoch"]
    # Both know how the run ended.
    assert second == first


@pytest.mark.slow
@pytest.mark.parametrize("model", ["vae", "fabmap"])
def test_each_task_of_a_cluster_job_may_train_a_run_of_its_own(route_path: Path, tmp_path: Path, model: str) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text(
        "words = 8\nsmallest_side = 64\n" if model == "fabmap" else "batch_size = 8\nheld_out_gap = 2\n"
    )
    command = ["-m", "everplace.cli.main", "train", str(route_path), "--model", model]
    command += ["--image-size", "32", "32", "--config", str(settings), "--out", str(tmp_path / "run"), "--json"]
    command += [] if model == "fabmap" else ["--epochs", "1"]
    environment = {**os.environ, "SLURM_NTASKS": "4", "SLURM_PROCID": "1", "SLURM_LOCALID": "1"}

    def trained() -> tuple[int, str, str]:
        process = ForkedProcess(*command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        out, err = process.communicate(timeout=180)
        return process.returncode, out, err

    status, out, err = trained()
    assert status == 0, err
    assert json.loads(out)["run"] == str(tmp_path / "run")
    assert (tmp_path / "run" / "config.toml").is_file()
    if model == "vae" and find_spec("tensorboard") is not None:
        assert (tmp_path / "run" / "tensorboard").is_dir()
    status, _, err = trained()
    assert status == 2
    assert "already holds a run" in err


@pytest.mark.slow
def test_ctrl_c_ends_the_wait_for_other_machines(route_path: Path, tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text("batch_size = 8\nheld_out_gap = 2\nepochs = 1")
    command = ["-m", "everplace", "train", str(route_path), "--model", "vae", "--nodes", "2"]
    command += ["--image-size", "32", "32", "--config", str(settings), "--out", str(tmp_path / "run")]
    with ForkedProcess(*command, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        try:
            said = process.stderr.readline()
            assert re.search(r"waiting at 127\.0\.0\.1:\d+ for all 2 processes", said)
            time.sleep(1)  # until it waits
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=60) == -signal.SIGINT  # which a shell calls 130
        finally:
            process.kill()
