from __future__ import annotations

import csv
import math
import os
import signal
import subprocess
import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from everplace.errors import ConfigError, ImageError, RouteError, StorageError
from everplace.images.decoding import ImageSpec, decode_image
from everplace.importing import import_route as importing
from everplace.importing import route_writer
from everplace.importing.foreign_route import (
    Content,
    Encoded,
    ForeignFrame,
    ForeignRoute,
    ForeignTraverse,
    SourceOptions,
)
from everplace.importing.import_route import ImportSummary, import_route
from everplace.route.route import open_route
from everplace.route.traverse import Pose
from everplace.route.truth import TruthPair

GREY = np.arange(48, dtype=np.uint8).reshape(6, 8, 1)
COLOUR = np.stack([GREY[..., 0], GREY[..., 0] * 2, GREY[..., 0] * 3], axis=2)

Run = Callable[..., ImportSummary]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "source"
    path.mkdir()
    for number in range(3):
        Image.fromarray(COLOUR + number).save(path / f"{number}.png")
    return path


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, source: Path, tmp_path: Path) -> Run:
    """Imports traverses given as frames by name, or a whole foreign route."""

    def run(given: ForeignRoute | dict[str, list[ForeignFrame]], **options: Any) -> ImportSummary:
        if isinstance(given, dict):
            given = ForeignRoute(ForeignTraverse(name, iter(frames)) for name, frames in given.items())
        kind = types.SimpleNamespace(Options=SourceOptions, read=lambda path, options: given)
        monkeypatch.setattr(importing, "open_kind", lambda name: kind)
        return import_route("test", source, tmp_path / "out", **options)

    return run


def left_behind(tmp_path: Path) -> list[str]:
    return sorted(path.name for path in tmp_path.iterdir() if path.name != "source")


def test_files_become_links_and_the_rest_is_written(run: Run, source: Path, tmp_path: Path) -> None:
    jpeg = Encoded((source / "0.png").read_bytes(), ".PNG")
    summary = run({"winter": [ForeignFrame("a", source / "1.png"), ForeignFrame("b", jpeg), ForeignFrame("c", COLOUR)],
                   "summer": [ForeignFrame("c", GREY)]})  # fmt: skip
    route = open_route(tmp_path / "out")
    assert route["winter"].stems == ("a", "b", "c")
    assert (tmp_path / "out/winter/a.png").readlink() == source.absolute() / "1.png"
    assert (tmp_path / "out/winter/b.PNG").read_bytes() == jpeg.data
    np.testing.assert_array_equal(decode_image(tmp_path / "out/winter/c.png", ImageSpec()), COLOUR)
    np.testing.assert_array_equal(decode_image(tmp_path / "out/summer/c.png", ImageSpec(grey=True)), GREY)
    assert summary.traverses == {"winter": 3, "summer": 1}
    assert (summary.frames, summary.linked) == (4, 1)
    assert left_behind(tmp_path) == ["out"]


def test_links_lead_to_the_source_when_it_is_given_relatively(
    run: Run, source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run({"a": [ForeignFrame("1", Path("source/1.png"))]})
    monkeypatch.chdir("/")
    assert (tmp_path / "out/a/1.png").read_bytes() == (source / "1.png").read_bytes()


def test_copies_when_asked(run: Run, source: Path, tmp_path: Path) -> None:
    assert run({"a": [ForeignFrame("1", source / "1.png")]}, copy=True).linked == 0
    assert not (tmp_path / "out/a/1.png").is_symlink()
    assert (tmp_path / "out/a/1.png").read_bytes() == (source / "1.png").read_bytes()


def test_copies_from_another_disk_and_where_links_are_impossible(
    run: Run, source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(route_writer, "_device", lambda file: -1)
        summary = run({"a": [ForeignFrame("1", source / "1.png")]})
    assert summary.linked == 0
    assert summary.notes == ("Images were copied: the source lies on another disk than the route.",)

    def no_links(self: Path, target: Path) -> None:
        raise PermissionError(1, "no links here")

    (tmp_path / "out").rename(tmp_path / "first")
    monkeypatch.setattr(Path, "symlink_to", no_links)
    summary = run({"a": [ForeignFrame("1", source / "1.png"), ForeignFrame("2", source / "2.png")]})
    assert (summary.linked, summary.frames) == (0, 2)
    assert "links are not possible" in summary.notes[0]
    assert (tmp_path / "out/a/2.png").read_bytes() == (source / "2.png").read_bytes()


def test_poses_and_times_survive_exactly(run: Run, tmp_path: Path) -> None:
    poses = [Pose(0.1 + 0.2, -1e-17, math.pi), Pose(6e5 + 1 / 3, 4.2e6, -0.0)]
    run({"a": [ForeignFrame(stem, GREY, pose, number / 7) for number, (stem, pose) in enumerate(
        zip(['x,"1', "y"], poses, strict=True))], "b": [ForeignFrame("y", GREY)]})  # fmt: skip
    traverse = open_route(tmp_path / "out")["a"]
    assert [frame.pose for frame in traverse] == poses
    assert open_route(tmp_path / "out")["b"].poses is None
    with (tmp_path / "out/a/times.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows == [["stem", "seconds"], ['x,"1', "0.0"], ["y", repr(1 / 7)]]
    assert not (tmp_path / "out/b/times.csv").exists()


def test_tables_are_in_natural_order_however_the_frames_come(run: Run, tmp_path: Path) -> None:
    stems = ["10", "9", "1,5", "2"]
    run({"a": [ForeignFrame(stem, GREY, Pose(number, 0, 0), number) for number, stem in enumerate(stems)]})
    assert (tmp_path / "out/a/times.csv").read_text().splitlines() == [
        "stem,seconds", '"1,5",2.0', "2,3.0", "9,1.0", "10,0.0",
    ]  # fmt: skip
    poses = open_route(tmp_path / "out")["a"].poses
    assert poses is not None
    assert poses[:, 0].tolist() == [2, 3, 1, 0]


def test_route_toml_says_what_directories_cannot(run: Run, tmp_path: Path) -> None:
    drives = [ForeignTraverse(name, iter([ForeignFrame("1", GREY)]), condition)
              for name, condition in [("jan 14", "winter"), ("summer", "summer")]]  # fmt: skip
    notes = ("First\nnote.", "Second.")
    summary = run(ForeignRoute(iter(drives), radius=25, notes=notes, protocol="p"))
    route = open_route(tmp_path / "out")
    assert [(traverse.name, traverse.condition) for traverse in route.traverses] == [
        ("jan 14", "winter"),
        ("summer", "summer"),
    ]
    assert (route.radius, route.tolerance, route.protocol) == (25.0, None, "p")
    assert (summary.radius, summary.protocol, summary.notes) == (25, "p", notes)
    assert (route.truth_origin, route.aligned_by) == (None, None)
    text = (tmp_path / "out/route.toml").read_text()
    assert "# First note.\n# Second.\n" in text
    assert "summer" not in text


def test_route_toml_says_where_the_truth_came_from(run: Run, tmp_path: Path) -> None:
    drives = (ForeignTraverse(name, iter([ForeignFrame("1", GREY)])) for name in "ab")
    run(ForeignRoute(drives, truth_from='the pairs of "a.csv"', aligned_by="hog16+efficientnet"))
    route = open_route(tmp_path / "out")
    assert (route.truth_origin, route.aligned_by) == ('the pairs of "a.csv"', "hog16+efficientnet")


@pytest.mark.parametrize(
    ("traverses", "message"),
    [
        ([("a", ["1"]), ("b", ["1"]), ("a", ["2"])], "two traverses of the name 'a'"),
        ([("a", ["1", "2", "1"])], "the frame '1' of the traverse 'a' twice"),
        ([("a", [])], "the traverse 'a' of .* has no frame"),
        ([], "holds no traverse"),
        ([("a/b", ["1"])], "a traverse the name 'a/b', which holds a path separator"),
        ([("..", ["1"])], r"a traverse the name '\.\.', which is empty or hidden"),
        ([("a", ["../1"])], "a frame the name '../1', which is empty or hidden"),
        ([("a", ["x/../1"])], "a frame the name 'x/../1', which holds a path separator"),
        ([("a", ["x\\1"])], "path separator"),
        ([("a", [""])], "a frame the name '', which is empty or hidden"),
        ([("a", [".1"])], "hidden"),
        ([("a", ["1\n2"])], r"the name '1\\n2', which holds .* a control character"),
        ([("a", ["1\0"])], "control character"),
        ([("a", ["\udce9"])], r"the name '\\udce9', which is not UTF-8"),
        ([("a", ["é" * 126])], "longer than 255 bytes"),
    ],
)
def test_names_that_cannot_be_are_refused(
    run: Run, tmp_path: Path, traverses: list[tuple[str, list[str]]], message: str
) -> None:
    drives = (ForeignTraverse(name, (ForeignFrame(stem, GREY) for stem in stems)) for name, stems in traverses)
    with pytest.raises(RouteError, match=message) as caught:
        run(ForeignRoute(drives))
    assert "\n" not in str(caught.value)
    assert str(caught.value).isascii()
    assert left_behind(tmp_path) == []


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        ({"pose": Pose(0, 0, 0)}, {}, "the frame '2' of the traverse 'a' of .* has no pose, unlike those before it"),
        ({}, {"pose": Pose(0, 0, 0)}, "the frame '2' .* has a pose, unlike those before it"),
        ({"seconds": 1.0}, {}, "the frame '2' .* has no time"),
        ({}, {"seconds": 1.0}, "the frame '2' .* has a time"),
        ({"pose": Pose(0, math.nan, 0)}, {}, "the pose of the frame '1' .* is not finite"),
        ({"seconds": math.inf}, {}, "the time of the frame '1' .* is not finite"),
    ],
)
def test_poses_and_times_are_for_all_frames_or_none(
    run: Run, tmp_path: Path, first: dict[str, Any], second: dict[str, Any], message: str
) -> None:
    with pytest.raises(RouteError, match=message):
        run({"a": [ForeignFrame("1", GREY, **first), ForeignFrame("2", GREY, **second)]})
    assert left_behind(tmp_path) == []


def test_files_that_are_no_images_or_not_there_are_refused(run: Run, source: Path, tmp_path: Path) -> None:
    os.mkfifo(source / "pipe.png")
    contents: list[tuple[Content, str]] = [
        (source / "gone.png", "cannot read .*gone.png: No such file"),
        (source / "pipe.png", "pipe.png is not a regular file"),
        (Encoded(b"x", ".txt"), "ends in '.txt', which is no image"),
        (source / "0", "ends in '', which is no image"),
    ]
    for content, message in contents:
        with pytest.raises(RouteError, match=message):
            run({"a": [ForeignFrame("1", content)]})
    with pytest.raises(ImageError, match=r"gone\.png"):
        run({"a": [ForeignFrame("1", source / "gone.png")]}, copy=True)
    assert left_behind(tmp_path) == []


def test_a_failing_source_is_not_taken_for_a_failing_target(run: Run, tmp_path: Path) -> None:
    def frames() -> Iterator[ForeignFrame]:
        yield ForeignFrame("1", GREY)
        raise OSError(5, "Input/output error", "/mnt/disk/x.bag")

    with pytest.raises(RouteError, match="cannot read /mnt/disk/x.bag: Input/output error"):
        run(ForeignRoute(iter([ForeignTraverse("a", frames())])))
    assert left_behind(tmp_path) == []


def test_sources_are_closed_when_the_route_cannot_be_written(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed = []

    def frames() -> Iterator[ForeignFrame]:
        try:
            while True:
                yield ForeignFrame("1", GREY)
        finally:
            closed.append(True)

    def full(self: Path, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(StorageError, match="No space left"):
        run(ForeignRoute(iter([ForeignTraverse("a", frames())])))
    assert closed == [True]
    assert left_behind(tmp_path) == []


def test_an_occupied_target_is_left_alone(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    run({"a": [ForeignFrame("1", GREY)]})  # empty: fine
    before = (out / "route.toml").read_bytes()
    with pytest.raises(ConfigError, match="already exists and is not empty"):
        run({"b": [ForeignFrame("1", GREY)]})
    assert (out / "route.toml").read_bytes() == before
    assert not (out / "b").exists()


def test_a_source_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(RouteError, match="the source .*gone does not exist"):
        import_route("nordland", tmp_path / "gone", tmp_path / "out")


def test_progress_counts_each_traverse(run: Run) -> None:
    seen: list[tuple[str, int | None]] = []

    def progress(items: Any, what: str, total: int | None = None) -> Iterator[Any]:
        seen.append((what, total))
        yield from items

    drives = [ForeignTraverse("a", iter([ForeignFrame("1", GREY)]), count=1),
              ForeignTraverse("b", iter([ForeignFrame("1", GREY)]))]  # fmt: skip
    run(ForeignRoute(iter(drives)), progress=progress)
    assert seen == [("importing a", 1), ("importing b", None)]


KILLED = """
import sys, time, types
from pathlib import Path
import numpy as np
from everplace.importing import import_route as importing
from everplace.importing import route_writer
from everplace.importing.foreign_route import ForeignFrame, ForeignRoute, ForeignTraverse, SourceOptions

def frames():
    yield ForeignFrame("1", np.zeros((4, 4, 1), np.uint8))
    print("written", flush=True)
    time.sleep(60)

route = ForeignRoute(iter([ForeignTraverse("a", frames())]))
importing.open_kind = lambda name: types.SimpleNamespace(Options=SourceOptions, read=lambda *_: route)
importing.import_route("test", Path(sys.argv[1]), Path(sys.argv[2]))
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_import_leaves_no_route(tmp_path: Path, how: signal.Signals) -> None:
    out = tmp_path / "out"
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(tmp_path), str(out)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"written\n"
        process.send_signal(how)
        process.wait(60)
    assert not out.exists()
    if how is signal.SIGINT:
        assert list(tmp_path.iterdir()) == []
    assert not [path for path in tmp_path.iterdir() if not path.name.startswith(".")]


@pytest.mark.parametrize(("traverse", "stem"), [("summer", "b"), ("spring", "a")])
def test_a_truth_about_frames_that_did_not_come_leaves_nothing(
    run: Run, tmp_path: Path, traverse: str, stem: str
) -> None:
    drives = (ForeignTraverse(name, iter([ForeignFrame("a", GREY)])) for name in ("summer", "winter"))
    pairs = [TruthPair("winter", "a", "summer", "a"), TruthPair("winter", "a", traverse, stem)]
    with pytest.raises(RouteError, match=f"names the frame '{stem}' of '{traverse}', which it does not have"):
        run(ForeignRoute(drives, truth=iter(pairs)))
    assert left_behind(tmp_path) == []
