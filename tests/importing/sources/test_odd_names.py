"""Names with line breaks, in every kind: whatever goes wrong is said on one line, and so is every note."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest
from PIL import Image

from everplace.errors import EverplaceError, RouteError
from everplace.files import readable
from everplace.importing.import_route import import_route
from everplace.importing.kinds import source_kinds
from everplace.route.route import open_route

ODD = "odd\nname\r\u2028\x1b[2J"

LAYOUTS = [
    "{odd}.png", "{odd}/{odd}.png", "{odd}/summer/{odd}.png", "winter/{odd}.png", "{odd}.txt", "{odd}.csv", "{odd}.mkv",
    "{odd}.bag", "{odd}.mcap", "{odd}.parquet", "{odd}.tar", "{odd}.zip", "day_left/{odd}.jpg", "query/{odd}.jpg",
    "ref/{odd}.jpg", "reference/{odd}.png", "images/test/database/@1@2@{odd}@.jpg", "images/test/queries/{odd}.jpg",
    "images/set00/V000/{odd}.png", "videos/set00/Visible_V000.seq", "sync_data/{odd}/rgb/img_left/{odd}.png",
    "{odd}/rgb.txt", "rgb.txt", "sequences/{odd}/image_0/{odd}.png", "{odd}/mav0/cam0/data.csv", "mav0/cam0/{odd}.png",
    "sensors/records_camera.txt", "pairs.txt", "ground_truth.csv", "poses.csv", "times.csv",
]  # fmt: skip


@pytest.mark.parametrize("kind", source_kinds())
def test_a_message_is_one_line_whatever_the_files_are_called(tmp_path: Path, kind: str) -> None:
    module: ModuleType = source_kinds()[kind]  # type: ignore[assignment]
    refused = 0
    for number, layout in enumerate(LAYOUTS):
        root = tmp_path / f"{ODD}{number}"
        path = root / layout.format(odd=ODD)
        path.parent.mkdir(parents=True)
        path.write_text(f"x,y\n{ODD} {ODD},1\n")
        for source in (root, path):
            try:
                route = module.read(source, module.Options())
                for traverse in route.traverses:
                    list(traverse.frames)
                said = list(route.notes)
            except EverplaceError as error:
                said = [str(error)]
                refused += 1
            assert all(note.isprintable() for note in said)
    assert refused


def test_names_are_escaped_and_others_stay() -> None:
    assert readable("a\nb\x1b") == "a\\nb\\x1b"
    assert readable(Path("Fähre/季節 1.png")) == "Fähre/季節 1.png"
    assert readable("caf\udce9") == "caf\\xe9"
    assert readable("a\u2029b") == "a\\u2029b"


def test_a_route_with_odd_names_says_what_is_wrong_on_one_line(tmp_path: Path) -> None:
    for name in (f"{ODD}1", f"{ODD}2"):
        (tmp_path / name).mkdir()
        Image.new("L", (8, 8)).save(tmp_path / name / f"{ODD}.png")
    route = open_route(tmp_path)
    (tmp_path / f"{ODD}1" / f"{ODD}.jpg").write_bytes(b"")
    for call in (lambda: route["autumn"], lambda: open_route(tmp_path)):
        with pytest.raises(RouteError) as caught:
            call()
        assert str(caught.value).isprintable()
        assert "odd\\nname" in str(caught.value)
    with pytest.raises(RouteError, match="a path separator or a control character"):
        import_route("images", tmp_path / f"{ODD}2", tmp_path / "out", {"stems": "own"})
