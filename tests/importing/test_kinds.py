from __future__ import annotations

import types
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import BeforeValidator, Field, model_validator

from everplace.errors import ConfigError
from everplace.importing.foreign_route import SourceOptions
from everplace.importing.kinds import missing_extras, open_kind, read_options, source_kinds
from everplace.settings import explanations


class Options(SourceOptions):
    """Options of a kind."""

    rate: float = 1.0
    topics: tuple[str, ...] | None = None
    size: Annotated[tuple[int, int] | None, BeforeValidator(lambda text: tuple(map(int, text.split("x"))))] = None
    mode: Literal["a", "b"] = "a"
    flag: bool = False
    files: list[Path] = Field(default=[])

    @model_validator(mode="after")
    def _together(self) -> Options:
        if self.flag and self.mode == "b":
            raise ValueError("flag and mode b exclude each other")
        return self


def test_every_kind_has_a_summary_and_explains_its_options() -> None:
    kinds = source_kinds()
    assert "nordland" in kinds
    assert not {"folder", "protocol"} & set(kinds)
    assert not any(name.startswith("_") for name in kinds)
    for name, kind in kinds.items():
        assert kind.SUMMARY, name
        assert "\n" not in kind.SUMMARY
        for option, text in explanations(kind.Options).items():
            assert text.removeprefix("[").strip(), f"{name}.{option} is not explained"


def test_an_unknown_kind_offers_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="no kind of source 'nordlnd'; choose one of .*nordland"):
        open_kind("nordlnd")


def test_texts_become_values() -> None:
    given = {"rate": "2.5", "topics": "a, b,", "size": "64x32", "mode": "b", "flag": "true", "files": "x.txt"}
    with pytest.raises(ConfigError, match="flag and mode b exclude each other"):
        read_options("k", Options, given)
    read = read_options("k", Options, given | {"flag": "no"})
    assert read == Options(rate=2.5, topics=("a", "b"), size="64x32", mode="b", files=[Path("x.txt")])  # type: ignore[arg-type]
    assert read_options("k", Options, {}) == Options()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"speed": "1"}, "kind 'k' has no option 'speed'; it knows rate, topics, size, mode, flag, files"),
        ({"rate": "fast"}, "`rate`=fast cannot be: .*number"),
        ({"mode": "c"}, "`mode`=c cannot be: .*'a' or 'b'"),
    ],
)
def test_wrong_options_are_named(given: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_options("k", Options, given)


def test_a_kind_without_options_says_so() -> None:
    class Nothing(SourceOptions):
        pass

    assert explanations(Nothing) == {}
    with pytest.raises(ConfigError, match="it has none"):
        read_options("k", Nothing, {"a": "1"})


def test_missing_extras_are_found() -> None:
    module: Any = types.SimpleNamespace(EXTRAS={"numpy": "base", "no_such_package": "video", "nor_this": "bags"})
    assert missing_extras(module) == ["bags", "video"]
    assert missing_extras(types.SimpleNamespace()) == []
