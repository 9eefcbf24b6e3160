"""Messages of the library name arguments, which the command writes as its options."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import pytest
from tests.cli.test_main import call, refused
from typer.main import get_command

import everplace as ep
from everplace.cli import main
from everplace.cli.option_names import naming_options, with_options
from everplace.errors import EverplaceError
from everplace.files import readable
from everplace.importing.import_route import import_route

SOURCES = Path(ep.__file__).parent
OPTION = re.compile(r"(?<![\w-])--[a-z]")


def texts(module: Path) -> list[str]:
    """All texts in a module that are no docstrings."""
    tree = ast.parse(module.read_text("utf-8"))
    told = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    constants = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in told)
    return [node.value for node in constants if isinstance(node.value, str)]


def test_no_text_of_the_library_names_an_option_of_the_command() -> None:
    found = {
        f"{module.relative_to(SOURCES)}: {text}"
        for module in SOURCES.rglob("*.py")
        if module.relative_to(SOURCES).parts[0] != "cli"
        for text in texts(module)
        if OPTION.search(text)
        and "tar --dereference" not in text
        and "convmv -f" not in text  # other programs' options
    }
    assert found == set()


@pytest.mark.parametrize(
    ("arguments", "message", "told"),
    [
        (("train",), "give `image_size`", "give --image-size"),
        (("train",), "add `resume=True` to it", "add --resume to it"),
        (("train",), "`out` x` holds `frames` 3", "--out x` holds --frames 3"),
        (("match",), "`format` 'x' is not known", "--format 'x' is not known"),
        (("match",), "`file_format` and `kind` and `frames`", "`file_format` and `kind` and `frames`"),  # none of these
        (("data", "align"), "align `by=poses` or `by=pairs`", "align --by poses or --by pairs"),
        (("data", "import", "images", "x"), "import with `stems=own`", "import with --set stems=own"),
        (("data", "import", "images", "x"), "`size`=0x3 cannot be", "--set size=0x3 cannot be"),
        (("data", "import", "tum", "x"), "`sequences` and `camera=ID`", "`sequences` and `camera=ID`"),  # of others
        (("describe",), "make it with `everplace describe --out x`", "make it with `everplace describe --out x`"),
        (("data",), "choose `out`", "choose `out`"),
    ],
)
def test_arguments_are_written_as_options_of_the_command_that_runs(
    arguments: tuple[str, ...], message: str, told: str
) -> None:
    command = get_command(main.app)
    for name in arguments[:2]:
        command = getattr(command, "commands", {}).get(name, command)
    with naming_options(command, arguments):
        assert with_options(message) == told
    assert with_options(message) == message


@pytest.mark.parametrize(
    ("command", "in_python", "argument", "option"),
    [
        (
            ["evaluate", "{route}", "--method", "sad", "--database", "summer", "--query", "winter", "--frames", "90:"],
            lambda route, out: ep.select(ep.open_route(route), ep.Selection(slice(90, None))),
            "`frames` begins at position 90",
            "--frames begins at position 90",
        ),
        (
            ["evaluate", "{route}", "--method", "sad", "--database", "summer", "--query", "winter", "--radius", "-1"],
            lambda route, out: ep.retrieve(ep.open_route(route), "winter", "summer", "sad", radius=-1),
            "`radius` -1 is not",
            "--radius -1.0 is not",
        ),
        (
            ["train", "{route}", "--model", "vae", "--recipe", "best"],
            lambda route, out: ep.train(ep.open_route(route), "vae", out, recipe="best"),
            "`recipe=best` is a recipe of cp-vae",
            "--recipe best is a recipe of cp-vae",
        ),
        (
            ["data", "align", "{route}", "--by", "poses"],
            lambda route, out: ep.align(ep.open_route(route), out, by="poses"),
            "align `by=pairs` or `by=images`",
            "align --by pairs or --by images",
        ),
        (
            ["data", "import", "images", "{route}", "--set", "size=0x3"],
            lambda route, out: import_route("images", route, out, {"size": "0x3"}),
            "`size`=0x3 cannot be",
            "--set size=0x3 cannot be",
        ),
    ],
)
def test_python_names_the_argument_and_the_command_the_option(
    unchanged_tiny_route: Path, tmp_path: Path, command: list[str], in_python: object, argument: str, option: str
) -> None:
    assert callable(in_python)
    with pytest.raises(EverplaceError) as error:
        in_python(unchanged_tiny_route, tmp_path / "out")
    assert argument in str(error.value)
    given = [part.format(route=unchanged_tiny_route) for part in command]
    said = refused(*given, "--out", tmp_path / "out")
    assert option in said
    assert "`" not in said


def test_notes_name_options_also_in_json(tiny_route: Path, tmp_path: Path) -> None:
    (tiny_route / "summer" / "0.png").rename(tiny_route / "summer" / "a.png")
    status, out, _ = call("data", "import", "images", tiny_route, "--out", tmp_path / "route", "--json")
    assert status == 0
    (note,) = json.loads(out)["notes"]
    assert "import with --set stems=own and align them" in note, readable(note)
