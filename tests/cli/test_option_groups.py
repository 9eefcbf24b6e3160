"""Options that a command takes in groups."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import typer
from typer.main import get_command

from everplace.cli import options
from everplace.cli.option_groups import RetrievalOptions, SelectionOptions, TrainingOptions, grouped
from everplace.errors import ConfigError


def called(command: Any, *arguments: str) -> None:
    app = typer.Typer()
    app.command()(command)
    get_command(app).main(args=list(arguments), standalone_mode=False)


def test_a_group_becomes_options_and_arrives_as_one() -> None:
    arrived: list[Any] = []

    @grouped
    def command(route: options.RouteArgument, *, asked: RetrievalOptions, out: options.OutFile, count: int = 3) -> None:
        arrived.append((route, asked, out, count))

    called(
        command, "r", "--query", "q", "--database", "d", "--method", "hog", "--out", "o", "--radius", "5", "--drop-dark"
    )
    asked = RetrievalOptions(query="q", database="d", method="hog", radius=5.0, drop_dark=True)
    assert arrived == [(Path("r"), asked, Path("o"), 3)]
    assert (asked.truth().radius, asked.selection().drop_dark, asked.matching().sequence) == (5.0, True, 1)


def test_what_a_command_cannot_do_without_is_asked_for() -> None:
    @grouped
    def command(*, asked: RetrievalOptions) -> None:
        raise AssertionError(asked)

    with pytest.raises(Exception, match="Missing parameter: method"):
        called(command, "--query", "q", "--database", "d")


def test_places_are_chosen_by_position() -> None:
    assert SelectionOptions(frames="2:5").selection().frames == slice(2, 5)
    assert SelectionOptions().selection().frames is None
    with pytest.raises(ConfigError, match="`frames`"):
        SelectionOptions(frames="2-5").selection()


def test_only_what_was_given_of_the_training_counts() -> None:
    assert TrainingOptions(seed=0, image_size=(32, 64)).given() == {"seed": 0, "image_size": (32, 64)}
    with pytest.raises(ConfigError, match="--epochs and --minutes exclude each other"):
        TrainingOptions(epochs=1, minutes=2.0)
