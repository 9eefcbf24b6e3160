"""`everplace train --settings`: a file for `--config` in which every setting is explained."""

from __future__ import annotations

from pathlib import Path

import pytest

from everplace.cli.main import run
from everplace.settings import read_toml
from everplace.training.fitted_methods import FITTED_METHODS, build_config


@pytest.mark.parametrize("model", [*FITTED_METHODS, "best"])
def test_all_settings_of_a_model_are_printed_as_the_file_that_gives_its_defaults(
    model: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run(["train", "--settings", model]) == 0
    shown = capsys.readouterr().out
    file = tmp_path / "settings.toml"
    file.write_text(shown, "utf-8")
    given = {"model": "cp-vae", "recipe": "best"} if model == "best" else {"model": model}
    assert build_config(**read_toml(file)) == build_config(**given)
    settings = [line for line in shown.splitlines() if " =" in line and not line.startswith("# Of")]
    assert all(shown.splitlines()[shown.splitlines().index(line) - 1].startswith("#") for line in settings)


def test_a_model_that_does_not_exist_has_no_settings(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["train", "--settings", "gan"]) == 2
    assert "--settings 'gan' is not known; choose vae" in capsys.readouterr().err
