"""`everplace describe` and `everplace match` as hloc and kapture use them: image names that fit together."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import h5py
import pytest

from everplace.cli import main
from everplace.describe.files.descriptors import load_descriptors


def call(*arguments: str | Path) -> None:
    assert main.run([str(argument) for argument in arguments]) == 0


@pytest.fixture
def described(tiny_route: Path, tmp_path: Path) -> dict[tuple[str, str], Path]:
    """Files by traverse and layout."""
    (tiny_route / "winter" / "3.png").rename(tiny_route / "winter" / "3.PNG")
    files = {(name, layout): tmp_path / f"{name}-{layout}.h5" for name in ("summer", "winter") for layout in LAYOUTS}
    for (name, layout), file in files.items():
        call("describe", "hog", tiny_route / name, "--out", file, "--format", layout)
    return files


LAYOUTS = ("everplace", "hloc")


def test_a_file_holds_the_stems_and_the_names_of_the_images(described: dict[tuple[str, str], Path]) -> None:
    for layout in LAYOUTS:
        winter = load_descriptors(described["winter", layout])
        assert winter.names == tuple(map(str, range(12)))
        assert winter.image_names == tuple(f"{place}.{'PNG' if place == 3 else 'png'}" for place in range(12))


@pytest.mark.parametrize("query", LAYOUTS)
@pytest.mark.parametrize("database", LAYOUTS)
def test_matches_are_the_same_from_either_layout(
    described: dict[tuple[str, str], Path], tmp_path: Path, database: str, query: str
) -> None:
    options = ["--top", "2", "--sequence", "3"]  # a sequence needs the frames in their order
    for names in ((database, query), ("everplace", "everplace")):
        files = described["summer", names[0]], described["winter", names[1]]
        call("match", *files, *options, "--out", tmp_path / f"{'-'.join(names)}.csv")
    assert (tmp_path / f"{database}-{query}.csv").read_text() == (tmp_path / "everplace-everplace.csv").read_text()


@pytest.mark.parametrize("layout", LAYOUTS)
def test_pairs_name_what_hloc_finds_in_the_files_of_features(
    described: dict[tuple[str, str], Path], tmp_path: Path, layout: str, capsys: pytest.CaptureFixture[str]
) -> None:
    files = described["summer", layout], described["winter", layout]
    call("match", *files, "--top", "2", "--out", tmp_path / "csv")
    assert capsys.readouterr().err == ""
    for kind in ("hloc-pairs", "kapture"):
        call("match", *files, "--format", kind, "--top", "2", "--out", tmp_path / kind)
        assert f"call images alike, so {kind} cannot tell them apart; describe both with one --image-root" in (
            capsys.readouterr().err
        )
    rows = list(csv.DictReader((tmp_path / "csv").read_text().splitlines()))
    assert {row["query"] for row in rows} == set(map(str, range(12)))
    pairs = [line.split() for line in (tmp_path / "hloc-pairs").read_text().splitlines()]
    assert [tuple(name.rpartition(".")[0] for name in pair) for pair in pairs] == [
        (row["query"], row["database"]) for row in rows
    ]
    with (
        h5py.File(described["winter", "hloc"]) as queries,
        h5py.File(described["summer", "hloc"]) as database,
    ):
        for query, found in pairs:
            assert "global_descriptor" in queries[query]
            assert "global_descriptor" in database[found]
    kapture = [line.split(", ") for line in (tmp_path / "kapture").read_text().splitlines()[2:]]
    assert [line[:2] for line in kapture] == pairs


@pytest.mark.parametrize("layout", LAYOUTS)
def test_images_are_named_from_the_root(
    tiny_route: Path, tmp_path: Path, layout: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tiny_route)
    files = [tmp_path / f"{name}.h5" for name in ("summer", "winter")]
    for file in files:
        call("describe", "hog", file.stem, "--image-root", ".", "--format", layout, "--out", file)
    # hloc's layout has no names but those of the images, and everplace's keeps the stems of the directory.
    expected = {"everplace": tuple(map(str, range(12))), "hloc": tuple(f"winter-{place}" for place in range(12))}
    winter = load_descriptors(files[1])
    assert winter.image_names == tuple(f"winter/{place}.png" for place in range(12))
    assert winter.names == expected[layout]
    call("match", *files, "--format", "hloc-pairs", "--out", tmp_path / "pairs.txt")
    assert capsys.readouterr().err == ""
    pairs = [line.split() for line in (tmp_path / "pairs.txt").read_text().splitlines()]
    assert [query for query, _ in pairs] == list(winter.image_names)
    assert all((tiny_route / found).is_file() and found.startswith("summer/") for _, found in pairs)


def test_an_image_root_that_is_not_above_the_images_is_refused(tiny_route: Path, tmp_path: Path) -> None:
    winter, out = tiny_route / "winter", tmp_path / "w.h5"
    options = ["describe", "hog", str(winter), "--out", str(out), "--image-root"]
    assert main.run([*options, str(tiny_route / "summer")]) == 2
    assert not out.exists()
    assert main.run([*options, str(winter)]) == 0
    assert load_descriptors(out).image_names == tuple(f"{place}.png" for place in range(12))


@pytest.mark.parametrize(
    ("images", "root", "prefix"),
    [
        ("route/linked", "route", "linked/"),  # the drive is a link out of its route
        ("route/linked", "route/linked", ""),
        ("route/linked", "elsewhere", "drive/"),  # where the link leads
        ("alias/linked", "route", "linked/"),  # the route by another name
        ("route/linked", "alias", "linked/"),
        ("route/summer/../linked", "route", "linked/"),
        ("alias/winter", "alias", "winter/"),
        ("inner/drive", ".", "inner/drive/"),
    ],
)
def test_links_are_followed_only_where_the_path_as_given_is_not_below_the_root(
    tiny_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, images: str, root: str, prefix: str
) -> None:
    place = tmp_path / "place"
    place.mkdir()
    tiny_route.rename(place / "route")
    (place / "elsewhere").mkdir()
    shutil.copytree(place / "route/winter", place / "elsewhere/drive")
    (place / "route/linked").symlink_to(place / "elsewhere/drive")
    (place / "alias").symlink_to("route")
    (place / "inner").symlink_to("elsewhere")
    monkeypatch.chdir(place)
    call("describe", "hog", images, "--image-root", root, "--out", tmp_path / "w.h5")
    assert load_descriptors(tmp_path / "w.h5").image_names == tuple(f"{prefix}{number}.png" for number in range(12))


def test_a_file_without_image_names_gives_its_names_and_that_is_said(
    described: dict[tuple[str, str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    older = described["winter", "everplace"]
    with h5py.File(older, "r+") as file:
        del file["image_names"]
    summer = described["summer", "everplace"]
    call("match", summer, older, "--out", tmp_path / "m.csv")
    assert capsys.readouterr().err == ""
    call("match", summer, older, "--format", "hloc-pairs", "--out", tmp_path / "pairs.txt")
    (said,) = capsys.readouterr().err.strip().splitlines()
    assert "winter-everplace.h5 does not hold the names of its image files, so its `names` are written" in said
    pairs = [line.split() for line in (tmp_path / "pairs.txt").read_text().splitlines()]
    assert [query for query, _ in pairs] == list(map(str, range(12)))
    assert all(found.endswith(".png") for _, found in pairs)


def test_a_directory_under_the_root_keeps_its_dot(tiny_route: Path, tmp_path: Path) -> None:
    hidden = (tiny_route / "winter").rename(tiny_route / ".winter")
    call("describe", "hog", hidden, "--image-root", tiny_route, "--out", tmp_path / "w.h5")
    names = load_descriptors(tmp_path / "w.h5").image_names
    assert names is not None
    assert names[0] == ".winter/0.png"


def test_a_dash_puts_the_table_on_standard_output_alone(
    described: dict[tuple[str, str], Path], tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    files = [str(described[season, "everplace"]) for season in ("summer", "winter")]
    assert main.run(["match", *files, "--out", str(tmp_path / "m.csv")]) == 0
    capfdbinary.readouterr()
    assert main.run(["match", *files, "--out", "-"]) == 0
    assert capfdbinary.readouterr().out == (tmp_path / "m.csv").read_bytes()
    assert main.run(["match", *files, "--out", "-", "--json"]) == 2
    assert b"--out - and --json exclude each other" in capfdbinary.readouterr().err


@pytest.mark.parametrize("command", ["describe", "evaluate", "train"])
def test_a_dash_is_refused_where_the_result_is_no_text(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    given = {
        "describe": ["hog", "nowhere"],
        "evaluate": ["nowhere", "--method", "hog", "--database", "a", "--query", "b"],
        "train": ["nowhere", "--model", "vae"],
    }
    assert main.run([command, *given[command], "--out", "-"]) == 2
    assert "--out - is standard output, which takes text alone" in capsys.readouterr().err


def test_match_can_say_no(described: dict[tuple[str, str], Path], tmp_path: Path) -> None:
    summer, winter = described["summer", "everplace"], described["winter", "everplace"]
    rows: dict[str, list[dict[str, str]]] = {}
    for name, options in {"all": [], "sure": ["--min-probability", "0.9"], "never": ["--min-probability", "1"]}.items():
        call("match", summer, winter, "--sequence", "6", *options, "--out", tmp_path / name)
        rows[name] = list(csv.DictReader((tmp_path / name).read_text().splitlines()))
    assert {row["score_kind"] for row in rows["all"]} == {"log-odds"}
    assert rows["sure"] == [row for row in rows["all"] if float(row["score"]) >= 2.1972246]
    assert len(rows["never"]) < len(rows["sure"]) or not rows["sure"]
    call("match", summer, summer, "--exclude", "3", "--out", tmp_path / "loops")
    loops = list(csv.DictReader((tmp_path / "loops").read_text().splitlines()))
    assert len(loops) == 12
    assert all(abs(int(row["query"]) - int(row["database"])) >= 3 for row in loops)
    assert main.run(["match", str(summer), str(winter), "--min-probability", "0.5", "--out", str(tmp_path / "x")]) == 2
    assert main.run(["match", str(summer), str(winter), "--exclude", "0", "--out", str(tmp_path / "x")]) == 2
    assert not (tmp_path / "x").exists()
