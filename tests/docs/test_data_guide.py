"""The guide to data names everything that there is, and its commands are commands."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from everplace.cli.main import app
from everplace.errors import EverplaceError
from everplace.importing.catalogue import DATA_SETS
from everplace.importing.kinds import read_options, source_kinds
from everplace.importing.sources._nordland_presets import PRESETS

GUIDE = (Path(__file__).parents[2] / "docs" / "data.md").read_text(encoding="utf-8")
LINES = GUIDE.replace("\\\n", "")
COMMANDS = [line.strip("`") for line in re.findall(r"^everplace data .*$|`everplace data [^`]*`", LINES, re.MULTILINE)]


def table(first_column: str) -> dict[str, list[str]]:
    """Returns the rows of the table whose first column is called so, by what their first cell holds."""
    lines = GUIDE[GUIDE.index(f"\n| {first_column} |") :].strip().partition("\n\n")[0].splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split(" |")] for line in lines[2:]]
    return {row[0].strip("`"): row[1:] for row in rows}


def test_every_kind_has_a_row_with_a_command_and_its_extras() -> None:
    rows = table("kind")
    assert list(rows) == list(source_kinds())
    for name, kind in source_kinds().items():
        command, reads, archive, truth, extras = rows[name]
        assert command.startswith(f"`everplace data import {name} ")
        assert reads
        assert archive in {"yes", ""}
        assert truth
        assert sorted(re.findall("`(.*?)`", extras)) == sorted(set(getattr(kind, "EXTRAS", {}).values()))


def test_the_kinds_that_read_archives_are_told(tmp_path: Path) -> None:
    archive = tmp_path / "broken.zip"
    archive.write_bytes(b"PK\3\4 and no more")
    for name, kind in source_kinds().items():
        with pytest.raises(EverplaceError) as caught:
            kind.read(archive, kind.Options())
        assert ("truncated or damaged" in str(caught.value)) == (table("kind")[name][2] == "yes")


def test_every_preset_has_a_row_with_its_tolerance() -> None:
    told = {name: row[1] for name, row in table("preset").items()}
    assert told == {name: f"±{preset.tolerance}" for name, preset in PRESETS.items()}


def test_every_data_set_has_a_row_that_says_whether_it_can_be_fetched() -> None:
    rows = table("name")
    assert set(rows) == {data_set.name for data_set in DATA_SETS}
    for data_set in DATA_SETS:
        assert rows[data_set.name][0].startswith("cannot be fetched") == bool(data_set.unavailable)


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_and_its_options_exist(line: str) -> None:
    _, _, name, *arguments = shlex.split(line)
    commands: Any = get_command(app)
    parsed = commands.commands["data"].commands[name].make_context(name, arguments).params
    if name == "import":
        given = dict(option.split("=", 1) for option in parsed["options"] or ())
        read_options(parsed["kind"], source_kinds()[parsed["kind"]].Options, given)


def test_every_option_that_is_spoken_of_is_one_of_a_kind() -> None:
    known = set().union(*(kind.Options.model_fields for kind in source_kinds().values()))
    spoken = set(re.findall(r"--set '?(\w+)=", GUIDE)) - {"name"}
    assert len(spoken) > 20
    assert spoken <= known
