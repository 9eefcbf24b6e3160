"""On which devices and with which precision training runs."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch
from lightning import LightningModule, Trainer

from everplace.errors import ConfigError
from everplace.model.checkpoint import load_checkpoint
from everplace.model.inference import default_device
from everplace.route.route import Route
from everplace.training import trainer
from everplace.training.config import TrainConfig
from everplace.training.fit import train
from everplace.training.prefetch import BatchesAhead
from everplace.training.trainer import _Meeting, bf16_is_fast, own_device, require_devices, torch_settings_kept

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
    with pytest.raises(ConfigError, match="--devices 3 was asked for, but this machine has 2"):
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
    with torch_settings_kept():
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


@pytest.mark.parametrize("cuda", [False, True])
def test_batches_are_made_ahead_for_a_cuda_device(monkeypatch: pytest.MonkeyPatch, cuda: bool) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: cuda)
    made: list[tuple[object, object, bool]] = []

    def ahead(frames: object, order: object, *, pin: bool) -> str:
        made.append((frames, order, pin))
        return "ahead"

    monkeypatch.setattr(trainer, "BatchesAhead", ahead)
    monkeypatch.setattr(trainer, "DataLoader", lambda frames, *, sampler, **rest: ("here", frames, sampler))
    frames, order = object(), object()
    given: Any = trainer.make_loader(frames, order)  # type: ignore[arg-type]
    assert given == ("ahead" if cuda else ("here", frames, order))
    assert made == ([(frames, order, True)] if cuda else [])


@pytest.mark.parametrize("remedies", [{}, {"contrastive": 1.0}])
def test_a_run_is_the_same_whether_its_batches_are_made_ahead_or_not(
    route: Route, make_config: MakeConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, remedies: dict[str, float]
) -> None:
    config = make_config(epochs=3, batch_size=4, remedies=remedies, augmentation={"shift": 0.1, "brightness": 0.2})
    train(route, config, tmp_path / "one")
    made: list[BatchesAhead] = []

    def loader(frames: object, order: object) -> BatchesAhead:
        made.append(BatchesAhead(frames, order, pin=False, threads=3))  # type: ignore[arg-type]
        return made[-1]

    monkeypatch.setattr(trainer, "make_loader", loader)
    train(route, config, tmp_path / "other")
    assert len(made) == 1
    one, other = (load_checkpoint(tmp_path / name).model.state_dict() for name in ("one", "other"))
    assert all(torch.equal(one[name], other[name]) for name in one)


def test_python_answers_ctrl_c_again_when_machines_have_met_or_never_meet() -> None:
    before = signal.getsignal(signal.SIGINT)
    for met in True, False:
        meeting = _Meeting(show=False)
        meeting.wait(cast("Trainer", SimpleNamespace(strategy=None)))
        assert signal.getsignal(signal.SIGINT) == signal.SIG_DFL
        if met:
            meeting.setup(cast("Trainer", SimpleNamespace(strategy=None)), cast("LightningModule", object()), "fit")
        else:
            meeting.end()
        assert signal.getsignal(signal.SIGINT) == before
        meeting.end()
        assert signal.getsignal(signal.SIGINT) == before
