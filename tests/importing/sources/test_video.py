from __future__ import annotations

import builtins
import struct
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from tests.fuzzing import DAMAGE, Damage, fuzzed

from everplace.errors import EverplaceError, MissingExtraError, RouteError
from everplace.importing.containers.video_frames import check_video, last_frame_begins, read_video
from everplace.importing.import_route import import_route
from everplace.importing.sources.video import Options, read
from everplace.route.route import open_route

av = pytest.importorskip("av", reason="needs the extra video")

RATE = 10


def picture(number: int) -> NDArray[np.uint8]:
    """A smooth picture of 16×32 that tells its number by its first pixel's red."""
    y, x = np.mgrid[0:16, 0:32]
    return np.stack([x + number, 9 * y, 5 * (x + y)], axis=2).astype(np.uint8)


def write_video(
    path: Path,
    count: int,
    codec: str = "libx264rgb",
    form: str = "rgb24",
    *,
    turn: int = 0,
    times: list[int] | None = None,
    flags: dict[str, str] | None = None,
) -> None:
    """Writes `count` pictures without loss, at 10 a second or at the given milliseconds."""
    options = {"qp": "0", "g": "5"} if codec == "libx264rgb" else {}
    with av.open(str(path), "w", options=flags or {}) as container:
        stream: Any = container.add_stream(codec, rate=RATE, options=options)
        stream.height, stream.width, stream.pix_fmt = 16, 32, form
        if turn:
            stream.set_display_rotation(turn)
        for number in range(count):
            frame = av.VideoFrame.from_ndarray(picture(number), format="rgb24")
            if times is not None:
                frame.pts, frame.time_base = times[number], Fraction(1, 1000)
                stream.codec_context.time_base = Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def test_every_frame_with_its_time(tmp_path: Path) -> None:
    write_video(tmp_path / "a.mkv", 12)
    frames = list(read_video(tmp_path / "a.mkv"))
    assert [frame.seconds for frame in frames] == [number / RATE for number in range(12)]
    for number, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.pixels, picture(number))


def test_uneven_times_are_kept(tmp_path: Path) -> None:
    times = [500, 540, 700, 1900, 1901]  # the first frame is the beginning
    write_video(tmp_path / "a.mkv", 5, "ffv1", "bgr0", times=times)
    assert [frame.seconds for frame in read_video(tmp_path / "a.mkv")] == [0.0, 0.04, 0.2, 1.4, 1.401]


@pytest.mark.parametrize("turn", [90, 180, -90])
def test_rotation_is_applied_as_the_matrix_in_the_file_says(tmp_path: Path, turn: int) -> None:
    path = tmp_path / "a.mp4"
    write_video(path, 3, turn=turn)
    data = path.read_bytes()
    matrix = data.index(b"tkhd") + 4 + 40  # ISO/IEC 14496-12: version 0 of the track header
    a, b, _, c, d = struct.unpack_from(">5i", data, matrix)
    cosine, sine = a / 65536, b / 65536
    assert (c, d) == (-b, a)
    shown = next(iter(read_video(path))).pixels
    # A pixel at (x, y), y down, is shown at (a x + c y, b x + d y), moved so that no coordinate is negative.
    stored = picture(0)
    for y, x in ((0, 0), (0, 31), (15, 0), (7, 20)):
        u, v = cosine * x - sine * y, sine * x + cosine * y
        u += 31 if cosine < 0 else 15 if sine > 0 else 0
        v += 15 if cosine < 0 else 31 if sine < 0 else 0
        np.testing.assert_array_equal(shown[round(v), round(u)], stored[y, x])


@pytest.mark.parametrize("number", range(8))
def test_a_display_matrix_turns_and_mirrors(tmp_path: Path, number: int) -> None:
    """All eight: a and d, or b and c, are 1 or -1."""
    swaps, first, second = number & 1, 1 - (number & 2), 1 - (number >> 1 & 2)
    a, b, c, d = (0, first, second, 0) if swaps else (first, 0, 0, second)
    path = tmp_path / "a.mp4"
    write_video(path, 3)
    data = bytearray(path.read_bytes())
    matrix = data.index(b"tkhd") + 4 + 40
    struct.pack_into(">5i", data, matrix, a * 65536, b * 65536, 0, c * 65536, d * 65536)
    path.write_bytes(data)
    shown, stored = next(iter(read_video(path))).pixels, picture(0)
    assert shown.shape == ((32, 16, 3) if swaps else (16, 32, 3))
    for y, x in ((0, 0), (0, 31), (15, 0), (7, 20)):
        u, v = a * x + c * y, b * x + d * y
        u += (15 if swaps else 31) if u < 0 or (a or c) < 0 else 0
        v += (31 if swaps else 15) if v < 0 or (b or d) < 0 else 0
        np.testing.assert_array_equal(shown[v, u], stored[y, x])


def test_sampling_size_and_names(tmp_path: Path) -> None:
    for name in ("b", "a"):
        write_video(tmp_path / f"{name}.mp4", 25)
    options = {"every_seconds": "1", "size": "16x8", "conditions": "night,day"}
    summary = import_route("video", tmp_path, tmp_path / "out", options)
    route = open_route(tmp_path / "out")
    assert dict(summary.traverses) == {"a": 3, "b": 3}
    assert route.conditions == ("night", "day")
    assert route["a"].stems == ("000000", "000001", "000002")
    route_frames = read(tmp_path, Options(every_seconds=1.0, size=(8, 16)))
    for traverse in route_frames.traverses:
        contents = [frame.content for frame in traverse.frames]
        assert [content.shape for content in contents if isinstance(content, np.ndarray)] == [(8, 16, 3)] * 3


@pytest.mark.parametrize("ending", [".mkv", ".avi", ".mp4"])
def test_a_video_that_breaks_off(tmp_path: Path, ending: str) -> None:
    whole, path = tmp_path / f"whole{ending}", tmp_path / f"winter{ending}"
    write_video(whole, 60, "libx264rgb" if ending != ".avi" else "ffv1", "rgb24" if ending != ".avi" else "bgr0")
    data = bytearray(whole.read_bytes())
    if ending == ".mp4":
        middle = data.index(b"mdat") + 2000
        data[middle : middle + 200] = bytes(200)
    else:
        del data[len(data) // 2 :]
    path.write_bytes(data)
    with pytest.raises(RouteError, match=rf"winter{ending} .* after \d+ frames, at [0-4]\.\d\d s.*`damaged=keep`"):
        import_route("video", path, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    summary = import_route("video", path, tmp_path / "out", {"damaged": "keep"})
    kept = summary.frames
    assert 5 <= kept < 55
    assert f"Only the first {kept} frames of {path} were kept: " in summary.notes[0]
    for number, frame in zip(range(kept), read_video(path), strict=False):
        np.testing.assert_array_equal(frame.pixels, picture(number))


FASTSTART = {"movflags": "faststart"}
FRAGMENTS = {"movflags": "frag_keyframe+empty_moov"}


@pytest.mark.parametrize("share", [0.8, 0.88, 0.93, 0.97])
@pytest.mark.parametrize(
    ("name", "flags"), [("a.mkv", {}), ("a.mp4", FASTSTART), ("a.mov", FASTSTART), ("a.mp4", FRAGMENTS)]
)
def test_a_cut_of_less_than_a_second_is_noticed(tmp_path: Path, name: str, flags: dict[str, str], share: float) -> None:
    path = tmp_path / name
    write_video(path, 40, flags=flags)
    assert import_route("video", path, tmp_path / "whole").notes == ()
    data = path.read_bytes()
    for zeros in (False, True):  # cut off, or the place on the disk taken and not filled
        kept = int(len(data) * share)
        path.write_bytes(data[:kept] + bytes(len(data) - kept) * zeros)
        out = tmp_path / f"out-{zeros}"
        try:
            summary = import_route("video", path, out)
        except RouteError as error:
            assert "damaged=keep" in str(error)
            summary = import_route("video", path, out, {"damaged": "keep"})
            assert 20 <= summary.frames < 40
            assert f"Only the first {summary.frames} frames of {path} were kept: " in summary.notes[0]
        else:  # the frames are there, and what lay behind them is not; fragments do not announce the last frame
            assert summary.frames == 40 or flags == FRAGMENTS
            assert "was cut off" in summary.notes[0]


@pytest.mark.parametrize("name", ["a.ts", "a.mpg", "a.mkv"])
def test_an_end_that_is_not_announced_is_told(tmp_path: Path, name: str) -> None:
    codec, form = ("mpeg2video", "yuv420p") if name == "a.mpg" else ("libx264", "yuv420p")
    global_rate = {"live": "1"} if name == "a.mkv" else {}
    path = tmp_path / name
    with av.open(str(path), "w", options=global_rate) as container:
        stream: Any = container.add_stream(codec, rate=25)
        stream.height, stream.width, stream.pix_fmt = 16, 32, form
        for number in range(20):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(number), format="rgb24")))
        container.mux(stream.encode())
    (note,) = import_route("video", path, tmp_path / "out").notes
    assert note == f"{path} does not announce where it ends, so whether it is whole cannot be checked."
    if name == "a.ts":
        path.write_bytes(path.read_bytes()[:-100])
        assert "stops in the middle of its container" in check_video(path).doubt


@pytest.mark.parametrize("start", [0.04, 1.5, 5.0, 3600.0])
def test_matroska_that_does_not_start_at_0(tmp_path: Path, start: float) -> None:
    path = tmp_path / "a.mkv"
    write_video(path, 30, "ffv1", "bgr0", times=[round(1000 * start) + 100 * number for number in range(30)])
    summary = import_route("video", path, tmp_path / "out")
    assert (summary.frames, summary.notes) == (30, ())
    assert last_frame_begins(path) == pytest.approx(2.9, abs=0.01)
    path.write_bytes(path.read_bytes()[: int(0.9 * path.stat().st_size)])
    with pytest.raises(RouteError, match=r"breaks off after 2\d frames"):
        import_route("video", path, tmp_path / "cut")


@pytest.mark.parametrize("dropped", [{3}, {10, 11, 12}, set(range(5, 30, 2))])
def test_an_avi_with_dropped_frames(tmp_path: Path, dropped: set[int]) -> None:
    path = tmp_path / "a.avi"
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("mjpeg", rate=RATE)
        stream.height, stream.width, stream.pix_fmt = 16, 32, "yuvj420p"
        for number in sorted(set(range(40)) - dropped):
            frame = av.VideoFrame.from_ndarray(picture(number), format="rgb24")
            frame.pts, frame.time_base = number, Fraction(1, RATE)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    assert check_video(path).frames == 40
    assert import_route("video", path, tmp_path / "out").frames == 40 - len(dropped)


def test_videos_that_are_passed_over_are_counted(tmp_path: Path) -> None:
    write_video(tmp_path / "a.mp4", 3)
    for name in ("b.h264", "c.3gp", "d.3GP", "a.LRV", "e.mp4.part", "notes.txt"):
        (tmp_path / name).touch()
    (note,) = import_route("video", tmp_path, tmp_path.parent / "out").notes
    assert "holds videos that were not read: 2 × .3gp, 1 × .h264, 1 × .lrv, 1 × .mp4.part; " in note


def test_what_is_no_video(tmp_path: Path) -> None:
    for name, content in (("empty.mp4", b""), ("text.mkv", b"not a video\n" * 50)):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(RouteError, match=rf"{name} is no video that can be read .*; copy or export it again"):
            import_route("video", tmp_path / name, tmp_path / "out")
    with pytest.raises(RouteError, match=r"cannot read .*none.mp4: No such file or directory"):
        check_video(tmp_path / "none.mp4")
    (tmp_path / "none").mkdir()
    with pytest.raises(RouteError, match="holds no video"):
        import_route("video", tmp_path / "none", tmp_path / "out")
    with av.open(str(tmp_path / "sound.mkv"), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), dtype=np.int16), format="s16", layout="mono")
        sound.rate = 8000
        container.mux(stream.encode(sound))
    with pytest.raises(RouteError, match=r"sound.mkv holds no video stream"):
        check_video(tmp_path / "sound.mkv")


def test_a_playlist_opens_nothing(tmp_path: Path) -> None:
    write_video(tmp_path / "secret.mkv", 3)
    (tmp_path / "a.mp4").write_text(f"#EXTM3U\n#EXTINF:1,\n{tmp_path}/secret.mkv\n#EXT-X-ENDLIST\n")
    with pytest.raises(RouteError, match=r"a.mp4 is no video"):
        list(read_video(tmp_path / "a.mp4"))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("stem,x,y,heading\n0,0,0,0\n1,0,0,0\n", "has 2 rows, but there are more frames; give a row for each frame"),
        ("stem,x,y,heading\n" + "".join(f"{n},0,0,0\n" for n in range(5)), "has 5 rows, but there are only 3 frames"),
        ("stem,x,y,heading\n1,0,0,0\n1,0,0,0\n", "row 3 names the stem '1' a second time"),
        ("stem,x,y,heading\n2,0,0,0\n1,0,0,0\n3,0,0,0\n", "are not in natural order"),
        ("stem,x,y,heading\n", "holds no pose"),
        ("seconds,x,y,heading\n", "holds no pose"),
        ("seconds,x,y,heading\n9,0,0,0\n", "no pose within 0.5 s of the frame '000000' of a.mkv, at 0.000 s"),
        ("x,y,heading\n0,0,0\n", "lacks the column 'stem'"),
    ],
)
def test_mistakes_in_the_poses_beside_a_video(tmp_path: Path, rows: str, message: str) -> None:
    write_video(tmp_path / "a.mkv", 3, "ffv1", "bgr0")
    (tmp_path / "a.poses.csv").write_text(rows)
    with pytest.raises(RouteError, match=message) as caught:
        import_route("video", tmp_path / "a.mkv", tmp_path / "out")
    assert "a.poses.csv" in str(caught.value)


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original: Callable[..., Any] = builtins.__import__

    def refuse(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "av":
            raise ImportError(name)
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(MissingExtraError, match=r"pip install 'everplace\[video\]'"):
        check_video(tmp_path / "a.mkv")


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    directory = tmp_path_factory.mktemp("originals")
    for name in ("a.mkv", "b.mp4", "c.avi"):
        write_video(
            directory / name, 4, "ffv1" if name == "c.avi" else "libx264rgb", "bgr0" if name == "c.avi" else "rgb24"
        )
    return [(directory / name).read_bytes() for name in ("a.mkv", "b.mp4", "c.avi")]


@fuzzed(40)
@given(
    which=st.integers(0, 2),
    damage=DAMAGE,
)
def test_damaged_bytes_give_frames_or_one_error(
    tmp_path: Path, originals: list[bytes], which: int, damage: Damage
) -> None:
    path = tmp_path / "fuzz.mkv"
    path.write_bytes(damage.of(originals[which]))
    count = 0
    try:
        for traverse in read(path, Options()).traverses:
            for frame in traverse.frames:
                assert isinstance(frame.content, np.ndarray)
                count += 1
    except EverplaceError as error:
        assert "fuzz.mkv" in str(error)
        assert "\n" not in str(error)
    else:
        assert count


def times_of(route: Path) -> list[float]:
    lines = (route / "times.csv").read_text().splitlines()[1:]
    return [float(line.partition(",")[2]) for line in lines]


@pytest.fixture
def chapters(tmp_path: Path) -> Path:
    """Three chapters of 12, 7 and 6 frames at 10 a second."""
    (tmp_path / "winter").mkdir()
    for number, count in enumerate([12, 7, 6], start=1):
        write_video(tmp_path / "winter" / f"GX0{number}0012.MP4", count)
    return tmp_path / "winter"


@pytest.mark.parametrize(
    ("options", "times"),
    [
        ({}, [number / RATE for number in range(25)]),
        ({"every_frames": "5"}, [0.0, 0.5, 1.0, 1.5, 2.0]),
        ({"every_seconds": "0.8"}, [0.0, 0.8, 1.6, 2.4]),
        ({"join": "GX030012.MP4,GX010012.MP4"}, [number / RATE for number in range(18)]),
    ],
)
def test_chapters_become_one_drive(tmp_path: Path, chapters: Path, options: dict[str, str], times: list[float]) -> None:
    import_route("video", chapters, tmp_path / "out", {"join": "true", "stems": "file", **options})
    (traverse,) = open_route(tmp_path / "out").traverses
    assert traverse.name == "winter"
    np.testing.assert_allclose(times_of(traverse.root), times, atol=1e-6)
    assert traverse.stems == tuple(f"{round(time * RATE):06d}" for time in times)


def test_joined_chapters_are_the_drive_that_was_never_split(tmp_path: Path, chapters: Path) -> None:
    import_route("video", chapters, tmp_path / "out", {"join": "true"})
    (traverse,) = open_route(tmp_path / "out").traverses
    numbers = [*range(12), *range(7), *range(6)]
    for path, number in zip(traverse.paths, numbers, strict=True):
        np.testing.assert_array_equal(np.asarray(Image.open(path)), picture(number))


def test_chapters_that_are_not_joined_are_told(tmp_path: Path, chapters: Path) -> None:
    notes = import_route("video", chapters, tmp_path / "out", {"stems": "own"}).notes
    assert len(open_route(tmp_path / "out").traverses) == 3
    assert [note for note in notes if "`join=true`" in note]
    notes = import_route("video", chapters / "GX010012.MP4", tmp_path / "one", {"stems": "own"}).notes
    assert [note for note in notes if "`join=GX010012.MP4,GX020012.MP4,GX030012.MP4`" in note]


def test_poses_of_joined_chapters(tmp_path: Path, chapters: Path) -> None:
    """By time and by name, beside each chapter or beside the directory; the way goes on from chapter to chapter."""
    header = "seconds,x,y,heading\n"
    (tmp_path / "winter.poses.csv").write_text(f"{header}0,0,0,0\n2.4,24,0,0\n")
    import_route("video", chapters, tmp_path / "whole", {"join": "true", "pose_limit": "3", "every_metres": "5"})
    poses = open_route(tmp_path / "whole").traverses[0].poses
    assert poses is not None
    np.testing.assert_allclose(poses[:, 0], [0, 5, 10, 15, 20], atol=1e-6)
    (chapters / "GX020012.poses.csv").write_text(f"{header}0,12,0,0\n0.6,18,0,0\n")
    with pytest.raises(RouteError, match=r"winter\.poses\.csv holds poses of all parts .* keep one of them"):
        import_route("video", chapters, tmp_path / "out", {"join": "true"})
    (tmp_path / "winter.poses.csv").unlink()
    with pytest.raises(RouteError, match=r"parts of the drive in .*winter differ in their poses"):
        import_route("video", chapters, tmp_path / "out", {"join": "true"})
    (chapters / "GX010012.poses.csv").write_text(f"{header}0,0,0,0\n1.1,11,0,0\n")
    (chapters / "GX030012.poses.csv").write_text(f"{header}0,19,0,0\n0.5,24,0,0\n")
    import_route("video", chapters, tmp_path / "each", {"join": "true", "pose_limit": "3"})
    poses = open_route(tmp_path / "each").traverses[0].poses
    assert poses is not None
    np.testing.assert_allclose(poses[:, 0], np.arange(25), atol=1e-6)
    for path in chapters.glob("*.csv"):
        path.unlink()
    rows = "".join(f"w{number},{number},0,0\n" for number in range(25))
    (tmp_path / "winter.poses.csv").write_text(f"stem,x,y,heading\n{rows}")
    import_route("video", chapters, tmp_path / "named", {"join": "true"})
    assert open_route(tmp_path / "named").traverses[0].stems == tuple(f"w{number}" for number in range(25))


def test_a_chapter_that_breaks_off_does_not_shift_the_ones_after_it(tmp_path: Path, chapters: Path) -> None:
    write_video(chapters / "GX010012.mkv", 40)
    data = (chapters / "GX010012.mkv").read_bytes()
    (chapters / "GX010012.mkv").write_bytes(data[: len(data) * 6 // 10])
    options = {"join": "GX010012.mkv,GX020012.MP4", "damaged": "keep"}
    notes = import_route("video", chapters, tmp_path / "out", options).notes
    assert [note for note in notes if "were kept" in note]
    times = times_of(open_route(tmp_path / "out").traverses[0].root)
    assert len(times) < 46
    np.testing.assert_allclose(times[-7:], [4.0 + number / RATE for number in range(7)], atol=1e-3)
