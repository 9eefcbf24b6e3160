"""Data sets of the conventions in archives: what is imported is what the unpacked directory gives, byte for byte."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import h5py
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fuzzing import DAMAGE, Damage, fuzzed
from tests.importing.packing import FORMS, pack, pack_files
from tests.importing.sources import (
    test_euroc,
    test_kapture,
    test_kitti,
    test_ms2,
    test_openseqslam2,
    test_tum,
    test_vpr,
    test_vprbench,
)

from everplace.errors import EverplaceError, RouteError
from everplace.importing.foreign_route import Encoded
from everplace.importing.import_route import import_route
from everplace.importing.kinds import open_kind
from everplace.importing.sources import euroc, hloc, kitti, vpr, vprbench


def write_vpr(data_set: Any) -> None:
    test_vpr.write(data_set)
    data_set.images("images/val/queries", ["@1@2@.jpg"])


def write_vprbench(data_set: Any) -> None:
    test_vprbench.write(data_set, test_vprbench.MATCHES, references=12)


def write_euroc(data_set: Any) -> None:
    test_euroc.write(data_set)
    test_euroc.write(data_set, "V1_02", frames=2)


def write_tum(data_set: Any) -> None:
    test_tum.write(data_set, "desk2")
    test_tum.write(data_set, "desk10", frames=3)


def write_kitti(data_set: Any) -> None:
    test_kitti.write(data_set)
    test_kitti.write(data_set, "05", (0, 1, 3))


def write_kapture(data_set: Any) -> None:
    for where, camera in (("mapping", "cam0"), ("query", "cam1")):
        poses = [f"{index}, {camera}, {test_kapture.world_to((index, 2.0, 0.0), 5.0)}" for index in range(12)]
        test_kapture.write(data_set, where, [f"{index}, {camera}, night/{index}.jpg" for index in range(12)], poses)


def write_openseqslam2(data_set: Any) -> None:
    test_openseqslam2.write(data_set, ["1,1,2", "2,4,0"])


def write_hloc(data_set: Any) -> None:
    data_set.images("images", ["db/1.jpg", "db/2.jpg", "db/10.jpg", "q.jpg"])
    data_set.text("pairs.txt", ["q.jpg db/2.jpg"])
    with h5py.File(data_set.root / "feats.h5", "w") as file:
        for image in ("db/1.jpg", "db/2.jpg", "db/10.jpg"):
            file.create_group(image)["keypoints"] = [1.0]


def write_ms2(data_set: Any) -> None:
    test_ms2.write_drive(data_set.root, test_ms2.DAY, 3)
    test_ms2.write_drive(data_set.root, test_ms2.NIGHT, 2, swapped=True)


KINDS: dict[str, tuple[Callable[[Any], None], dict[str, str]]] = {
    "vpr": (write_vpr, {}),
    "vprbench": (write_vprbench, {}),
    "euroc": (write_euroc, {"radius": "2"}),
    "tum": (write_tum, {"limit": "0.3"}),
    "kitti": (write_kitti, {"radius": "25"}),
    "kapture": (write_kapture, {}),
    "openseqslam2": (write_openseqslam2, {}),
    "hloc": (write_hloc, {"images": "images", "database": "feats.h5"}),
    "ms2": (write_ms2, {}),
}


def imported(kind: str, source: Path, **options: str) -> dict[str, bytes]:
    """Imports into a route of its own and returns all its files."""
    out = source.parent / "out"
    shutil.rmtree(out, ignore_errors=True)
    import_route(kind, source, out, options)
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("kind", KINDS)
def test_an_archive_gives_the_route_of_its_directory(data_set: Any, tmp_path: Path, kind: str) -> None:
    write, options = KINDS[kind]
    write(data_set)
    expected = imported(kind, data_set.root, **options)
    assert {name.rpartition("/")[2] for name in expected} > {"route.toml"}
    for form, top in [*((form, "") for form in FORMS[:3]), ("zip", "set/"), ("tgz", "./set/"), ("tar", "set/copy/")]:
        archive = pack(data_set.root, tmp_path / "packed" / f"set.{form}", top)
        assert imported(kind, archive, **options) == expected, (form, top)
        archive.unlink()


def test_one_sequence_is_called_after_its_directory_or_archive(data_set: Any, tmp_path: Path) -> None:
    test_tum.write(data_set, "desk", poses=4)
    for name, top in (("desk.tgz", ""), ("other.tar.gz", "desk/")):
        archive = pack(data_set.root / "desk", tmp_path / name, top)
        assert imported("tum", archive, limit="0.3") == imported("tum", data_set.root / "desk", limit="0.3")
    test_euroc.write(data_set, "MH_01")
    archive = pack(data_set.root / "MH_01", tmp_path / "MH_01.zip")
    assert imported("euroc", archive) == imported("euroc", data_set.root / "MH_01")


def test_each_archive_of_a_directory_may_be_a_sequence(data_set: Any, tmp_path: Path) -> None:
    for kind in ("euroc", "tum"):
        write, options = KINDS[kind]
        write(data_set)
        sequences = [path for path in data_set.root.iterdir() if path.is_dir()]
        expected = imported(kind, data_set.root, **options)
        for sequence, form in zip(sequences, ("zip", "tar.xz"), strict=True):
            pack(sequence, tmp_path / kind / f"{sequence.name}.{form}")
            shutil.rmtree(sequence)
        assert imported(kind, tmp_path / kind, **options) == expected


def test_the_archives_of_a_directory_make_one_data_set(data_set: Any, tmp_path: Path) -> None:
    write_kitti(data_set)
    for sequence in ("00", "05"):
        data_set.text(f"sequences/{sequence}/calib.txt", ["P0: 1"])
    expected = imported("kitti", data_set.root, radius="25")
    downloads = tmp_path / "downloads"
    pack(data_set.root, downloads / "data_odometry_gray.zip", "dataset/", lambda name: name.startswith("sequences"))
    pack(data_set.root, downloads / "data_odometry_poses.zip", "dataset/", lambda name: name.startswith("poses"))
    # KITTI's archives hold the same time stamps several times, and calibrations that differ.
    times = [(f"dataset/sequences/{one}/times.txt", (data_set.root / "sequences" / one / "times.txt").read_bytes())
             for one in ("00", "05")]  # fmt: skip
    pack_files(downloads / "data_odometry_calib.zip", [*times, ("dataset/sequences/00/calib.txt", b"P0: 1\nTr: 2\n")])
    assert imported("kitti", downloads, radius="25") == expected
    pack_files(downloads / "other.tar", [(times[0][0], b"0.0\n0.2\n")])
    with pytest.raises(RouteError, match=r"data_odometry_calib\.zip and .*gray\.zip both hold '.*00/times\.txt'"):
        imported("kitti", downloads)
    (downloads / "other.tar").unlink()
    pack_files(downloads / "other.tar", [("dataset/sequences/00/image_0/000001.png", b"other")])
    with pytest.raises(RouteError, match=r"gray\.zip and .*other\.tar both hold '.*000001\.png'; keep one"):
        imported("kitti", downloads)


def test_the_sides_of_a_set_may_lie_in_archives_of_their_own(data_set: Any, tmp_path: Path) -> None:
    write_vpr(data_set)
    expected = imported("vpr", data_set.root)
    pack(data_set.root / "images/test/database", tmp_path / "parts/database.tar", "test/database/")
    pack(data_set.root / "images/test/queries", tmp_path / "parts/queries.zip", "test/queries/")
    assert imported("vpr", tmp_path / "parts") == expected


def test_what_is_unpacked_counts_before_an_archive_beside_it(data_set: Any) -> None:
    write_vprbench(data_set)
    (data_set.root / "old.zip").write_bytes(b"PK\3\4 damaged")
    summary = import_route("vprbench", data_set.root, data_set.root.parent / "out")
    assert summary.linked == summary.frames == 15
    assert any("Not read" in note and "old.zip" in note for note in summary.notes)
    (data_set.root / "more").mkdir()
    (data_set.root / "more/loop").symlink_to("loop")
    summary = import_route("vprbench", data_set.root, data_set.root.parent / "second")
    assert summary.frames == 15
    assert any("not searched: cannot follow the link" in note and "more/loop" in note for note in summary.notes)


@pytest.mark.parametrize("kind", ["euroc", "tum"])
def test_sequences_at_all_depths_are_read_unpacked_or_not(data_set: Any, tmp_path: Path, kind: str) -> None:
    module: Any = {"euroc": test_euroc, "tum": test_tum}[kind]
    for name in ("a10", "a9", "b", "c"):
        module.write(data_set, name)
    expected = imported(kind, data_set.root, limit="0.3")
    mixed = tmp_path / "mixed"
    pack(data_set.root / "a9", mixed / "a9.zip")
    pack(data_set.root / "a10", mixed / "other.tgz", "a10/")
    pack(data_set.root / "b", mixed / "deeper/b.tar")
    shutil.copytree(data_set.root / "c", mixed / "one/two/c")
    assert imported(kind, mixed, limit="0.3") == expected
    pack(data_set.root / "c", mixed / "c.zip")  # what was fetched, left beside what was unpacked from it
    again = imported(kind, mixed, limit="0.3")
    assert {**again, "route.toml": expected["route.toml"]} == expected
    summary = import_route(kind, mixed, tmp_path / "noted", {"limit": "0.3"})
    assert any("c.zip holds c too, which is unpacked" in note for note in summary.notes)
    pack(data_set.root / "b", mixed / "again.zip", "b/")
    with pytest.raises(RouteError, match=r"again\.zip/b and .*b\.tar would both be the sequence b; keep one of them"):
        imported(kind, mixed, limit="0.3")


def test_archives_beside_unpacked_sequences_are_named(data_set: Any) -> None:
    write_kitti(data_set)
    pack(data_set.root / "poses", data_set.root / "data_odometry_poses.zip", "dataset/poses/")
    shutil.rmtree(data_set.root / "poses")
    summary = import_route("kitti", data_set.root, data_set.root.parent / "out")
    assert any("Not read" in note and "data_odometry_poses.zip" in note for note in summary.notes)


@pytest.mark.parametrize("kind", KINDS)
def test_a_compressed_archive_is_read_once_for_each_drive_and_once_to_list_it(
    data_set: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    passes = []

    class Counted(gzip.GzipFile):
        def __init__(self, *arguments: Any, **named: Any) -> None:
            passes.append(1)
            super().__init__(*arguments, **named)

    write, options = KINDS[kind]
    write(data_set)
    archive = pack(data_set.root, tmp_path / "set.tar.gz")
    monkeypatch.setattr(gzip, "GzipFile", Counted)
    imported(kind, archive, **options)
    assert len(passes) == 1 + 2


@pytest.mark.parametrize("form", ["zip", "tar.gz"])
def test_messages_name_the_member(data_set: Any, tmp_path: Path, form: str) -> None:
    write_kitti(data_set)
    data_set.text("poses/00.txt", ["1 2 3"])
    with pytest.raises(RouteError, match=rf"set\.{form}/poses/00\.txt, line 1 has 3 fields"):
        kitti.read(pack(data_set.root, tmp_path / f"set.{form}"), kitti.Options())
    data_set.images("images/test/database", ["plain.jpg"])
    data_set.images("images/test/queries", ["@1@2@.jpg"])
    with pytest.raises(RouteError, match=rf"set\.{form}/images/test/database/plain\.jpg is not of the form"):
        vpr.read(pack(data_set.root, tmp_path / f"set.{form}"), vpr.Options())
    write_vprbench(data_set)
    with pytest.raises(RouteError, match=rf"set\.{form}/ground_truth_new\.npy is not a whole"):
        (data_set.root / "ground_truth_new.npy").write_bytes(b"x")
        vprbench.read(pack(data_set.root, tmp_path / f"set.{form}"), vprbench.Options())
    write_hloc(data_set)
    (data_set.root / "images/q.jpg").unlink()
    (data_set.root / "feats.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    archive = pack(data_set.root, tmp_path / f"set.{form}")
    with pytest.raises(RouteError, match=rf"set\.{form}/images/q\.jpg does not exist, but .*pairs\.txt or a list"):
        [list(one.frames) for one in hloc.read(archive, hloc.Options(images="images")).traverses]
    with pytest.raises(RouteError, match=rf"set\.{form}/feats\.h5 is not a readable HDF5 file"):
        hloc.read(archive, hloc.Options(database="feats.h5"))


def test_what_is_missing_in_an_archive_is_said(data_set: Any, tmp_path: Path) -> None:
    test_euroc.write(data_set)
    (data_set.root / "MH_01/mav0/cam0/sensor.yaml").unlink()
    archive = pack(data_set.root, tmp_path / "set.zip")
    with pytest.raises(RouteError, match=r"set\.zip/MH_01/mav0/cam0/sensor\.yaml, which says how the camera"):
        euroc.read(archive, euroc.Options())
    for kind, message in [
        ("vpr", "set.zip holds no images/test .* give the directory above images"),
        ("vprbench", "set.zip/query does not exist"),
        ("tum", "neither .*set.zip nor a directory in it holds rgb.txt"),
        ("openseqslam2", "set.zip/query does not exist"),
        ("hloc", r"cannot read .*set.zip/pairs\.txt: No such file"),
        ("ms2", "set.zip holds no sync_data/<sequence>/rgb"),
    ]:
        module = open_kind(kind)
        with pytest.raises(RouteError, match=message):
            module.read(archive, module.Options())


def test_two_data_sets_are_not_mixed(data_set: Any, tmp_path: Path) -> None:
    write_vprbench(data_set)
    files = [(path.relative_to(data_set.root).as_posix(), path.read_bytes()) for path in data_set.root.rglob("*.*")]
    archive = pack_files(tmp_path / "a.zip", [(f"{top}/{name}", data) for top in ("b", "c") for name, data in files])
    with pytest.raises(
        RouteError, match=r"a\.zip/b and .*a\.zip/c both hold query and ref; unpack the archive and give one"
    ):
        vprbench.read(archive, vprbench.Options())


@pytest.mark.parametrize("kind", ["vpr", "vprbench", "kitti"])
@pytest.mark.parametrize("form", ["zip", "tar.gz"])
def test_an_archive_that_leads_outside_is_refused_and_nothing_is_written(
    data_set: Any, tmp_path: Path, kind: str, form: str
) -> None:
    KINDS[kind][0](data_set)
    files = [(path.relative_to(data_set.root).as_posix(), path.read_bytes()) for path in data_set.root.rglob("*.*")]
    inside = tmp_path / "inside"
    archive = pack_files(inside / f"set.{form}", [*files, ("images/test/../../../evil.jpg", b"x")])
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(RouteError, match=r"holds the member images/test/\.\./\.\./\.\./evil\.jpg, which leads outside"):
        import_route(kind, archive, inside / "route")
    assert sorted(tmp_path.rglob("*")) == before


@fuzzed(40)
@given(
    kind=st.sampled_from(["vpr", "vprbench"]),
    form=st.sampled_from(["zip", "tar", "tar.gz"]),
    damage=DAMAGE,
)
def test_a_damaged_archive_gives_all_frames_or_one_error(
    data_set: Any, tmp_path: Path, kind: str, form: str, damage: Damage
) -> None:
    whole = tmp_path / f"{kind}-whole.{form}"
    if not whole.exists():
        shutil.rmtree(data_set.root)
        data_set.root.mkdir()
        KINDS[kind][0](data_set)
        pack(data_set.root, whole)
    path = tmp_path / f"damaged.{form}"
    path.write_bytes(damage.of(whole.read_bytes()))
    module = open_kind(kind)
    try:
        route = module.read(path, module.Options())
        frames = [frame for one in route.traverses for frame in one.frames]
        pairs = list(route.truth or ())
    except EverplaceError as error:
        assert path.name in str(error)
        assert "\n" not in str(error)
    else:
        assert 0 < len(frames) <= 15
        assert all(frame.stem for frame in frames)
        assert {pair.query for pair in pairs} <= {frame.stem for frame in frames}
        assert all(isinstance(frame.content, Encoded) for frame in frames)


@fuzzed(60)
@given(
    names=st.lists(st.text("@./1q-ré", min_size=1, max_size=9), max_size=5),
    top=st.sampled_from(["", "a/b/"]),
    module=st.sampled_from([vpr, vprbench]),
)
def test_any_names_in_an_archive_give_a_route_or_one_error(
    tmp_path: Path, names: list[str], top: str, module: ModuleType
) -> None:
    files = [(f"{top}{side}/{name}.jpg", b"x") for side in ("query", "ref", "database", "queries") for name in names]
    path = pack_files(tmp_path / "a.zip", files)
    try:
        for one in module.read(path, module.Options()).traverses:
            stems = [frame.stem for frame in one.frames]
            assert len(set(stems)) == len(stems) == one.count
    except EverplaceError as error:
        assert "a.zip" in str(error)
        assert "\n" not in str(error)
