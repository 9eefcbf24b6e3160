from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.importing.containers.seq import open_seq
from everplace.importing.foreign_route import Encoded

ENDINGS = {102: ".jpg", 201: ".jpg", 1: ".png", 2: ".png"}


def pictures(count: int, channels: int = 3, size: tuple[int, int] = (5, 7)) -> list[NDArray[np.uint8]]:
    rng = np.random.default_rng(count)
    return [rng.integers(0, 256, (*size, channels), dtype=np.uint8) for _ in range(count)]


@pytest.mark.parametrize("version", [3, 5])
@pytest.mark.parametrize("padding", [0, 8])
@pytest.mark.parametrize(("code", "channels"), [(102, 1), (201, 3), (1, 1), (2, 3)])
def test_encoded_frames_come_byte_for_byte(
    tmp_path: Path, write_seq: Any, code: int, channels: int, padding: int, version: int
) -> None:
    frames, times = pictures(4, channels), [1e9 + 0.001, 1e9 + 0.052, 1e9 + 3.0, 1e9 + 3.000007]
    stored = write_seq(tmp_path / "a.seq", frames, times, code=code, padding=padding, version=version)
    seq = open_seq(tmp_path / "a.seq")
    assert (len(seq), seq.width, seq.height, seq.format, seq.fps, seq.missing) == (4, 7, 5, code, 20.0, 0)
    found = list(seq.frames())
    assert [frame.content for frame in found] == [Encoded(data, ENDINGS[code]) for data in stored]
    np.testing.assert_allclose([frame.seconds for frame in found], times, rtol=0, atol=2e-7)
    assert seq.seconds() == [frame.seconds for frame in found]


@pytest.mark.parametrize(("code", "channels"), [(100, 1), (200, 3)])
def test_raw_frames_become_grey_or_rgb_pixels(tmp_path: Path, write_seq: Any, code: int, channels: int) -> None:
    frames = pictures(3, channels)
    write_seq(tmp_path / "a.seq", frames, code=code)
    seq = open_seq(tmp_path / "a.seq")
    for found, frame in zip(seq.frames(), frames, strict=True):
        np.testing.assert_array_equal(found.content, frame)
    assert seq.seconds() == [0.0, 0.05, 0.1]


def test_chosen_frames_are_read_in_the_order_given(tmp_path: Path, write_seq: Any) -> None:
    stored = write_seq(tmp_path / "a.seq", pictures(5))
    found = [frame.content for frame in open_seq(tmp_path / "a.seq").frames([4, 0, 2])]
    assert found == [Encoded(stored[number], ".jpg") for number in (4, 0, 2)]


@pytest.mark.parametrize("code", [201, 200])
def test_a_header_without_a_count_reads_to_the_end(tmp_path: Path, write_seq: Any, code: int) -> None:
    write_seq(tmp_path / "a.seq", pictures(3), code=code, announced=0)
    seq = open_seq(tmp_path / "a.seq")
    assert (len(seq), seq.missing) == (3, 0)


def test_frames_behind_the_announced_ones_are_not_part_of_the_recording(tmp_path: Path, write_seq: Any) -> None:
    write_seq(tmp_path / "a.seq", pictures(5), announced=3)
    assert len(open_seq(tmp_path / "a.seq")) == 3


@pytest.mark.parametrize("code", [201, 2, 200])
@given(st.data())
@settings(max_examples=25, deadline=None)
def test_of_a_file_that_was_cut_off_whole_frames_are_kept(write_seq: Any, code: int, data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "a.seq"
        stored = write_seq(path, pictures(4), code=code)
        whole = path.read_bytes()
        ends = [whole.index(piece) + len(piece) + 6 for piece in stored]
        cut = data.draw(st.integers(1024, len(whole)) | st.sampled_from([end + k for end in ends for k in (-1, 0)]))
        path.write_bytes(whole[:cut])
        kept = sum(end <= cut for end in ends)
        if not kept:
            with pytest.raises(RouteError, match="holds no whole frame"):
                open_seq(path)
            return
        seq = open_seq(path)
        assert (len(seq), seq.missing) == (kept, 4 - kept)
        assert len(list(seq.frames())) == kept


def test_a_length_that_was_damaged_ends_the_recording_there(tmp_path: Path, write_seq: Any) -> None:
    path = tmp_path / "a.seq"
    stored = write_seq(path, pictures(5))
    data = bytearray(path.read_bytes())
    at = data.index(stored[3]) - 4
    data[at : at + 4] = b"\xff\xff\xff\xff"
    path.write_bytes(data)
    seq = open_seq(path)
    assert (len(seq), seq.missing) == (3, 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({}, "is no .seq container"),
        ({0: b"\x00\x00"}, "is no .seq container"),
        ({568: b"\x65\x00"}, "pictures of format 101, but known are 100 and 200"),
        ({560: b"\x10\x00"}, "does not fit or is not read here; only 8 bits"),
        ({580: b"\x05\x00\x00\x00"}, "says 5 bytes lie from one raw frame to the next"),
        ({548: b"\xff\xff\xff\xff"}, "does not fit or is not read here"),
    ],
)
def test_what_is_damaged_is_said_with_the_file(
    tmp_path: Path, write_seq: Any, change: dict[int, bytes], message: str
) -> None:
    path = tmp_path / "a.seq"
    write_seq(path, pictures(2), code=200)
    data = bytearray(path.read_bytes()) if change else bytearray(b"\xed\xfe")
    for at, value in change.items():
        data[at : at + len(value)] = value
    path.write_bytes(data)
    with pytest.raises(RouteError, match=message) as caught:
        open_seq(path)
    assert str(path) in str(caught.value)


def test_files_that_are_not_there_or_no_files(tmp_path: Path) -> None:
    with pytest.raises(RouteError, match=r"cannot read .*gone\.seq"):
        open_seq(tmp_path / "gone.seq")
    os.mkfifo(tmp_path / "pipe.seq")
    with pytest.raises(RouteError, match="is not a regular file"):
        open_seq(tmp_path / "pipe.seq")


def test_a_file_that_shrinks_while_it_is_read(tmp_path: Path, write_seq: Any) -> None:
    path = tmp_path / "a.seq"
    write_seq(path, pictures(3))
    seq = open_seq(path)
    path.write_bytes(path.read_bytes()[:1100])
    with pytest.raises(RouteError, match="became shorter while it was read"):
        list(seq.frames())


@given(st.data())
@fuzzed(60)
def test_fuzzed_bytes_give_frames_or_one_error(write_seq: Any, data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "a.seq"
        write_seq(path, pictures(3, size=(2, 3)), code=data.draw(st.sampled_from([200, 201, 2])))
        content = bytearray(path.read_bytes())
        places = st.integers(0, 36) | st.integers(548, 592) | st.integers(1024, len(content) - 1)
        for at in data.draw(st.lists(places, min_size=1, max_size=4)):
            content[at] = data.draw(st.integers(0, 255))
        path.write_bytes(content[: data.draw(st.integers(0, len(content)) | st.just(len(content)))])
        try:
            seq = open_seq(path)
            assert 0 < len(seq) == len(list(seq.frames()))
        except RouteError as error:
            assert "\n" not in str(error)
