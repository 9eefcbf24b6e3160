"""Names that look equal and are not, wherever stems or names are looked up."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from everplace.cli import main
from everplace.errors import EverplaceError, RouteError
from everplace.importing.import_route import import_route
from everplace.importing.positions.hand_pairs import read_pairs
from everplace.route.csv_table import read_poses
from everplace.route.route import open_route
from everplace.route.spelling import spelling_hint
from everplace.route.truth import truth_by_position
from everplace.training.config import FitConfig
from everplace.training.select_route import select_route

FORM = "look equal, but one of them is written with accents as characters of their own"
CAPITALS = "differ only in capitals or Unicode form"


def nfd(text: str) -> str:
    return unicodedata.normalize("NFD", text)


def write_route(root: Path, drives: dict[str, Sequence[str]]) -> Path:
    rng = np.random.default_rng(5)
    for drive, stems in drives.items():
        (root / drive).mkdir(parents=True)
        for stem in stems:
            Image.fromarray(rng.integers(0, 256, (16, 32, 3), dtype=np.uint8)).save(root / drive / f"{stem}.png")
    return root


@pytest.mark.parametrize(
    ("name", "other", "told"),
    [
        ("café1", nfd("café1"), FORM),
        (nfd("Bär_07"), "Bär_07", FORM),
        ("과천-3", nfd("과천-3"), FORM),
        ("Å1", "\u212b1", FORM),  # the sign of the ångström is å in both forms
        ("IMG_1", "img_1", CAPITALS),
        ("Straße", "STRASSE", CAPITALS),
        ("CAFÉ1", nfd("café1"), CAPITALS),
        ("café1", "cafe1", ""),
        ("1", "01", ""),
        ("\uff11", "1", ""),
        ("é", "é", ""),
    ],
)
def test_names_that_look_alike(name: str, other: str, told: str) -> None:
    hint = spelling_hint(["x", name], ["y", other])
    assert told in hint
    assert bool(hint) == bool(told)
    assert not hint or hint.startswith("; ")


@pytest.mark.parametrize(
    ("stems", "told"),
    [(["é1", "é2"], FORM), (["IMG_1", "IMG_2"], CAPITALS), (["ÄRA1", "ÄRA2"], CAPITALS)],
)
def test_traverses_that_share_no_stem(tmp_path: Path, stems: list[str], told: str) -> None:
    others = [nfd(stem.lower()) for stem in stems]
    route = open_route(write_route(tmp_path / "route", {"day": stems, "night": others}))
    assert told in route.why_not_aligned
    with pytest.raises(RouteError, match=f"share no stem, so nobody .* {told}"):
        truth_by_position(route["day"], route["night"], 1)
    with pytest.raises(RouteError, match=rf"share no stem \(.*{told}.*\), and cp-vae learns"):
        select_route(route, FitConfig(model="cp-vae"))


def test_some_places_that_are_missing_look_alike(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = write_route(tmp_path / "route", {"day": ["a", "é"], "night": ["a", nfd("é")]})
    assert main.run(["data", "inspect", str(root)]) == 0
    day, night = capsys.readouterr().err.splitlines()
    assert day.startswith("everplace: day lacks places that it may have: ")
    assert night.startswith("everplace: night lacks places that it may have: ")
    assert FORM in day
    assert FORM in night


@pytest.mark.parametrize(("stem", "told"), [("é", FORM), ("IMG_1", CAPITALS)])
def test_stems_in_tables(tmp_path: Path, stem: str, told: str) -> None:
    other = nfd(stem.lower())
    table = tmp_path / "poses.csv"
    table.write_text(f"stem,x,y,heading\n{other},0,0,0\n", encoding="utf-8")
    with pytest.raises(RouteError, match=f"has no pose for 1 of 1 frames.*{told}"):
        read_poses(table, [stem])
    table.write_text(f"day,night\n{other},a\n", encoding="utf-8")
    with pytest.raises(RouteError, match=f"which 'day' does not have; correct the stem.*{told}"):
        read_pairs(table, "day", {"day": [stem], "night": ["a"]})
    root = write_route(tmp_path / "route", {"day": [stem], "night": ["a"]})
    (root / "route.toml").write_text('truth = "truth.csv"\n')
    header = "query_traverse,query,database_traverse,database\n"
    (root / "truth.csv").write_text(f"{header}day,{other},night,a\n", encoding="utf-8")
    truth = open_route(root).truth
    assert truth is not None
    with pytest.raises(RouteError, match=f"the traverse 'day' does not have; .*{told}"):
        list(truth.pairs())


@pytest.mark.parametrize(("drive", "told"), [("été", FORM), ("Winter", CAPITALS)])
def test_names_of_drives(tmp_path: Path, drive: str, told: str) -> None:
    other = nfd(drive.lower())
    root = write_route(tmp_path / "route", {drive: ["1"], "b": ["2"]})
    with pytest.raises(RouteError, match=f"has no traverse or condition .*; there are: .*{told}"):
        open_route(root)[other]
    table = tmp_path / "pairs.csv"
    table.write_text(f"{other},b\n1,2\n", encoding="utf-8")
    with pytest.raises(RouteError, match=f"has no column for .*{told}"):
        read_pairs(table, drive, {drive: ["1"], "b": ["2"]})


@pytest.mark.parametrize(("name", "told"), [("é.png", FORM), ("Q.png", CAPITALS)])
def test_images_that_a_list_names(tmp_path: Path, name: str, told: str) -> None:
    root = write_route(tmp_path / "set", {"queries": [nfd(name[:-4].lower())], "db": ["1"]})
    (root / "pairs.txt").write_text(f"queries/{name} db/1.png\n", encoding="utf-8")
    with pytest.raises(EverplaceError, match=f"does not exist, but .*pairs.txt.* names it; .*{told}"):
        import_route("hloc", root, tmp_path / "out")
