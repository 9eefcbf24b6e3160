from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2
from tests.fuzzing import fuzzed

from everplace.errors import ConfigError, ImageError, RouteError
from everplace.images.decoding import ImageSpec, decode_image
from everplace.importing.import_route import import_route
from everplace.importing.kinds import source_kinds
from everplace.importing.sources._kaist_conditions import read_conditions
from everplace.importing.sources._kaist_sequences import visible_channels
from everplace.route.route import Route, open_route

SIZE = (6, 8)


def picture(seed: int, channels: int = 3) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (*SIZE, channels), dtype=np.uint8)


def write_images(root: Path, key: str, frames: int, sub: str = "", ending: str = "png") -> None:
    directory = root / "images" / key / sub
    directory.mkdir(parents=True)
    for number in range(frames):
        Image.fromarray(picture(number)).save(directory / f"I{number:05d}.{ending}")


def write_gps(root: Path, key: str, rows: list[tuple[str, float, float]], header: str = "stem,x,y") -> None:
    path = root / "gps" / f"{key}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([header, *(f"{name},{x},{y}" for name, x, y in rows)]) + "\n")


def imported(source: Path, out: Path, **options: str) -> tuple[Route, tuple[str, ...]]:
    shutil.rmtree(out, ignore_errors=True)
    summary = import_route("kaist", source, out, options)
    return open_route(out), summary.notes


def test_the_kind_is_listed() -> None:
    assert "by day, night" in source_kinds()["kaist"].SUMMARY


def test_videos_become_traverses_with_known_conditions_and_times(tmp_path: Path, write_seq: Any) -> None:
    source = tmp_path / "kaist"
    stored = write_seq(source / "videos/set00/Visible_V000.seq", [picture(k) for k in range(3)])
    write_seq(source / "videos/set00/LWIR_V000.seq", [picture(9, 1)], code=102)
    raw = [picture(k) for k in range(2)]
    write_seq(source / "videos/set03/Visible_V001.seq", raw, code=200)
    route, notes = imported(source, tmp_path / "route")
    assert [(traverse.name, traverse.condition) for traverse in route.traverses] == [
        ("set00_V000", "day"), ("set03_V001", "night"),
    ]  # fmt: skip
    assert route["day"].stems == ("set00_V000_I00000", "set00_V000_I00001", "set00_V000_I00002")
    assert [path.read_bytes() for path in route["day"].paths] == stored
    np.testing.assert_array_equal(decode_image(route["night"].paths[1], ImageSpec()), raw[1])
    assert (tmp_path / "route/set00_V000/times.csv").read_text().splitlines()[2] == "set00_V000_I00001,0.05"
    assert not route.aligned
    assert "research only" in notes[0]


@pytest.mark.parametrize("sub", ["", "visible"])
def test_extracted_images_stay_where_they_are(tmp_path: Path, sub: str) -> None:
    source = tmp_path / "kaist"
    write_images(source, "set04/V000", 3, sub)
    if sub:
        (source / "images/set04/V000/lwir").mkdir()
        Image.fromarray(picture(1)).save(source / "images/set04/V000/lwir/I00000.png")
    route, _ = imported(source, tmp_path / "route")
    assert [path.resolve() for path in route["night"].paths] == [
        (source / "images/set04/V000" / sub / f"I{number:05d}.png").resolve() for number in range(3)
    ]


def test_the_directory_may_be_the_images_themselves_and_visible_stands_in_the_name(tmp_path: Path) -> None:
    write_images(tmp_path, "set00/Visible_V002", 2)
    write_images(tmp_path, "set00/LWIR_V002", 2)
    route, _ = imported(tmp_path / "images", tmp_path / "route")
    assert [traverse.name for traverse in route.traverses] == ["set00_V002"]


@pytest.mark.parametrize("layout", ["extra", "unassociated", "cmyk", "lzw"])
def test_of_four_channels_the_visible_three_are_taken(tmp_path: Path, layout: str) -> None:
    pixels = picture(5, 4)
    path = tmp_path / "I00000.tif"
    mode = "CMYK" if layout == "cmyk" else "RGBA"
    tags = ImageFileDirectory_v2()
    if layout == "extra":
        tags[338] = 0  # ExtraSamples: unspecified
    Image.frombytes(mode, SIZE[::-1], pixels.tobytes()).save(
        path, "TIFF", compression="tiff_lzw" if layout == "lzw" else None, tiffinfo=tags
    )
    found = visible_channels(path)
    assert isinstance(found, np.ndarray)
    np.testing.assert_array_equal(found, pixels[:, :, :3])


def test_a_tiff_of_three_channels_stays_a_file_and_a_broken_one_is_named(tmp_path: Path) -> None:
    path = tmp_path / "I00000.tiff"
    Image.fromarray(picture(1)).save(path)
    assert visible_channels(path) == path
    Image.frombytes("RGBA", SIZE[::-1], picture(5, 4).tobytes()).save(path)
    path.write_bytes(path.read_bytes()[:-60])
    with pytest.raises(ImageError, match=r"I00000\.tiff is truncated or broken"):
        visible_channels(path)
    path.write_bytes(b"")
    with pytest.raises(ImageError, match=r"I00000\.tiff is truncated or broken"):
        visible_channels(path)


def test_conditions_are_said_by_set_video_or_file(tmp_path: Path) -> None:
    source = tmp_path / "kaist"
    for key in ("set00/V000", "set00/V001", "set20/V000"):
        write_images(source, key, 1)

    def conditions(**options: str) -> list[str]:
        return [traverse.condition for traverse in imported(source, tmp_path / "route", **options)[0].traverses]

    assert conditions() == ["day", "day", "set20_V000"]
    assert "No condition is known for set20/V000" in imported(source, tmp_path / "route")[1][-1]
    assert conditions(conditions="set00/V001:sunset,set20:sunrise") == ["day", "sunset", "sunrise"]
    csv = tmp_path / "conditions.csv"
    csv.write_text("sequence,condition\nset00,night\nset00/V001,dawn\n")
    assert conditions(conditions=str(csv)) == ["night", "dawn", "set20_V000"]
    toml = tmp_path / "conditions.toml"
    toml.write_text('set20 = "dusk"\n"set00/V000" = "noon"\n')
    assert conditions(conditions=str(toml)) == ["noon", "day", "dusk"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"conditions": "day"}, "conditions='day' cannot be: write SET:CONDITION"),
        ({"conditions": "gone.toml"}, "cannot read gone.toml"),
        ({"sequences": "set99"}, "sequences='set99' is not there; there are: set00/V000, set03/V000"),
        ({"align": "pairs"}, "align=pairs needs the pairs"),
        ({"pairs": "a.csv"}, "pairs are of no use without `align=pairs`"),
        ({"preset": "paper"}, "preset paper needs sequences that are aligned"),
        ({"gps": "{nothing}"}, "gps='{nothing}' cannot be"),
        ({"align": "gps", "reference": "set07/V000"}, "reference='set07/V000' is no sequence"),
        ({"radius": "-1"}, "`radius`=-1 cannot be"),
    ],
)
def test_options_that_cannot_be(tmp_path: Path, options: dict[str, str], message: str) -> None:
    source = tmp_path / "kaist"
    for key in ("set00/V000", "set03/V000"):
        write_images(source, key, 2)
        write_gps(source, key, [("I00000", 0, 0), ("I00001", 5, 0)])
    with pytest.raises(ConfigError, match=message.replace("{", r"\{")):
        imported(source, tmp_path / "route", **options)
    assert not (tmp_path / "route").exists()


@pytest.mark.parametrize("text", ["x = 3", "= =", "a" * 9, "[" * 3000])
def test_a_table_of_conditions_that_is_none(tmp_path: Path, text: str) -> None:
    write_images(tmp_path, "set00/V000", 1)
    for name in ("table.toml", "table.csv"):
        (tmp_path / name).write_text(text)
        with pytest.raises(ConfigError, match="is not a table of sequences and conditions"):
            imported(tmp_path, tmp_path / "route", conditions=str(tmp_path / name))


def test_what_is_no_copy_of_the_data_set(tmp_path: Path, write_seq: Any) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(RouteError, match="holds neither videos/setNN/Visible_VNNN.seq nor images/setNN/VNNN"):
        imported(tmp_path / "empty", tmp_path / "route")
    (tmp_path / "bare/images/set00/V000").mkdir(parents=True)
    with pytest.raises(RouteError, match="V000 holds no image; extract the frames"):
        imported(tmp_path / "bare", tmp_path / "route")
    write_images(tmp_path / "twice", "set00/V000", 1)
    write_images(tmp_path / "twice", "set00/Visible_V000", 1)
    with pytest.raises(RouteError, match="are the same sequence; keep one of them"):
        imported(tmp_path / "twice", tmp_path / "route")
    write_images(tmp_path / "stems", "set00/V000", 2)
    shutil.copy(tmp_path / "stems/images/set00/V000/I00001.png", tmp_path / "stems/images/set00/V000/I00001.tif")
    with pytest.raises(RouteError, match=r"'I00001\.png' and 'I00001\.tif' in .* would both be the frame 'I00001'"):
        imported(tmp_path / "stems", tmp_path / "route")


def test_a_damaged_tail_is_kept_as_far_as_it_is_whole_and_said(tmp_path: Path, write_seq: Any) -> None:
    path = tmp_path / "videos/set00/Visible_V000.seq"
    write_seq(path, [picture(k) for k in range(5)])
    path.write_bytes(path.read_bytes()[:-300])
    route, notes = imported(tmp_path, tmp_path / "route")
    kept = len(route.traverses[0])
    assert 0 < kept < 5
    assert f"{5 - kept} of its 5 frames are lost, the first {kept} were kept" in notes[1]


def drives(source: Path, write_seq: Any) -> None:
    """Two drives along 40 m: one frame a metre, and one that begins 10 m later with two frames a metre."""
    write_images(source, "set00/V000", 40)
    write_gps(source, "set00/V000", [(f"I{k:05d}", k, 0) for k in range(40)])
    times = [100 + k / 10 for k in range(60)]
    write_seq(source / "videos/set03/Visible_V000.seq", [picture(k) for k in range(60)], times)
    write_gps(source, "set03/V000", [(f"{100 + k}", 10 + 5 * k, 0.25) for k in range(6)], "seconds,easting,northing")


def both_forms(source: Path) -> None:
    """Extracts the video, for a copy has one form."""
    write_images(source, "set03/V000", 60)
    write_gps(source, "set03/V000", [(f"I{k:05d}", 10 + k / 2, 0.25) for k in range(60)])


def test_gps_aligns_two_drives(tmp_path: Path, write_seq: Any) -> None:
    drives(tmp_path, write_seq)
    both_forms(tmp_path)
    route, notes = imported(tmp_path, tmp_path / "route", align="gps", radius="2", form="images")
    assert route.truth_origin == "positions by GPS, within 2 m"
    day, night = route["day"], route["night"]
    assert day.stems == night.stems == tuple(f"{place:05d}" for place in range(30))
    assert day.poses is not None
    assert night.poses is not None
    assert np.linalg.norm(day.poses[:, :2] - night.poses[:, :2], axis=1).max() <= 0.26
    assert notes[-1] == (
        "30 places are in all sequences; without a partner: 10 of 40 frames of set00/V000, 30 of 60 frames of "
        "set03/V000."
    )


def test_positions_by_time_of_a_video_and_frames_without_position(tmp_path: Path, write_seq: Any) -> None:
    drives(tmp_path, write_seq)
    route, notes = imported(tmp_path, tmp_path / "route", form="videos")
    assert route.truth_origin == "positions by GPS"
    night = route["night"]
    assert len(night) == 51  # the fixes end 0.9 s before the video
    assert night.poses is not None
    np.testing.assert_allclose(night.poses[:, 0], 10 + np.arange(51) / 2, atol=1e-6)
    assert "9 of 60 frames of set03/V000 have no position and were left out." in notes
    write_gps(tmp_path, "set03/V000", [("1", 0, 0), ("2", 1, 1)], "seconds,x,y")
    with pytest.raises(RouteError, match="the GPS file of set03/V000 covers none of its 60 frames"):
        imported(tmp_path, tmp_path / "route", form="videos")
    (tmp_path / "gps/set03/V000.csv").unlink()
    with pytest.raises(RouteError, match="align=gps needs .*V000.csv, which does not exist"):
        imported(tmp_path, tmp_path / "route", form="videos", align="gps")


def test_pairs_align_two_drives_and_every_thins_them(tmp_path: Path, write_seq: Any) -> None:
    drives(tmp_path, write_seq)
    both_forms(tmp_path)
    shutil.rmtree(tmp_path / "gps")
    pairs = tmp_path / "pairs.csv"
    pairs.write_text("set00/V000,set03/V000\nI00010,I00000\nI00030,I00040\n")
    route, _ = imported(tmp_path, tmp_path / "route", align="pairs", pairs=str(pairs), form="images", every="2")
    assert route.truth_origin == f"the pairs of frames in {pairs.name}, set by hand"
    assert route["day"].poses is None
    chosen = [[int(path.resolve().stem[1:]) for path in traverse.paths] for traverse in route.traverses]
    assert chosen[0] == list(range(10, 31, 2))
    assert chosen[1] == [2 * (number - 10) for number in chosen[0]]


def paper_copy(source: Path, frames: int) -> str:
    """Six sequences of tiny images, all links to one file, and who says their conditions."""
    keys = [f"set{number}/V000" for number in range(20, 26)]
    source.mkdir()
    Image.fromarray(picture(0)).save(source / "one.png")
    for key in keys:
        (source / "images" / key).mkdir(parents=True)
        for number in range(frames):
            (source / "images" / key / f"I{number:05d}.png").symlink_to(source / "one.png")
    header = ",".join(keys)
    rows = [",".join([f"I{number:05d}"] * 6) for number in (0, frames - 1)]
    (source / "pairs.csv").write_text("\n".join([header, *rows]) + "\n")
    conditions = ("day", "night", "sunset", "sunrise", "day", "night")
    return ",".join(f"{key}:{condition}" for key, condition in zip(keys, conditions, strict=True))


def test_the_preset_of_the_paper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from everplace.importing.sources import kaist

    # 8,000 places of six sequences are 48,000 links: a hundredth of it shows the same.
    monkeypatch.setattr(kaist, "_PAPER_TRAINING", 16)
    monkeypatch.setattr(kaist, "_PAPER_TEST", 64)
    source = tmp_path / "kaist"
    conditions = paper_copy(source, 100)
    options = {"preset": "paper", "align": "pairs", "pairs": str(source / "pairs.csv")}
    route, _ = imported(source, tmp_path / "route", conditions=conditions, **options)
    assert set(route.conditions) == {"day", "night", "sunset", "sunrise"}
    assert [len(traverse) for traverse in route.traverses] == [80] * 6
    assert len(route.shared_stems()) == 80
    assert route.protocol == "KAIST, 1,600 training and 6,400 test places"
    with pytest.raises(RouteError, match="preset paper knows the conditions .* but that of set21/V000 is fog"):
        imported(source, tmp_path / "route", conditions=conditions.replace("set21/V000:night", "set21:fog"), **options)
    with pytest.raises(RouteError, match="that of set20/V000 is not known; say it with"):
        imported(source, tmp_path / "route", **options)
    with pytest.raises(RouteError, match="needs 6 sequences, but .* gives 5"):
        imported(source, tmp_path / "route", sequences="set20,set21,set22,set23,set24", **options)
    with pytest.raises(RouteError, match="needs 80 places, but the sequences of .* share 50"):
        imported(source, tmp_path / "route", conditions=conditions, **{**options, "every": "2"})


@fuzzed(60)
@given(
    text=st.binary(max_size=40)
    | st.text(st.sampled_from('sequence,condition=set0/V"[].\n\r# '), max_size=40).map(str.encode),
    ending=st.sampled_from([".csv", ".toml"]),
    header=st.booleans(),
)
def test_any_text_is_a_table_of_conditions_or_one_error(tmp_path: Path, text: bytes, ending: str, header: bool) -> None:
    path = tmp_path / f"conditions{ending}"
    path.write_bytes(b"sequence,condition\n" * (header and ending == ".csv") + text)
    try:
        table = read_conditions((str(path),))
        assert all(key and condition for key, condition in table.items() if ending == ".csv")
    except ConfigError as error:
        assert path.name in str(error)
        assert len(str(error).splitlines()) == 1


def test_frames_at_exactly_0_0_have_no_position(tmp_path: Path) -> None:
    write_images(tmp_path, "set00/V000", 4)
    header = "stem,lat,lon"
    rows = [(f"I{number:05d}", 48.0, 11.0 + number / 1e4) for number in range(4)]
    write_gps(tmp_path, "set00/V000", [("I00000", 0, 0), rows[1], rows[2], rows[3]], header)
    route, notes = imported(tmp_path, tmp_path / "route")
    assert "1 of 4 frames of set00/V000 have no position and were left out." in notes
    poses = route.traverses[0].poses
    assert poses is not None
    np.testing.assert_allclose(poses[:, 0], [0, 7.46, 14.92], atol=0.01)
    write_gps(tmp_path, "set00/V000", [(name, 0, 0) for name, _, _ in rows], header)
    route, notes = imported(tmp_path, tmp_path / "route")
    assert (route.traverses[0].poses, len(route.traverses[0])) == (None, 4)
    path = tmp_path / "gps/set00/V000.csv"
    assert f"{path} holds no fix near a frame: set00/V000 gets no poses." in notes
    write_images(tmp_path, "set01/V000", 4)
    write_gps(tmp_path, "set01/V000", rows, header)
    with pytest.raises(RouteError, match=r"align=gps needs positions, and .*set00/V000\.csv holds no fix"):
        imported(tmp_path, tmp_path / "route", align="gps")
