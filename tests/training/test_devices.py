"""Two processes that train one model (DDP on the CPU)."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from everplace.model.checkpoint import load_checkpoint
from everplace.training.frames import EpochOrder
from everplace.training.metrics_table import read_metrics

# Lightning starts the second process by running the script again.
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
read = TrainingFrames.__getitem__

def noted(frames, key):
    with (seen / rank).open("a") as file:
        print(json.dumps([key[0], key[1].tolist()]), file=file)
    return read(frames, key)

TrainingFrames.__getitem__ = noted
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

    order = EpochOrder(16, 8, seed=6)
    read = [[json.loads(line) for line in (seen / rank).read_text().splitlines()] for rank in ("0", "1")]
    for epoch in range(2):
        order.set_epoch(epoch)
        for (_, batch), *parts in zip(order, *(part[2 * epoch : 2 * epoch + 2] for part in read), strict=True):
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
    command = [sys.executable, "-m", "everplace.cli.main", "train", str(route_path), "--model", model]
    command += ["--image-size", "32", "32", "--config", str(settings), "--out", str(tmp_path / "run"), "--json"]
    command += [] if model == "fabmap" else ["--epochs", "1"]
    environment = {**os.environ, "SLURM_NTASKS": "4", "SLURM_PROCID": "1", "SLURM_LOCALID": "1", "OMP_NUM_THREADS": "1"}
    first, again = (
        subprocess.run(command, env=environment, capture_output=True, text=True, timeout=180, check=False)
        for _ in range(2)
    )
    assert first.returncode == 0, first.stderr
    assert json.loads(first.stdout)["run"] == str(tmp_path / "run")
    assert (tmp_path / "run" / "config.toml").is_file()
    if model == "vae" and find_spec("tensorboard") is not None:
        assert (tmp_path / "run" / "tensorboard").is_dir()
    assert again.returncode == 2
    assert "already holds a run" in again.stderr


@pytest.mark.slow
def test_ctrl_c_ends_the_wait_for_other_machines(route_path: Path, tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text("batch_size = 8\nheld_out_gap = 2\nepochs = 1")
    command = [sys.executable, "-m", "everplace", "train", str(route_path), "--model", "vae", "--nodes", "2"]
    command += ["--image-size", "32", "32", "--config", str(settings), "--out", str(tmp_path / "run")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            said = process.stderr.readline()
            assert re.search(r"waiting at 127\.0\.0\.1:\d+ for all 2 processes", said)
            time.sleep(1)  # until it waits
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=60) == -signal.SIGINT  # which a shell calls 130
        finally:
            process.kill()
