"""What stands in a run directory, and whether it may be continued."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from everplace import locking
from everplace.errors import CheckpointError, ConfigError
from everplace.training.config import CONFIG_FILE, TrainConfig
from everplace.training.resume_state import RESUME, RunProgress, save_state
from everplace.training.run_directory import leads, locked_run, prepare_run, require_usable, what_stands

MakeConfig = Callable[..., TrainConfig]


def begin(out: Path, config: TrainConfig, processes: int = 1) -> None:
    """What a run leaves that was stopped after its first epoch."""
    prepare_run(out, config, resume=False, processes=processes)
    save_state(out, RunProgress(epoch=1), None, None)


def test_a_new_directory_gets_the_configuration(tmp_path: Path, make_config: MakeConfig) -> None:
    assert prepare_run(tmp_path / "deep" / "run", make_config(), resume=False) is None
    assert [path.name for path in (tmp_path / "deep" / "run").iterdir()] == [CONFIG_FILE]


def test_resume_with_nothing_there_starts(tmp_path: Path, make_config: MakeConfig) -> None:
    assert prepare_run(tmp_path / "run", make_config(), resume=True) is None
    # And so does a run that was stopped before its first state.
    assert prepare_run(tmp_path / "run", make_config(), resume=True) is None


def test_another_run_is_not_overwritten(tmp_path: Path, make_config: MakeConfig) -> None:
    begin(tmp_path, make_config())
    with pytest.raises(ConfigError, match=f"{tmp_path} already holds a run; add `resume=True`"):
        prepare_run(tmp_path, make_config(), resume=False)


@pytest.mark.parametrize("resume", [False, True])
def test_a_run_that_failed_before_its_first_state_keeps_nobody_from_another(
    tmp_path: Path, make_config: MakeConfig, resume: bool
) -> None:
    prepare_run(tmp_path, make_config(seed=1), resume=False)
    (tmp_path / RESUME).mkdir()  # killed while it wrote it
    assert prepare_run(tmp_path, make_config(seed=2), resume=resume) is None
    assert "seed = 2" in (tmp_path / CONFIG_FILE).read_text()


def test_a_file_is_no_run_directory(tmp_path: Path, make_config: MakeConfig) -> None:
    (tmp_path / "run").write_text("")
    with pytest.raises(ConfigError, match="run is a file; name a directory"):
        prepare_run(tmp_path / "run", make_config(), resume=False)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("epochs", {"epochs": 3}),
        ("seed", {"seed": 1}),
        ("weights", {"weights": {"place": 2.0}}),
        ("conditions", {"conditions": ("day", "night")}),
        ("model", {"model": "vae"}),
    ],
)
def test_another_setting_is_named_when_resuming(
    tmp_path: Path, make_config: MakeConfig, name: str, change: dict[str, object]
) -> None:
    begin(tmp_path, make_config())
    before = (tmp_path / CONFIG_FILE).read_bytes()
    with pytest.raises(ConfigError, match=f"`resume=True` continues a run with its own settings, but {name} was"):
        prepare_run(tmp_path, make_config(**change), resume=True)
    assert (tmp_path / CONFIG_FILE).read_bytes() == before


@pytest.mark.parametrize("text", ["[", "colour = 1\n", 'model = "vae"\n'])
def test_an_altered_configuration_is_named(tmp_path: Path, make_config: MakeConfig, text: str) -> None:
    begin(tmp_path, make_config())
    (tmp_path / CONFIG_FILE).write_text(text)
    with pytest.raises(CheckpointError, match=r"config\.toml was not written by this version"):
        prepare_run(tmp_path, make_config(), resume=True)


def test_the_state_comes_back_and_leftovers_of_a_killed_process_go(tmp_path: Path, make_config: MakeConfig) -> None:
    prepare_run(tmp_path, make_config(), resume=False)
    save_state(tmp_path, RunProgress(epoch=1, best_epoch=1, best_value=0.5), None, None)
    leftovers = [
        tmp_path / ".checkpoint-0a.12-0123abcd.part.safetensors",
        tmp_path / RESUME / ".state.12-89abcdef.part.json",
    ]
    for leftover in leftovers:
        leftover.write_bytes(b"half")
    (tmp_path / "notes.part.txt").write_text("somebody's own")
    state = prepare_run(tmp_path, make_config(), resume=True)
    assert state is not None
    assert state.progress.epoch == 1
    assert not any(leftover.exists() for leftover in leftovers)
    assert (tmp_path / "notes.part.txt").exists()


def test_looking_makes_no_directory(tmp_path: Path, make_config: MakeConfig) -> None:
    require_usable(tmp_path / "run", make_config(), resume=True)
    assert not (tmp_path / "run").exists()


def test_one_run_at_a_time_is_written_into_a_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locking, "_SECONDS_TO_LET_GO", 0.2)
    with locked_run(tmp_path, processes=2), monkeypatch.context() as patch:
        patch.setenv("LOCAL_RANK", "1")
        with locked_run(tmp_path, processes=2):
            pass  # of the same run
        with pytest.raises(ConfigError, match="is being written by another process"), locked_run(tmp_path):
            pass


@pytest.mark.parametrize(
    ("ranks", "expected"),
    [
        ({"RANK": "0", "LOCAL_RANK": "0", "GROUP_RANK": "0"}, True),
        ({"RANK": "1", "LOCAL_RANK": "1", "GROUP_RANK": "0"}, False),
        ({"RANK": "2", "LOCAL_RANK": "0", "GROUP_RANK": "1"}, False),
        ({"SLURM_PROCID": "0", "SLURM_LOCALID": "0"}, True),
        ({"SLURM_PROCID": "4", "SLURM_LOCALID": "0"}, False),
        # Lightning starts the second process of an interactive SLURM job by itself.
        ({"SLURM_PROCID": "0", "LOCAL_RANK": "1"}, False),
        ({"NODE_RANK": "1"}, False),
    ],
)
def test_the_first_of_all_processes_leads(
    monkeypatch: pytest.MonkeyPatch, ranks: dict[str, str], expected: bool
) -> None:
    for name, rank in ranks.items():
        monkeypatch.setenv(name, rank)
    assert leads(4) is expected
    assert leads(1)


@pytest.mark.parametrize(("local", "node", "expected"), [("0", "0", True), ("1", "0", False), ("0", "1", False)])
def test_one_process_of_all_writes_the_run(
    tmp_path: Path, make_config: MakeConfig, monkeypatch: pytest.MonkeyPatch, local: str, node: str, expected: bool
) -> None:
    assert leads(4)
    begin(tmp_path / "begun", make_config(), processes=4)
    monkeypatch.setenv("LOCAL_RANK", local)
    monkeypatch.setenv("NODE_RANK", node)
    assert leads(4) is expected
    if not expected:
        # The others come when the first one has begun already.
        assert prepare_run(tmp_path / "begun", make_config(), resume=False, processes=4) is None
        prepare_run(tmp_path / "new", make_config(), resume=False, processes=4)
        assert not (tmp_path / "new").exists()
    with pytest.raises(ConfigError, match="already holds a run"):
        prepare_run(tmp_path / "begun", make_config(), resume=False)


@pytest.mark.parametrize("name", [RESUME, "tensorboard"])
def test_a_file_where_the_run_needs_a_directory_is_told_first(
    tmp_path: Path, make_config: MakeConfig, name: str
) -> None:
    (tmp_path / name).write_text("")
    with pytest.raises(ConfigError, match=f"{name} is a file where the run needs a directory"):
        require_usable(tmp_path, make_config(), resume=False)


@pytest.mark.parametrize("name", [CONFIG_FILE, "metrics.csv", "checkpoint.json"])
def test_a_directory_where_the_run_writes_a_file_is_told_first(
    tmp_path: Path, make_config: MakeConfig, name: str
) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(ConfigError, match=f"{name} is no file, which the run needs to write"):
        require_usable(tmp_path, make_config(), resume=True)


def test_what_a_stopped_run_left_is_said(tmp_path: Path, make_config: MakeConfig) -> None:
    out = tmp_path / "run"
    assert what_stands(out) == "nothing was written; give the same command again"
    prepare_run(out, make_config(), resume=False)
    assert what_stands(out).startswith(f"{out} holds the settings and no epoch yet, so the same command begins anew")
    save_state(out, RunProgress(epoch=1), None, None)
    assert what_stands(out).startswith(f"the finished epochs stand in {out}; the same command with `resume=True` goes")
