"""What only resuming needs: exact, and refused when damaged."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from everplace.errors import CheckpointError
from everplace.training.resume_state import RESUME, ResumeState, RunProgress, load_state, require_fitting, save_state


def stepped() -> tuple[torch.nn.Module, torch.optim.Optimizer]:
    """A model and an optimizer that has moments."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        model = torch.nn.Sequential(torch.nn.Linear(3, 2), torch.nn.BatchNorm1d(2))
        optimizer = torch.optim.AdamW(model.parameters(), fused=True)
        for _ in range(3):
            model(torch.randn(4, 3)).square().sum().backward()
            optimizer.step()
    return model, optimizer


def test_there_may_be_nothing_to_resume(tmp_path: Path) -> None:
    assert load_state(tmp_path) is None


def test_round_trip_is_exact(tmp_path: Path) -> None:
    model, optimizer = stepped()
    progress = RunProgress(epoch=3, seconds=1.25, best_epoch=2, best_value=-0.5)
    save_state(tmp_path, progress, model, optimizer, "fa0e")
    state = load_state(tmp_path)
    assert state is not None
    assert (state.progress, state.images) == (progress, "fa0e")
    require_fitting(state, model)
    assert state.model.keys() == model.state_dict().keys()
    assert all(torch.equal(state.model[key], value) for key, value in model.state_dict().items())
    expected = optimizer.state_dict()["state"]
    assert state.optimizer.keys() == expected.keys()
    for index, moments in expected.items():
        assert state.optimizer[index].keys() == moments.keys()
        assert all(torch.equal(state.optimizer[index][key], value) for key, value in moments.items())


def test_a_finished_run_keeps_no_tensors(tmp_path: Path) -> None:
    save_state(tmp_path, RunProgress(), *stepped())
    save_state(tmp_path, RunProgress(epoch=4, finished=True), None, None)
    state = load_state(tmp_path)
    assert state is not None
    assert state.progress.finished
    assert (state.model, state.optimizer) == ({}, {})


def test_a_damaged_state_is_named(tmp_path: Path) -> None:
    save_state(tmp_path, RunProgress(), *stepped())
    (weights,) = (tmp_path / RESUME).glob("*.safetensors")
    weights.write_bytes(weights.read_bytes()[:-1])
    with pytest.raises(CheckpointError, match=weights.name):
        load_state(tmp_path)


@pytest.mark.parametrize(
    "progress",
    [
        None,
        [],
        {"epoch": 1, "colour": 2},
        {"epoch": "1"},
        {"epoch": 1.0},
        {"epoch": True},
        {"epoch": -1},
        {"seconds": "1"},
        {"best_value": "0.5"},
        {"finished": 1},
    ],
)
def test_another_kind_of_progress_is_refused(tmp_path: Path, progress: object) -> None:
    save_state(tmp_path, RunProgress(), *stepped())
    path = tmp_path / RESUME / "state.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "progress": progress}))
    with pytest.raises(CheckpointError, match=f"{RESUME} is not what this version writes"):
        load_state(tmp_path)


def test_a_number_that_json_does_not_have_is_refused(tmp_path: Path) -> None:
    save_state(tmp_path, RunProgress(), *stepped())
    path = tmp_path / RESUME / "state.json"
    path.write_text(path.read_text().replace('"seconds": 0.0', '"seconds": NaN'))
    with pytest.raises(CheckpointError, match=r"state\.json cannot be read as JSON \(NaN is no number of JSON\)"):
        load_state(tmp_path)


@pytest.mark.parametrize(
    ("index", "moments"),
    [
        (0, {"step": (), "exp_avg": (2, 2), "exp_avg_sq": (2, 3)}),
        (0, {"step": (2,), "exp_avg": (2, 3), "exp_avg_sq": (2, 3)}),
        (0, {"step": (), "exp_avg": (2, 3)}),
        (0, {"step": (), "exp_avg": (2, 3), "exp_avg_sq": (2, 3), "max": (2, 3)}),
        (4, {"step": (), "exp_avg": (2,), "exp_avg_sq": (2,)}),
        (-1, {"step": (), "exp_avg": (2,), "exp_avg_sq": (2,)}),
    ],
)
def test_moments_that_do_not_fit_are_refused(index: int, moments: dict[str, tuple[int, ...]]) -> None:
    model, _ = stepped()
    optimizer = {index: {name: torch.zeros(shape) for name, shape in moments.items()}}
    with pytest.raises(CheckpointError, match="do not fit the model"):
        require_fitting(ResumeState(RunProgress(), dict(model.state_dict()), optimizer), model)


def test_weights_that_do_not_fit_are_refused() -> None:
    model, _ = stepped()
    for weights in (
        {},
        {**model.state_dict(), "0.bias": torch.zeros(3)},
        {**model.state_dict(), "new": torch.zeros(1)},
    ):
        with pytest.raises(CheckpointError, match="do not fit the model"):
            require_fitting(ResumeState(RunProgress(), weights, {}), model)
