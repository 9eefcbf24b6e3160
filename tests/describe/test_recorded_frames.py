"""Videos and bags are described as they are read, with the numbers that importing them first gives."""

from __future__ import annotations

import csv
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from tests.cli.test_main import call, refused
from tests.importing.sources.test_bag import COMPRESSED, IMAGE, encoded, write_bag
from tests.importing.sources.test_video import write_video

from everplace.describe.files.descriptors import load_descriptors
from everplace.describe.recorded_frames import RecordedFrames, is_recording
from everplace.describe.registry import open_describer
from everplace.importing.foreign_route import ForeignFrame, ForeignTraverse
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route

av = pytest.importorskip("av", reason="needs the extra video")

README = (Path(__file__).parents[2] / "README.md").read_text("utf-8")


def grey_bag(path: Path) -> Path:
    rng = np.random.default_rng(3)
    return write_bag(path, [("/camera", IMAGE, t, ("mono8", rng.integers(0, 256, (40, 50), np.uint8))) for t in (1, 2)])


def jpeg_bag(path: Path) -> Path:
    return write_bag(path, [("/camera", COMPRESSED, t, ("jpeg", encoded("jpeg"))) for t in (1, 2, 3)])


def video(path: Path) -> Path:
    write_video(path, 12)
    return path


@pytest.mark.parametrize("method", ["hog", "sad"])
@pytest.mark.parametrize(
    ("name", "write"),
    [("a.mkv", video), ("a.mp4", video), ("a.bag", grey_bag), ("a-mcap", grey_bag)],
)
def test_the_numbers_are_those_of_the_imported_frames(tmp_path: Path, name: str, write: Any, method: str) -> None:
    path = write(tmp_path / name)
    kind = "video" if write is video else "bag"
    assert call("data", "import", kind, path, "--out", tmp_path / "route")[0] == 0
    assert call("describe", method, tmp_path / "route" / path.stem, "--out", tmp_path / "imported.h5")[0] == 0
    status, _, err = call("describe", method, path, "--out", tmp_path / "direct.h5")
    assert (status, err) == (0, "")
    imported, direct = load_descriptors(tmp_path / "imported.h5"), load_descriptors(tmp_path / "direct.h5")
    assert direct.names == imported.names == tuple(f"{number:06d}" for number in range(len(direct)))
    np.testing.assert_array_equal(direct.values, imported.values)
    assert direct.settings == imported.settings
    assert direct.image_names is None


def test_frames_that_are_left_out_keep_the_numbers_of_the_others(tmp_path: Path) -> None:
    path = video(tmp_path / "a.mkv")
    assert call("describe", "sad", path, "--set", "every_seconds=0.5", "--out", tmp_path / "a.h5")[0] == 0
    assert load_descriptors(tmp_path / "a.h5").names == ("000000", "000005", "000010")


def test_what_is_a_recording(tmp_path: Path) -> None:
    (tmp_path / "day.MP4").mkdir()
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").touch()
    known = {"day.MP4": False, "bag": True, "x.MKV": True, "x.mcap": True, "x.png": False, "winter": False}
    assert {name: is_recording(tmp_path / name) for name in known} == known


@pytest.mark.parametrize(
    ("images", "options", "says"),
    [
        ("gone.mp4", [], "the recording {base}/gone.mp4 does not exist"),
        ("empty.mp4", [], "empty.mp4"),
        ("cut.mkv", [], "cut.mkv breaks off after"),
        ("a.mkv", ["--set", "speed=2"], "the kind 'video' has no option 'speed'"),
        ("a.mkv", ["--set", "every_frames=0"], "--set every_frames=0 cannot be"),
        ("a.mkv", ["--image-root", "{base}"], "--image-root names image files"),
        ("images", ["--set", "every_frames=2"], "--set is for videos and bags, and {base}/images holds images"),
    ],
)
def test_what_cannot_be_described_leaves_nothing(tmp_path: Path, images: str, options: list[str], says: str) -> None:
    content = video(tmp_path / "a.mkv").read_bytes()
    (tmp_path / "cut.mkv").write_bytes(content[: len(content) * 2 // 3])
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "images").mkdir()
    Image.new("RGB", (9, 9)).save(tmp_path / "images" / "0.png")
    given = [option.format(base=tmp_path) for option in options]
    said = refused("describe", "sad", tmp_path / images, *given, "--out", tmp_path / "out.h5")
    assert says.format(base=tmp_path) in said
    assert not list(tmp_path.glob("*out.h5*"))


def test_frames_are_read_as_they_are_described() -> None:
    describer, described, ahead = open_describer("sad"), 0, []
    describe_batch = describer.describe_batch

    def counted(images: NDArray[np.uint8]) -> NDArray[np.float32]:
        nonlocal described
        described += len(images)
        return describe_batch(images)

    describer.describe_batch = counted  # type: ignore[method-assign]
    rng = np.random.default_rng(0)

    def frames() -> Iterator[ForeignFrame]:
        for number in range(200):
            ahead.append(number - described)
            yield ForeignFrame(f"{number}", rng.integers(0, 256, (32, 64, 3), np.uint8))

    found = describer.describe(RecordedFrames(Path("drive"), ForeignTraverse("drive", frames()), ()), batch=4)
    assert found.names == tuple(map(str, range(200)))
    assert max(ahead) <= 8


@pytest.mark.slow
def test_the_three_commands_of_the_readme_lead_from_two_videos_to_matches_with_a_probability(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    route = tmp_path / "route"
    render_route(route, render_config({"places": 60, "size": (64, 128), "conditions": ("summer", "winter")}))
    # The second drive is twice as fast on its first half.
    driven = {"day": [*range(60)], "night": [*range(0, 30, 2), *range(30, 60)]}
    for (name, places), condition in zip(driven.items(), ("summer", "winter"), strict=True):
        files = sorted((route / condition).glob("*.png"))
        with av.open(str(tmp_path / f"{name}.mp4"), "w") as container:
            stream: Any = container.add_stream("libx264", rate=10, options={"crf": "18"})
            stream.height, stream.width, stream.pix_fmt = 64, 128, "yuv420p"
            for place in places:
                pixels = np.asarray(Image.open(files[place]).convert("RGB"))
                container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
            container.mux(stream.encode())
    monkeypatch.chdir(tmp_path)
    block = next(block for block in re.findall("```sh\n(.*?)```", README, re.DOTALL) if "day.mp4" in block)
    commands = block.replace("\\\n", "").splitlines()
    assert len(commands) == 3
    for command in commands:
        assert call(*shlex.split(command)[1:])[0] == 0
    with (tmp_path / "matches.csv").open() as table:
        matches = list(csv.DictReader(table))
    assert len(matches) > 0.8 * len(driven["night"])
    assert {match["score_kind"] for match in matches} == {"log-odds"}
    assert all(float(match["score"]) >= 0 for match in matches)  # a probability of one half
    off = [abs(int(match["database"]) - driven["night"][int(match["query"])]) for match in matches]
    assert np.mean(np.array(off) <= 1) > 0.95
