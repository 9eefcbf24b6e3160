"""On which devices and with which precision training runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch

from everplace.data.route import Route
from everplace.errors import ConfigError
from everplace.model.checkpoint import load_checkpoint
from everplace.training import trainer
from everplace.training.ahead import BatchesAhead
from everplace.training.config import TrainConfig
from everplace.training.fit import train
from everplace.training.trainer import bf16_is_fast, require_devices

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
    assert torch.utils.deterministic.fill_uninitialized_memory  # type: ignore[attr-defined]


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
