from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field, ValidationError, model_validator

from everplace.errors import ConfigError
from everplace.settings import Problem, Settings, explained_toml, explanations, first_problem, read_settings, read_toml


class Inner(Settings):
    weight: Annotated[float, Field(ge=0)] = 1.0
    """Of the term."""


class Outer(Settings):
    rate: float = 2.0
    """Frames a second."""
    topics: tuple[str, ...] = ()
    """Which topics to read, the first
    is the image's."""
    inner: Inner = Inner()
    """Weights."""
    tables: dict[str, Inner] = Field(default={})
    mode: Literal["a", "b"]
    """How."""

    @model_validator(mode="after")
    def _together(self) -> Outer:
        if self.mode == "b" and self.topics:
            raise ValueError("topics and mode b exclude each other")
        return self


class Heir(Outer):
    sizes: tuple[int, ...] = (3, 4)
    """Of what it has more."""


def test_a_setting_is_explained_by_the_string_under_it_and_its_default() -> None:
    told = explanations(Heir)
    assert told["rate"] == "Frames a second. [2.0]"
    assert told["topics"] == "Which topics to read, the first is the image's."
    assert told["mode"] == "How."
    assert told["sizes"] == "Of what it has more. [3,4]"
    assert told["inner"] == "Weights."
    assert told["inner.weight"] == "Of the term. [1.0]"


def problem(**values: object) -> Problem:
    with pytest.raises(ValidationError) as caught:
        Outer.model_validate(values)
    return first_problem(caught.value, Outer)


def test_a_problem_is_told_with_its_setting_its_value_and_what_may_stand_there() -> None:
    assert problem(mode="c") == Problem("mode", "Input should be 'a' or 'b'", "literal_error", "c", None)
    assert problem(mode="a", colour=1)[3:] == (1, ("rate", "topics", "inner", "tables", "mode"))
    assert problem(mode="b", topics=("x",))[:2] == ("", "topics and mode b exclude each other")
    for values, setting in (({"inner": {"wait": 1}}, "inner.wait"), ({"tables": {"x": {"wait": 1}}}, "tables.x.wait")):
        found = problem(mode="a", **values)
        assert (found.setting, found.known) == (setting, ("weight",))


def test_a_file_without_a_needed_key(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text("rate = 3\n")
    with pytest.raises(ConfigError, match=r"own\.toml lacks 'mode'; add it"):
        read_settings(path, Outer)
    path.write_text("rate = 3\nmode = 'a'\n", "utf-8-sig")
    assert read_settings(path, Outer) == Outer(rate=3.0, mode="a")


def test_a_file_is_called_as_it_was_given(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="^cannot read --config own: No such file or directory; check the path"):
        read_toml(tmp_path / "own.toml", "--config own")


def test_explained_values_are_toml_that_gives_them_back(tmp_path: Path) -> None:
    values = Plain(rate=0.5, topics=("one", 'quo"ted'), inner=Inner(weight=3.0), last=True)
    text = explained_toml(values)
    (tmp_path / "own.toml").write_text(text, "utf-8")
    assert Plain.model_validate(read_toml(tmp_path / "own.toml")) == values
    assert "# Which topics to read, the first is the image's.\ntopics = [" in text
    assert "# Weights.\n[inner]" in text


class Plain(Settings):
    rate: float = 2.0
    topics: tuple[str, ...] = ()
    """Which topics to read, the first
    is the image's."""
    inner: Inner = Inner()
    """Weights."""
    last: bool = False


class Maybe(Settings):
    sizes: tuple[int, ...] = (224, 96)
    """In pixels."""
    minutes: float | None = None
    """Stop after so much time."""


def test_what_is_not_set_is_a_comment() -> None:
    assert explained_toml(Maybe()) == "# In pixels.\nsizes = [224, 96]\n\n# Stop after so much time.\n# minutes ="
