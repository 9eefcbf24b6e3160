from __future__ import annotations

import io
import json
import shutil
import sys
import tarfile
import zipfile
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from tests.fuzzing import DAMAGE, Damage, fuzzed

from everplace.errors import ConfigError, EverplaceError, MissingExtraError, RouteError
from everplace.images.decoding import ImageSpec, decode_image, resize_image
from everplace.importing.import_route import ImportSummary, import_route
from everplace.importing.sources import _nordland_presets, _nordland_video, nordland
from everplace.importing.sources._nordland_names import read_list, season_of
from everplace.importing.sources._nordland_presets import choose_frames
from everplace.route.natural_order import natural_sorted
from everplace.route.route import Route, open_route
from everplace.route.truth import truth_by_position

SEASONS = ("spring", "summer", "fall", "winter")


def pixels(season: str, number: int) -> NDArray[np.uint8]:
    """A small picture that is different for each season and number."""
    rng = np.random.default_rng([SEASONS.index(season), number])
    return rng.integers(0, 256, (4, 8, 3), dtype=np.uint8)


def png(season: str, number: int) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels(season, number)).save(buffer, "PNG")
    return buffer.getvalue()


def write(root: Path, files: Mapping[str, bytes]) -> Path:
    for name, data in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(data)
    return root


def tar(path: Path, files: Mapping[str, bytes], mode: str = "w:gz") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with tarfile.open(path, mode) as archive:  # type: ignore[call-overload]
        for name, data in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
    return path


def folders(numbers: Sequence[int] = (1, 2, 10), top: str = "") -> dict[str, bytes]:
    return {f"{top}{season}/images-{number:05d}.png": png(season, number) for season in SEASONS for number in numbers}


def load(source: Path, **options: str) -> tuple[ImportSummary, Route]:
    out = source.parent / "out"
    shutil.rmtree(out, ignore_errors=True)
    summary = import_route("nordland", source, out, options)
    return summary, open_route(out)


def refused(source: Path, **options: str) -> str:
    with pytest.raises(RouteError) as caught:
        load(source, **options)
    assert "\n" not in str(caught.value)
    assert not (source.parent / "out").exists()
    return str(caught.value)


def check(route: Route, numbers: Mapping[str, int]) -> None:
    """Every season has exactly these stems, each with the picture of its number."""
    for traverse in route.traverses:
        assert traverse.stems == tuple(natural_sorted(numbers))
        for frame in traverse:
            expected = pixels(traverse.name, numbers[frame.stem])
            np.testing.assert_array_equal(decode_image(frame.path, ImageSpec()), expected)


STEMS = {f"images-{number:05d}": number for number in (1, 2, 10)}


def test_seasons_in_folders_are_linked(tmp_path: Path) -> None:
    source = write(tmp_path / "nordland", folders(top="64x32-grayscale-1fps/") | {"readme.txt": b"", "cover.png": b"x"})
    summary, route = load(source)
    assert list(summary.traverses) == list(SEASONS)
    assert summary.linked == summary.frames == 12
    assert "1 images were left out that are no frames of a season, the first is 'cover.png'." in summary.notes
    check(route, STEMS)
    assert route["winter"].paths[0].readlink() == source / "64x32-grayscale-1fps/winter/images-00001.png"


@pytest.mark.parametrize("mode", ["w", "w:gz", "w:xz"])
def test_seasons_in_one_tar_whatever_their_order(tmp_path: Path, mode: str) -> None:
    files = folders(top="nordland/")
    mixed = dict(sorted(files.items(), key=lambda item: item[0].rpartition("/")[2], reverse=True))
    summary, route = load(tar(tmp_path / "n.tar", mixed, mode))
    assert summary.linked == 0
    check(route, STEMS)


def test_one_archive_a_season_even_if_only_its_name_tells_which(tmp_path: Path) -> None:
    source = tmp_path / "copy"
    for season in SEASONS:
        top = "" if season == "winter" else f"{season}/"
        tar(source / f"data/{season}.tar.gz", {f"{top}images-{n:05d}.png": png(season, n) for n in STEMS.values()})
    check(load(source)[1], STEMS)
    with zipfile.ZipFile(tmp_path / "winter_full.zip", "w") as archive:
        archive.writestr("images-00001.png", png("winter", 1))
    _, route = load(tmp_path / "winter_full.zip")
    assert [traverse.name for traverse in route.traverses] == ["winter"]


def test_archives_beside_a_complete_copy_are_not_opened(tmp_path: Path) -> None:
    source = write(tmp_path / "nordland", folders())
    (source / "junk.zip").write_bytes(b"junk")
    summary, route = load(source)
    check(route, STEMS)
    assert any("Not read" in note and "junk.zip" in note for note in summary.notes)
    shutil.rmtree(source / "fall")
    assert "junk.zip" in refused(source)
    tar(source / "fall.tar.gz", {name: data for name, data in folders().items() if name.startswith("fall")})
    (source / "junk.zip").unlink()
    check(load(source)[1], STEMS)


def test_a_single_season_and_chosen_seasons(tmp_path: Path) -> None:
    source = write(tmp_path / "n", folders())
    assert list(load(source, seasons="winter, summer")[0].traverses) == ["summer", "winter"]
    (source / "fall").rename(tmp_path / "fall")
    assert [traverse.name for traverse in load(tmp_path / "fall")[1].traverses] == ["fall"]
    assert "holds fall, but not winter" in refused(tmp_path / "fall", seasons="fall,winter")


OLID = [("train", 1, 0), ("train", 1, 1), ("train", 2, 2), ("test", 1, 0), ("test", 1, 1), ("test", 2, 2)]


def olid(top: str = "Dataset_images/") -> dict[str, bytes]:
    return {
        f"{top}{split}/{season}_images_{split}/section{section}/{number}.png": png(
            season, number + 50 * (split == "test")
        )
        for season in SEASONS
        for split, section, number in OLID
    }


def olid_numbers(*splits: str) -> dict[str, int]:
    return {f"{split}-{part}-{n:05d}": n + 50 * (split == "test") for split, part, n in OLID if split in splits}


def test_the_olid_partition_keeps_train_and_test_apart(tmp_path: Path) -> None:
    source = write(tmp_path / "olid", olid())
    check(load(source)[1], olid_numbers("train", "test"))
    check(load(source, split="test")[1], olid_numbers("test"))
    check(load(source, split="train", form="olid")[1], olid_numbers("train"))


def test_the_olid_partition_in_archives(tmp_path: Path) -> None:
    source = tmp_path / "olid"
    for season in SEASONS:
        for split in ("train", "test"):
            top = f"{split}/{season}_images_{split}/"
            files = {name.removeprefix(top): data for name, data in olid("").items() if name.startswith(top)}
            tar(source / f"{season}_images_{split}.tar.gz", files)
    check(load(source)[1], olid_numbers("train", "test"))


def at(step: int, apart: float) -> dict[str, bytes]:
    name = "images/test/{0}/@0@{1:07.1f}@@@@@{2}@@@@@@@@.jpg"
    database = {name.format("database", number * apart, number): png("summer", number) for number in range(31)}
    return database | {name.format("queries", n * apart, n): png("winter", n) for n in range(0, 31, step)}


@pytest.mark.parametrize(("apart", "tolerance"), [(25 / 10.5, 10), (25 / 1.5, 1)])
def test_the_at_naming_tells_number_and_tolerance(tmp_path: Path, apart: float, tolerance: int) -> None:
    summary, route = load(write(tmp_path / "n", at(1, apart)))
    assert summary.tolerance == route.tolerance == tolerance
    check(route, {f"{number:05d}": number for number in range(31)})


def test_the_at_naming_with_every_tenth_query(tmp_path: Path) -> None:
    _, route = load(write(tmp_path / "n", at(10, 25 / 1.5)), database="fall", queries="spring")
    assert (len(route["fall"]), route["spring"].stems) == (31, ("00000", "00010", "00020", "00030"))
    truth = truth_by_position(route["spring"], route["fall"], route.tolerance or 0)
    assert truth.sum(axis=1).tolist() == [2, 3, 3, 2]


def parquet(path: Path, rows: list[dict[str, object]], names: bool = True, group: int = 3) -> None:
    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet

    table = pa.Table.from_pylist(rows)
    if names:
        features = {
            "season": {"names": ["fall", "spring", "summer", "winter"], "_type": "ClassLabel"},
            "section": {"names": ["train_section1", "train_section2", "test_section1", "test_section2"]},
        }
        table = table.replace_schema_metadata({"huggingface": json.dumps({"info": {"features": features}})})
    path.parent.mkdir(parents=True, exist_ok=True)
    pyarrow.parquet.write_table(table, path, row_group_size=group)


def olid_rows() -> list[dict[str, object]]:
    """Seasons come mixed, as numbers."""
    sections = ["train-1", "train-2", "test-1", "test-2"]
    return [
        {
            "image": {"bytes": png(season, number + 50 * (split == "test")), "path": f"{number}.png"},
            "season": ["fall", "spring", "summer", "winter"].index(season),
            "frame_id": number,
            "section": sections.index(f"{split}-{section}"),
        }
        for split, section, number in OLID
        for season in SEASONS
    ]


def test_parquet_files_whatever_the_order_of_their_rows(tmp_path: Path) -> None:
    rows = olid_rows()
    parquet(tmp_path / "p/data/train-00000-of-00002.parquet", rows[:13])
    parquet(tmp_path / "p/data/test-00000-of-00001.parquet", rows[13:])
    summary, route = load(tmp_path / "p")
    assert list(summary.traverses) == list(SEASONS)
    check(route, olid_numbers("train", "test"))
    check(load(tmp_path / "p", split="test", form="parquet")[1], olid_numbers("test"))


def test_parquet_with_seasons_as_text_and_plain_bytes(tmp_path: Path) -> None:
    rows = [{"picture": png(season, n), "season": season, "number": n} for season in SEASONS for n in (1, 2, 10)]
    parquet(tmp_path / "p.parquet", rows, names=False)  # type: ignore[arg-type]
    check(load(tmp_path / "p.parquet")[1], {f"{n:05d}": n for n in (1, 2, 10)})


def test_parquet_that_is_not_nordland(tmp_path: Path) -> None:
    path = tmp_path / "p.parquet"
    row = olid_rows()[0]
    parquet(path, [{"image": b"", "label": 1}])
    assert "has the columns image, label; it must have an image, a season and" in refused(path)
    parquet(path, [row, row])
    assert "which" in refused(path)
    assert "holds the frame train-1-00000 of spring" in refused(path)
    changes: list[tuple[dict[str, object], str]] = [
        ({"season": 9}, "does not say what season 9 is"),
        ({"frame_id": None}, "frame_id None, which is no frame"),
        ({"frame_id": -1}, "no frame"),
        ({"section": None}, "section 'None'"),
        ({"image": None}, "has the columns"),
        ({"image": {"bytes": None, "path": "x.png"}}, "holds no image for the frame train-1-00000"),
        ({"image": {"bytes": b"GIF8", "path": "x.png"}}, "no known format for the frame train-1-00000"),
    ]
    for change, message in changes:
        parquet(path, [row | change])
        assert message in refused(path)
    path.write_bytes(path.read_bytes()[:-20])
    assert "is damaged or no Parquet file" in refused(path)


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("table") / "p.parquet"
    parquet(path, olid_rows()[:4])
    return path.read_bytes()


@fuzzed(60)
@given(damage=DAMAGE)
def test_a_damaged_parquet_file_gives_frames_or_one_error(tmp_path: Path, table: bytes, damage: Damage) -> None:
    path = tmp_path / "p.parquet"
    path.write_bytes(damage.of(table))
    try:
        route = nordland.read(path, nordland.Options())
        assert sum(len(list(traverse.frames)) for traverse in route.traverses) <= 4
    except EverplaceError as error:
        assert "p.parquet" in str(error)
        assert len(str(error).splitlines()) == 1


def test_missing_extras_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package, file, extra in [("pyarrow", "a.parquet", "parquet"), ("av", "winter.mp4", "video")]:
        (tmp_path / file).write_bytes(b"")
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, package, None)
            with pytest.raises(MissingExtraError, match=rf"pip install 'everplace\[{extra}\]'"):
                load(tmp_path / file)


def video(path: Path, season: str, seconds: int, rate: int = 5) -> list[NDArray[np.uint8]]:
    """Writes a lossless video, 16×32 pixels, and returns its frames."""
    av = pytest.importorskip("av")
    rng = np.random.default_rng(SEASONS.index(season))
    frames = [rng.integers(0, 256, (16, 32, 3), dtype=np.uint8) for _ in range(seconds * rate)]
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=rate)
        stream.width, stream.height, stream.pix_fmt = 32, 16, "bgr0"
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())
    return frames


def test_videos_give_one_frame_a_second(tmp_path: Path) -> None:
    winter = video(tmp_path / "v/nordlandsbanen.vinter.mkv", "winter", 4)
    summer = video(tmp_path / "v/Nordland Summer.mkv", "summer", 3)
    summary, route = load(tmp_path / "v")
    assert summary.traverses == {"summer": 3, "winter": 4}
    assert route["winter"].stems == tuple(f"images-{number:05d}" for number in range(1, 5))
    for name, frames in [("winter", winter), ("summer", summer)]:
        for second, path in enumerate(route[name].paths):
            np.testing.assert_array_equal(decode_image(path, ImageSpec()), frames[5 * second])
    assert (route.root / "winter/times.csv").read_text().splitlines()[2] == "images-00002,1.0"
    _, small = load(tmp_path / "v", size="8x4", form="video", seasons="winter")
    np.testing.assert_array_equal(decode_image(small["winter"].paths[2], ImageSpec()), resize_image(winter[10], (4, 8)))


def test_damaged_and_nameless_videos_are_refused(tmp_path: Path) -> None:
    video(tmp_path / "v/winter.mkv", "winter", 3)
    shutil.copy(tmp_path / "v/winter.mkv", tmp_path / "v/ride.mkv")
    assert "tells no season" in refused(tmp_path / "v")
    (tmp_path / "v/ride.mkv").rename(tmp_path / "v/vinter.mkv")
    assert "both named after winter" in refused(tmp_path / "v")
    data = (tmp_path / "v/winter.mkv").read_bytes()
    for broken in (b"", b"no video", data[: len(data) // 2]):
        (tmp_path / "winter.mkv").write_bytes(broken)
        message = refused(tmp_path / "winter.mkv")
        assert "winter.mkv" in message
        assert "again" in message


def test_a_video_with_a_gap_is_refused(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    with av.open(str(tmp_path / "winter.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=5)
        stream.width, stream.height, stream.pix_fmt = 32, 16, "bgr0"
        for tick in (*range(10), *range(40, 50)):
            frame = av.VideoFrame.from_ndarray(np.zeros((16, 32, 3), np.uint8), format="rgb24")
            frame.pts, frame.time_base = tick, Fraction(1, 5)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    assert "has a gap of several seconds at second 2" in refused(tmp_path / "winter.mkv")


def test_a_video_that_claims_to_last_for_ever_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    video(tmp_path / "winter.mkv", "winter", 3)
    monkeypatch.setattr(_nordland_video, "_LONGEST", 2)
    assert "winter.mkv claims to be 2.8 seconds long" in refused(tmp_path / "winter.mkv")


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("film") / "winter.mkv"
    video(path, "winter", 3)
    return path.read_bytes()


@fuzzed(40)
@given(damage=DAMAGE)
def test_a_damaged_film_gives_its_seconds_or_one_error(tmp_path: Path, film: bytes, damage: Damage) -> None:
    path = tmp_path / "winter.mkv"
    path.write_bytes(damage.of(film))
    try:
        (traverse,) = nordland.read(path, nordland.Options()).traverses
        frames = list(traverse.frames)
    except EverplaceError as error:
        assert "winter.mkv" in str(error)
        assert "\n" not in str(error)
    else:
        assert [frame.stem for frame in frames] == [f"images-{number + 1:05d}" for number in range(len(frames))]
        assert len(frames) == traverse.count
        assert all(isinstance(frame.content, np.ndarray) for frame in frames)


def test_size_is_for_every_form(tmp_path: Path) -> None:
    source = write(tmp_path / "n", folders())
    for path in (source, tar(tmp_path / "n.tar", folders())):
        summary, route = load(path, size="4x2")
        assert summary.linked == 0
        expected = resize_image(pixels("winter", 10), (2, 4))
        np.testing.assert_array_equal(decode_image(route["winter"].paths[2], ImageSpec()), expected)
    with pytest.raises(ConfigError, match="`size`=64 cannot be: it is not WIDTHxHEIGHT"):
        load(source, size="64")


def test_a_list_joins_by_name(tmp_path: Path) -> None:
    source = write(tmp_path / "n", folders((1, 2, 3, 10)))
    for text in (
        "images-00010.png\nimages-00002.png\n",
        "# kept\n\nimages-00010.jpg\r\nimages-00002.jpg",
        "\ufeffx/images-00002\nimages-00010",
    ):
        (tmp_path / "kept.txt").write_text(text, encoding="utf-8")
        _, route = load(source, list=str(tmp_path / "kept.txt"))
        assert {traverse.stems for traverse in route.traverses} == {("images-00002", "images-00010")}
    np.save(tmp_path / "kept.npy", np.array(["summer/images-00001.png", "winter/images-00010.png"]))
    _, route = load(source, list=str(tmp_path / "kept.npy"), seasons="summer,winter")
    assert (route["summer"].stems, route["winter"].stems) == (("images-00001",), ("images-00010",))


def test_each_season_may_have_its_own_list(tmp_path: Path) -> None:
    source = write(tmp_path / "n", folders())
    (tmp_path / "names_summer.txt").write_text("images-00001.png")
    (tmp_path / "names_winter.txt").write_text("images-00002.png\nimages-00010.png")
    lists = f"{tmp_path}/names_summer.txt,{tmp_path}/names_winter.txt"
    _, route = load(source, list=lists, seasons="summer,winter")
    assert (route["summer"].stems, route["winter"].stems) == (("images-00001",), ("images-00002", "images-00010"))
    assert "no list names a frame of spring" in refused(source, list=lists)


def test_lists_that_cannot_be(tmp_path: Path) -> None:
    source = write(tmp_path / "n", folders())
    path = tmp_path / "kept.txt"
    assert "cannot read the list" in refused(source, list=str(path))
    for data, message in [
        (b"images-00001.png\nimages-00099.png\n", "lacks 1 of the 2 frames .* the first is 'images-00099'"),
        (b"images-00001.png\nimages-00001.jpg\n", "names 'images-00001' twice"),
        (b"\n# nothing\n", "names no frame"),
        (b"\xff\xfe\x00", "is not UTF-8"),
    ]:  # fmt: skip
        path.write_bytes(data)
        with pytest.raises(RouteError, match=message):
            load(source, list=str(path))
    for array, message in [
        (np.arange(5), "holds int64, not names; frames are joined by name, never by position"),
        (np.array([{"a": 1}], dtype=object), "no .npy array of texts .*Python objects"),
    ]:
        np.save(tmp_path / "kept.npy", array, allow_pickle=True)
        with pytest.raises(RouteError, match=message):
            load(source, list=str(tmp_path / "kept.npy"))


@fuzzed(50)
@given(
    names=st.lists(st.text("ab/.#-01\\ é", min_size=1, max_size=9), max_size=6),
    as_npy=st.booleans(),
    damage=st.lists(st.tuples(st.floats(0, 1), st.integers(1, 255)), max_size=3),
)
def test_a_damaged_list_gives_names_or_one_error(
    tmp_path: Path, names: list[str], as_npy: bool, damage: list[tuple[float, int]]
) -> None:
    path = tmp_path / ("x.npy" if as_npy else "x.txt")
    if as_npy:
        np.save(path, np.array(names))
    else:
        path.write_text("\n".join(names), encoding="utf-8")
    data = bytearray(path.read_bytes())
    for where, mask in damage if data else []:
        data[int(where * (len(data) - 1))] ^= mask
    path.write_bytes(data)
    try:
        assert len(read_list(path)) > 0
    except EverplaceError as error:
        assert "\n" not in str(error)


@settings(max_examples=30, deadline=None)
@given(kept=st.sets(st.integers(1, 30), min_size=1), order=st.randoms(use_true_random=False))
def test_the_order_of_a_list_does_not_matter(
    tmp_path_factory: pytest.TempPathFactory, kept: set[int], order: object
) -> None:
    root = tmp_path_factory.mktemp("list")
    lines = [f"images-{number:05d}.png" for number in kept]
    order.shuffle(lines)  # type: ignore[attr-defined]
    (root / "l.txt").write_text("\n".join(lines))
    assert {frame.stem for frame in read_list(root / "l.txt")} == {f"images-{number:05d}" for number in kept}


def numbered(count: int) -> list[str]:
    return [f"images-{number:05d}" for number in range(count)]


def test_presets_choose_what_they_say() -> None:
    full = {season: numbered(27_592) for season in ("summer", "winter")}
    assert choose_frames("27592", full) == full
    chosen = choose_frames("2760", full)
    assert chosen["winter"] == full["winter"]
    assert len(chosen["summer"]) == 2_760
    assert chosen["summer"] == full["winter"][::10]
    assert choose_frames("2760", {"summer": chosen["summer"], "winter": full["winter"]}) == chosen
    test = {"fall": numbered(3_450)}
    assert choose_frames("olid", test) == test
    paper = choose_frames("paper", {"summer": numbered(20_000), "winter": numbered(16_000)})
    assert paper["summer"] == paper["winter"] == numbered(16_000)[::2]


@pytest.mark.parametrize(
    ("preset", "stems", "message"),
    [
        ("27592", {"summer": numbered(27_591)}, "needs 27592 frames a season, but summer has 27591; name the list"),
        ("olid", {"summer": numbered(3_450), "fall": numbered(5)}, "but fall has 5; give the whole test split"),
        ("2760", {"winter": numbered(27_592)}, "needs summer and winter, but there is only winter"),
        ("2760", {"summer": numbered(27_580), "winter": numbered(27_592)}, "asks for 'images-27580' of summer"),
        ("2760", {"summer": numbered(27_592), "winter": numbered(9)}, "but winter has 9"),
        ("paper", {"summer": numbered(7_999)}, "needs 8000 frames that all seasons share, but there are 7999"),
    ],
)
def test_presets_refuse_incomplete_copies(preset: str, stems: dict[str, list[str]], message: str) -> None:
    with pytest.raises(RouteError, match=message):
        choose_frames(preset, stems)


def test_a_preset_is_named_in_the_route(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_nordland_presets, "_FULL", 25)  # the protocols are the same on a shorter journey
    both = {f"{season}/images-{n:05d}.png": png(season, n) for season in ("summer", "winter") for n in range(30)}
    tar(tmp_path / "copy/data/both.tar", both)
    names = [f"images-{number:05d}" for number in range(3, 30) if number not in (7, 8)]
    write(tmp_path / "copy/dataset_imageNames", {"nordland_imageNames.txt": ".png\n".join([*names, ""]).encode()})
    summary, route = load(tmp_path / "copy", preset="2760")
    assert (summary.tolerance, route.tolerance) == (1, 1)
    assert summary.protocol == route.protocol == "Nordland 2,760 summer queries against 27,592 winter frames, ±1"
    assert "nordland_imageNames.txt was used" in summary.notes[1]
    assert route["winter"].stems == tuple(names)
    assert route["summer"].stems == ("images-00003", "images-00015", "images-00025")
    assert truth_by_position(route["summer"], route["winter"], 1).sum(axis=1).tolist() == [2, 3, 3]
    copy = tmp_path / "copy/data"
    summary, _ = load(copy, preset="27592")
    assert (summary.tolerance, summary.traverses) == (10, {"summer": 25, "winter": 25})
    assert summary.notes[0] in (copy.parent / "data").parent.joinpath("out/route.toml").read_text()


def test_the_papers_preset_wants_frames_without_tunnels_and_stops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("_FULL", 9), ("_PAPER_TRAIN", 2), ("_PAPER_TEST", 4)):
        monkeypatch.setattr(_nordland_presets, name, value)
    source = write(tmp_path / "n", folders(range(12)))
    told = refused(source, preset="paper")
    assert "needs the list of the 9 frames without tunnels and stops, but there is none and spring has 12;" in told
    assert told.endswith("name it with `list=FILE`, or take all with `unfiltered=true`")
    protocol = "Nordland 1,600 training and 6,400 test frames a season, ±1"
    summary, route = load(source, preset="paper", unfiltered="true")
    assert summary.protocol == route.protocol == f"{protocol}, tunnels and stops not left out"
    assert "No list was used: tunnels and stops take part." in summary.notes
    assert route["winter"].stems == tuple(f"images-{number:05d}" for number in range(0, 12, 2))
    write(tmp_path, {"eight.txt": "".join(f"images-{number:05d}.png\n" for number in range(3, 11)).encode()})
    summary, route = load(source, preset="paper", list=str(tmp_path / "eight.txt"))
    assert summary.protocol == f"{protocol}, by a list of 8 frames"
    assert route["winter"].stems == tuple(f"images-{number:05d}" for number in (3, 4, 5, 7, 8, 9))
    write(source, {"cleanImageNames.txt": "".join(f"images-{number:05d}.png\n" for number in range(2, 11)).encode()})
    summary, route = load(source, preset="paper")
    assert summary.protocol == route.protocol == protocol
    assert any("cleanImageNames.txt was used" in note for note in summary.notes)
    whole = write(tmp_path / "w", folders(range(9)))
    assert load(whole, preset="paper")[0].protocol == protocol
    for options in ({"preset": "2760"}, {"preset": "paper", "list": str(tmp_path / "eight.txt")}, {}):
        with pytest.raises(ConfigError, match="unfiltered=true is for preset paper without a list"):
            load(source, unfiltered="true", **options)


def test_olid_preset_is_about_the_test_split(tmp_path: Path) -> None:
    source = write(tmp_path / "olid", olid())
    assert "but spring has 3" in refused(source, preset="olid")
    with pytest.raises(ConfigError, match="preset olid is about the test split"):
        load(source, preset="olid", split="train")


def test_sources_that_are_not_nordland(tmp_path: Path) -> None:
    (tmp_path / "n").mkdir()
    assert "holds no image" in refused(tmp_path / "n")
    source = write(tmp_path / "n", {"day/1.png": b"x"})
    assert "in no known form: no directory or archive is named after a season" in refused(source)
    assert "in no form olid" in refused(write(tmp_path / "s", folders()), form="olid")
    assert "holds no file that ends in .parquet" in refused(source, form="parquet")
    (tmp_path / "x.bin").write_bytes(b"")
    assert "neither a directory nor a tar or zip archive" in refused(tmp_path / "x.bin")


def test_the_same_frame_twice_is_refused(tmp_path: Path) -> None:
    source = write(tmp_path / "n", {"winter/1.png": b"x", "winter/1.jpg": b"x"})
    assert f"{source}/winter/1.jpg and {source}/winter/1.png are the same frame of winter twice" in refused(source)
    (source / "winter/1.jpg").unlink()
    tar(source / "winter.tar.gz", {"1.png": b"x"})
    assert "winter/1.png and " in refused(source)
    assert f"{source}/winter.tar.gz/1.png are the same" in refused(source)


@pytest.mark.parametrize(
    ("text", "season"),
    [
        ("winter", "winter"), ("Summer_64x32", "summer"), ("nordlandsbanen.vinter.1080", "winter"), ("autumn", "fall"),
        ("høst", "fall"), ("springfield", ""), ("waterfall", ""), ("night", ""), ("spring2013", "spring"),
    ],
)  # fmt: skip
def test_seasons_are_words(text: str, season: str) -> None:
    assert season_of(text) == season


def test_the_real_seasons(shared_data: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    summary = import_route("nordland", shared_data / "nordland64", out)
    assert summary.traverses == {"summer": 2384, "winter": 2384}
    linked = tmp_path.stat().st_dev == shared_data.stat().st_dev
    assert summary.linked == (4768 if linked else 0)
    given_route, imported = open_route(shared_data / "nordland64"), open_route(out)
    assert imported.shared_stems() == given_route.shared_stems()
    path = imported["winter"].paths[1234]
    original = given_route["winter"].paths[1234]
    assert path.resolve() == original.resolve() if linked else path.read_bytes() == original.read_bytes()
