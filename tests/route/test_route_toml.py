from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fuzzing import fuzzed

from everplace.errors import ConfigError
from everplace.route.route_toml import RouteToml, read_route_toml


def read(root: Path, text: str) -> RouteToml:
    (root / "route.toml").write_text(text, encoding="utf-8")
    return read_route_toml(root)


def test_no_file_means_defaults(tmp_path: Path) -> None:
    assert read_route_toml(tmp_path) == RouteToml()
    assert read_route_toml(tmp_path / "gone") == RouteToml()
    (tmp_path / "file").touch()
    assert read_route_toml(tmp_path / "file") == RouteToml()


def test_everything_that_can_be_said(tmp_path: Path) -> None:
    settings = read(
        tmp_path,
        'radius = 25\nignore = ["thumbs"]\n'
        '[traverses."jan 14"]\ncondition = "winter"\npattern = "left_*.png"\nposes = "poses/jan.csv"\n',
    )
    assert settings.radius == 25.0
    assert settings.tolerance is None
    assert settings.ignore == ("thumbs",)
    assert settings.traverses["jan 14"].model_dump() == {
        "condition": "winter",
        "pattern": "left_*.png",
        "poses": "poses/jan.csv",
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "tolerence = 1",
            "unknown key 'tolerence' in .*route.toml; known here: aligned, aligned_by, ignore, protocol, radius, "
            "tolerance, traverses, truth, truth_from",
        ),
        (
            '[traverses.jan]\ncolour = "red"',
            "unknown key 'traverses.jan.colour' in .*route.toml; known here: condition, pattern, poses",
        ),
        ("tolerance = -1", "wrong value of 'tolerance' in .*route.toml"),
        ("tolerance = 1.5", "wrong value of 'tolerance'"),
        ('tolerance = "1"', "wrong value of 'tolerance'"),
        ("tolerance = true", "wrong value of 'tolerance'"),
        ("radius = 0.0", "wrong value of 'radius'"),
        ("radius = inf", "wrong value of 'radius'"),
        ("tolerance = 1\nradius = 2.0", "tolerance and radius exclude each other"),
        ('radius = 2.0\ntruth = "truth.csv"', "radius and truth exclude each other"),
        ('truth = ""', "wrong value of 'truth'"),
        ('ignore = "thumbs"', "wrong value of 'ignore'"),
        ("truth_from = ''", "wrong value of 'truth_from'"),
        ("aligned_by = 3", "wrong value of 'aligned_by'"),
        ("[traverses.jan]\npattern = 'a/*.png'", "wrong value of 'traverses.jan.pattern'"),
        ("[traverses.jan]\ncondition = ''", "wrong value of 'traverses.jan.condition'"),
        ("traverses = 3", "wrong value of 'traverses'"),
        ("tolerance = ", "route.toml is not valid TOML"),
    ],
)
def test_mistakes_name_key_and_file(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        read(tmp_path, text)
    assert str(tmp_path / "route.toml") in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ignore = " + "[" * 100_000, "nests its values too deeply"),
        ("ignore = " + "{a=" * 5_000, "nests its values too deeply"),
        ("tolerance = 1" + "0" * 5_000, "is not valid TOML"),
    ],
    ids=["lists", "tables", "digits"],
)
def test_what_the_parser_gives_up_on(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=rf"route\.toml {message}"):
        read(tmp_path, text)


def test_not_utf8(tmp_path: Path) -> None:
    (tmp_path / "route.toml").write_bytes(b"# caf\xe9\n")
    with pytest.raises(ConfigError, match=r"route\.toml is not valid TOML"):
        read_route_toml(tmp_path)


def test_a_directory_of_that_name(tmp_path: Path) -> None:
    (tmp_path / "route.toml").mkdir()
    with pytest.raises(ConfigError, match=r"cannot read .*route\.toml"):
        read_route_toml(tmp_path)


PIECES = [
    "aligned", "tolerance", "radius", "truth", "ignore", "protocol", "traverses", "condition", "pattern", "poses", "=",
    " ", "\n", "[", "]", ".", ",", "{", "}", '"', "'", '"""', "#", "true", "1", "-1", "1e9", "nan", "\\",
]  # fmt: skip
tables = st.lists(st.sampled_from(PIECES), max_size=14).map(lambda parts: "".join(parts).encode())


@fuzzed(80)
@given(st.binary(max_size=40) | tables)
def test_any_bytes_are_settings_or_one_error(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "route.toml").write_bytes(content)
    try:
        read_route_toml(tmp_path)
    except ConfigError as error:
        assert "route.toml" in str(error)
        assert len(str(error).splitlines()) == 1
