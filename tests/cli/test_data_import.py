"""`everplace data import` and `data list` as a person meets them."""

from __future__ import annotations

import contextlib
import io
import json
import tarfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from sklearn.metrics import average_precision_score

from everplace.cli import main
from everplace.describe.registry import open_describer
from everplace.importing.catalogue import DATA_SETS
from everplace.importing.kinds import source_kinds
from everplace.importing.sources import _nordland_presets
from everplace.match.similarity import similarity
from everplace.route.route import open_route
from everplace.route.selection import Selection
from everplace.scoring.retrieval import MatchRule, choose_pair, true_matches


def call(*arguments: str | Path) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main.run([str(argument) for argument in arguments])
    return status, out.getvalue(), err.getvalue()


def test_a_tar_becomes_a_route_with_a_summary(tiny_route: Path, tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "n.tgz", "w:gz") as archive:
        archive.add(tiny_route, "nordland")
    status, out, err = call("data", "import", "nordland", tmp_path / "n.tgz", "--out", tmp_path / "r", "--json")
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert result["traverses"] == {"summer": 12, "winter": 12}
    assert (result["frames"], result["linked"]) == (24, 0)
    assert "non-commercial" in result["notes"][-1]
    route = open_route(tmp_path / "r")
    for traverse, original in zip(route.traverses, open_route(tiny_route).traverses, strict=True):
        assert [path.read_bytes() for path in traverse.paths] == [path.read_bytes() for path in original.paths]


def test_options_and_notes_for_people(tiny_route: Path, tmp_path: Path) -> None:
    (tmp_path / "kept.txt").write_text("3.png\n5.png\n")
    status, out, err = call(
        "data", "import", "nordland", tiny_route, "--out", tmp_path / "r",
        "--set", f"list={tmp_path / 'kept.txt'}", "--set", "seasons=winter", "--copy",
    )  # fmt: skip
    assert status == 0
    assert "frames            2\n" in out
    assert err.startswith("everplace: Nordland was filmed by")
    assert open_route(tmp_path / "r")["winter"].stems == ("3", "5")
    assert not any(path.is_symlink() for path in open_route(tmp_path / "r")["winter"].paths)


@pytest.mark.slow
def test_a_preset_with_fewer_queries_than_map_frames_is_evaluated_against_the_whole_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the protocol of 2,760 queries and 27,592 map frames says, on a journey of 25."""
    monkeypatch.setattr(_nordland_presets, "_FULL", 25)
    rng = np.random.default_rng(3)
    names = [f"images-{number:05d}.png" for number in range(3, 30) if number not in (7, 8)]  # tunnels
    for number in range(31):
        coarse = rng.integers(40, 216, (4, 8), dtype=np.uint8)
        place = Image.fromarray(coarse).resize((64, 32), Image.Resampling.BICUBIC)
        for season, brightness in (("summer", 0), ("winter", 30)):
            path = tmp_path / "n" / season / f"images-{number:05d}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            place.point(lambda value, more=brightness: value + more).save(path)
    (tmp_path / "n" / "cleanImageNames.txt").write_text("\n".join(names))
    status, _, err = call("data", "import", "nordland", tmp_path / "n", "--out", tmp_path / "r", "--set", "preset=2760")
    assert status == 0, err
    status, out, err = call(
        "evaluate", tmp_path / "r", "--method", "hog", "--query", "summer", "--database", "winter", "--out",
        tmp_path / "e", "--json",
    )  # fmt: skip
    assert status == 0, err
    metrics = json.loads(out)
    assert (metrics["queries"], metrics["database"], metrics["tolerance"]) == (3, 25, 1)
    assert metrics["protocol"] == "Nordland 2,760 summer queries against 27,592 winter frames, ±1"
    # Queries are the map's frames 0, 10 and 20: 2 + 3 + 3 true matches, and each is brightness apart from its own.
    assert metrics["queries_with_match"] == 3
    assert metrics["recall_at"]["1"] == 1.0
    route = open_route(tmp_path / "r")
    pair = choose_pair(route, "summer", "winter", Selection())
    truth, _ = true_matches(pair, MatchRule())
    assert [np.flatnonzero(row).tolist() for row in truth] == [[0, 1], [9, 10, 11], [19, 20, 21]]
    assert [pair.database.stems[index] for index in (0, 10, 20)] == list(pair.query.stems)
    # Of the 75 pairs 8 are true; the same scores by scikit-learn's definition of average precision.
    describer = open_describer("hog")
    S = similarity(*(describer.describe(one) for one in (pair.query, pair.database)))
    assert S.shape == (3, 25)
    assert metrics["average_precision"] == pytest.approx(average_precision_score(truth.ravel(), S.ravel()))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nordlnd", "."], "no kind of source 'nordlnd'; choose one of"),
        (["nordland", "gone"], "the source gone does not exist"),
        (["nordland", ".", "--set", "size"], "--set 'size' is not NAME=VALUE"),
        (["nordland", ".", "--set", "size=1x1", "--set", "size=2x2"], "--set size is given twice"),
        (["nordland", ".", "--set", "colour=red"], "has no option 'colour'; it knows form, seasons, preset"),
        (["nordland", ".", "--set", "preset=x"], "--set preset=x cannot be"),
        (["nordland", "."], "holds no image"),
    ],
)
def test_mistakes_give_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = call("data", "import", *arguments, "--out", "r")
    assert (status, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert message in err
    assert list(tmp_path.iterdir()) == []


def test_a_target_that_is_there_is_refused(tiny_route: Path) -> None:
    status, _, err = call("data", "import", "nordland", tiny_route, "--out", tiny_route)
    assert status == 2
    assert "already exists and is not empty" in err


def test_the_list_names_every_kind_with_its_options() -> None:
    status, out, _ = call("data", "list")
    assert status == 0
    listed = json.loads(call("data", "list", "--json")[1])
    assert list(listed) == list(source_kinds())
    assert set(listed["nordland"]["options"]) >= {"form", "preset", "list", "size"}
    for kind, told in listed.items():
        assert f"{kind}: {told['summary']}\n" in out
        for option in told["options"]:
            assert f"    --set {option}=..." in out
    found = {name: about for told in listed.values() for name, about in told["data_sets"].items()}
    assert set(found) == {data_set.name for data_set in DATA_SETS}
    for data_set in DATA_SETS:
        assert data_set.name in listed[data_set.kind]["data_sets"]
        assert (f"    everplace data fetch {data_set.name}  " in out) == (not data_set.unavailable)
        assert (f"    {data_set.name} cannot be fetched: " in out) == bool(data_set.unavailable)


def test_the_list_says_what_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("everplace.importing.sources.nordland.EXTRAS", {"no_such_package": "parquet"})
    assert "    part of it needs pip install 'everplace[parquet]'" in call("data", "list")[1]
    listed = json.loads(call("data", "list", "--json")[1])
    assert listed["nordland"]["missing"] == ["pip install 'everplace[parquet]'"]


def test_inspect_names_the_protocol(tiny_route: Path) -> None:
    (tiny_route / "route.toml").write_text('protocol = "olid"\n')
    assert json.loads(call("data", "inspect", tiny_route, "--json")[1])["protocol"] == "olid"
