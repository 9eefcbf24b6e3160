"""`everplace data import` and `data list` as a person meets them."""

from __future__ import annotations

import contextlib
import io
import json
import tarfile
from pathlib import Path

import pytest

from everplace.cli import main
from everplace.data.kinds import source_kinds
from everplace.data.route import open_route


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


def test_the_list_says_what_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("everplace.data.sources.nordland.EXTRAS", {"no_such_package": "parquet"})
    assert "    part of it needs pip install 'everplace[parquet]'" in call("data", "list")[1]
    listed = json.loads(call("data", "list", "--json")[1])
    assert listed["nordland"]["missing"] == ["pip install 'everplace[parquet]'"]


def test_inspect_names_the_protocol(tiny_route: Path) -> None:
    (tiny_route / "route.toml").write_text('protocol = "olid"\n')
    assert json.loads(call("data", "inspect", tiny_route, "--json")[1])["protocol"] == "olid"
