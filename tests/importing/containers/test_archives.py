from __future__ import annotations

import gzip
import io
import os
import stat
import struct
import tarfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fuzzing import fuzzed
from tests.importing.packing import pack_files

from everplace.errors import EverplaceError, RouteError
from everplace.images.decoding import MAX_FILE_BYTES
from everplace.importing.containers import archives
from everplace.importing.containers.archives import (
    Member,
    archive_label,
    is_archive_name,
    read_members,
    scan_members,
)

FILES = {"a/1.png": b"one", "a/2.png": b"", "b/deep/3.png": bytes(range(256)) * 40}


def tar(path: Path, files: Mapping[str, bytes], mode: str = "w", kind: int = tarfile.PAX_FORMAT) -> Path:
    with tarfile.open(path, mode, format=kind) as archive:  # type: ignore[call-overload]
        for name, data in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
    return path


def zipped(path: Path, files: Mapping[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def list_members(path: Path) -> list[Member]:
    return [member for member, _ in scan_members(path)]


def refused(path: Path) -> str:
    with pytest.raises(RouteError) as caught:
        list_members(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("mode", ["w", "w:gz", "w:bz2", "w:xz"])
@pytest.mark.parametrize("kind", [tarfile.PAX_FORMAT, tarfile.GNU_FORMAT, tarfile.USTAR_FORMAT])
def test_reads_what_a_tar_holds(tmp_path: Path, mode: str, kind: int) -> None:
    path = tar(tmp_path / "a.tar", FILES, mode, kind)
    assert list_members(path) == [Member(name, len(data)) for name, data in FILES.items()]
    assert dict(read_members(path, ["b/deep/3.png", "a/2.png"])) == {name: FILES[name] for name in list(FILES)[1:]}


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_reads_what_a_zip_holds(tmp_path: Path, method: int) -> None:
    path = zipped(tmp_path / "a.zip", FILES, method)
    assert list_members(path) == [Member(name, len(data)) for name, data in FILES.items()]
    assert dict(read_members(path, FILES)) == FILES


def test_names_lose_dots_and_long_names_are_whole(tmp_path: Path) -> None:
    long = "d" * 150 + "/" + "é" * 60 + ".png"
    path = tar(tmp_path / "a.tar", {"./summer/./1.png": b"1", long: b"2"})
    assert [member.name for member in list_members(path)] == ["summer/1.png", long]


def test_directories_are_left_out_and_links_to_inside_say_where_they_lead(tmp_path: Path) -> None:
    path = tmp_path / "a.tar"
    with tarfile.open(path, "w") as archive:
        for name, kind, target in [
            ("summer", tarfile.DIRTYPE, ""),
            ("summer/link.png", tarfile.SYMTYPE, "../winter/1.png"),
            ("summer/hard.png", tarfile.LNKTYPE, "winter/1.png"),
        ]:
            info = tarfile.TarInfo(name)
            info.type, info.linkname = kind, target
            archive.addfile(info)
    assert list_members(path) == [Member(f"summer/{name}.png", 0, "winter/1.png") for name in ("link", "hard")]
    with pytest.raises(RouteError, match=r"no longer holds summer/link\.png"):
        list(read_members(path, ["summer/link.png"]))


@pytest.mark.parametrize("name", ["../up.png", "a/../../up.png", "/etc/x.png", "C:\\x.png", "a\\..\\..\\x.png"])
def test_a_member_that_leads_outside_is_refused_by_name(tmp_path: Path, name: str) -> None:
    for path in (
        tar(tmp_path / "a.tar", {"fine.png": b"1", name: b"2"}),
        zipped(tmp_path / "a.zip", {"fine.png": b"1", name: b"2"}),
    ):
        assert repr(name)[1:-1] in refused(path)


@pytest.mark.parametrize(
    ("name", "kind", "target"),
    [
        ("a/link.png", tarfile.SYMTYPE, "/etc/passwd"),
        ("a/link.png", tarfile.SYMTYPE, "../../x"),
        ("a/link.png", tarfile.LNKTYPE, "../x"),
        ("pipe", tarfile.FIFOTYPE, ""),
        ("disk", tarfile.BLKTYPE, ""),
        ("tty", tarfile.CHRTYPE, ""),
    ],
)
def test_links_to_outside_and_devices_are_refused_by_name(tmp_path: Path, name: str, kind: bytes, target: str) -> None:
    path = tmp_path / "a.tar"
    with tarfile.open(path, "w") as archive:
        info = tarfile.TarInfo(name)
        info.type, info.linkname = kind, target
        archive.addfile(info)
    assert name in refused(path)


@pytest.mark.parametrize(("mode", "target"), [(stat.S_IFLNK, "../../x"), (stat.S_IFIFO, ""), (stat.S_IFBLK, "")])
def test_a_zip_with_links_to_outside_or_devices_is_refused(tmp_path: Path, mode: int, target: str) -> None:
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        info = zipfile.ZipInfo("a/odd.png")
        info.create_system, info.external_attr = 3, (mode | 0o644) << 16
        archive.writestr(info, target)
    assert "a/odd.png" in refused(path)


@pytest.mark.parametrize("mode", ["w", "w:gz", "w:bz2", "w:xz"])
def test_a_truncated_tar_is_an_error_wherever_it_ends(tmp_path: Path, mode: str) -> None:
    whole = tar(tmp_path / "whole.tar", FILES, mode).read_bytes()
    path = tmp_path / "a.tar"
    end = len(whole) - 1 if mode != "w" else 512 * (2 + 1 + 1 + 1 + 20)  # up to where the end mark begins
    for length in sorted({*range(0, end, max(1, end // 60)), *range(0, end, 512), end - 1}):
        path.write_bytes(whole[:length])
        assert "truncated or damaged" in refused(path)


def test_a_damaged_header_is_not_the_end(tmp_path: Path) -> None:
    path = tar(tmp_path / "a.tar", FILES, kind=tarfile.USTAR_FORMAT)
    data = bytearray(path.read_bytes())
    data[1024 + 3] ^= 1  # in the name of the second member: its checksum fails
    path.write_bytes(data)
    assert "after the member a/1.png" in refused(path)


def test_a_flipped_bit_in_a_compressed_tar_is_noticed(tmp_path: Path) -> None:
    path = tar(tmp_path / "a.tar.gz", FILES, "w:gz")
    data = bytearray(path.read_bytes())
    data[-6] ^= 1  # in gzip's checksum, behind the end mark
    path.write_bytes(data)
    assert "truncated or damaged" in refused(path)


def test_a_flipped_bit_in_a_zip_is_noticed_with_the_member(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.zip", FILES, zipfile.ZIP_STORED)
    data = bytearray(path.read_bytes())
    data[data.index(b"one")] ^= 1
    path.write_bytes(data)
    with pytest.raises(RouteError, match=r"a\.zip is truncated or damaged at or after the member a/1\.png"):
        list(read_members(path, ["a/1.png"]))


def test_decompression_bombs_are_refused_early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archives, "_FREE_EXPANSION", 2**20)
    zeros = bytes(2**22)
    for path in (
        tar(tmp_path / "a.tar.gz", {f"{number}.png": zeros for number in range(3)}, "w:gz"),
        zipped(tmp_path / "a.zip", {f"{number}.png": zeros for number in range(3)}),
    ):
        assert "decompresses out of all proportion" in refused(path)


def test_a_member_larger_than_any_image_is_refused_when_it_is_read(tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "a.tar", "w") as archive:
        huge = tarfile.TarInfo("huge.bin")
        huge.size = MAX_FILE_BYTES + 1
        archive.addfile(tarfile.TarInfo("1.png"))
        start = archive.offset
    with (tmp_path / "a.tar").open("r+b") as file:  # the file has a hole there
        file.seek(start)
        file.write(huge.tobuf())
        file.truncate(start + 512 * (3 + (MAX_FILE_BYTES + 511) // 512 + 1))
    assert [member.name for member in list_members(tmp_path / "a.tar")] == ["1.png", "huge.bin"]
    assert dict(read_members(tmp_path / "a.tar", ["1.png"])) == {"1.png": b""}
    with pytest.raises(RouteError, match=rf"a\.tar holds huge\.bin of {MAX_FILE_BYTES + 1} bytes, .*; unpack it"):
        list(read_members(tmp_path / "a.tar", ["huge.bin"]))


def test_a_member_that_claims_more_than_is_there_ends(tmp_path: Path) -> None:
    path = tmp_path / "a.tar"
    info = tarfile.TarInfo("huge.png")
    info.size = 2**40
    path.write_bytes(info.tobuf())
    assert "a.tar" in refused(path)


@pytest.mark.parametrize("form", ["tar.gz", "zip"])
@pytest.mark.parametrize("name", ["a/" * 400_000, "a/" * 101, "a" * 4097])
def test_a_name_out_of_all_proportion_is_refused(tmp_path: Path, form: str, name: str) -> None:
    name = name[: 65_000 if form == "zip" else None] + "x.jpg"
    path = pack_files(tmp_path / f"a.{form}", [(name, b"x")])
    message = refused(path)
    assert "whose name is longer than 4096 bytes or has more than 100 parts" in message
    assert len(message) < len(str(path)) + 500


def test_backslashes_in_a_zip_separate_parts(tmp_path: Path) -> None:
    path = pack_files(tmp_path / "a.zip", [("a\\", b""), ("a\\b\\1.png", b"1"), ("c/2.png", b"2")])
    assert [member.name for member in list_members(path)] == ["a/b/1.png", "c/2.png"]
    assert dict(read_members(path, ["a/b/1.png"])) == {"a/b/1.png": b"1"}


def test_a_compression_that_is_not_known_is_refused_with_the_remedy(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.zip", {"a.png": b"1"})
    data = bytearray(path.read_bytes())
    for start in (8, data.index(b"PK\x01\x02") + 10):
        data[start : start + 2] = struct.pack("<H", 9)
    path.write_bytes(data)
    with pytest.raises(RouteError, match=r"a\.zip uses a compression that cannot be read .*a\.png\); unpack it"):
        list(read_members(path, ["a.png"]))


def test_a_pipe_is_no_archive(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "p.tar")
    assert "p.tar is no regular file" in refused(tmp_path / "p.tar")


def test_a_header_that_claims_to_be_huge_takes_no_memory(tmp_path: Path) -> None:
    info = tarfile.TarInfo("long")
    info.type, info.size = tarfile.GNUTYPE_LONGNAME, 2**33
    path = tmp_path / "a.tar.gz"
    path.write_bytes(gzip.compress(info.tobuf(tarfile.GNU_FORMAT) + bytes(4096)))
    assert "header of 8589934592 bytes" in refused(path)


def test_a_length_that_points_back_ends(tmp_path: Path) -> None:
    info = tarfile.TarInfo("a.png")
    data = bytearray(info.tobuf(tarfile.GNU_FORMAT))
    data[124:136] = b"\xff" * 4 + struct.pack(">q", -1024)
    data[148:156] = b" " * 8
    data[148:156] = f"{sum(data):06o}\0 ".encode()
    path = tmp_path / "a.tar"
    path.write_bytes(bytes(data) + bytes(4096))
    assert "truncated or damaged" in refused(path)


@pytest.mark.parametrize("size", ["-1024", "-1", "9" * 20])
@pytest.mark.parametrize("compress", [bytes, gzip.compress])
def test_a_length_in_an_extended_header_that_cannot_be_ends(
    tmp_path: Path, size: str, compress: Callable[[bytes], bytes]
) -> None:
    info = tarfile.TarInfo("a.png")
    info.pax_headers = {"size": size}
    path = tmp_path / "a.tar"
    path.write_bytes(compress(info.tobuf(tarfile.PAX_FORMAT) + bytes(4096)))
    assert "a.tar" in refused(path)


def test_extended_headers_without_end_are_refused(tmp_path: Path) -> None:
    info = tarfile.TarInfo("a.png")
    info.pax_headers = {"comment": "x" * 3000}
    header = info.tobuf(tarfile.PAX_FORMAT)[:-512]  # without the member that it is about
    path = tmp_path / "a.tar.gz"
    path.write_bytes(gzip.compress(header * 3000))
    assert "truncated or damaged" in refused(path)


def test_a_compressed_tar_may_consist_of_several_streams(tmp_path: Path) -> None:
    whole = tar(tmp_path / "a.tar", FILES).read_bytes()
    path = tmp_path / "a.tar.gz"
    path.write_bytes(gzip.compress(whole[:1000]) + gzip.compress(whole[1000:]))
    assert dict(read_members(path, FILES)) == FILES


def test_a_wanted_member_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    path = tar(tmp_path / "a.tar", FILES)
    with pytest.raises(RouteError, match=r"no longer holds a/9\.png"):
        list(read_members(path, ["a/1.png", "a/9.png"]))


def test_an_encrypted_zip_is_refused(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.zip", {"a.png": b"1"})
    data = bytearray(path.read_bytes())
    data[data.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(data)
    assert refused(path).endswith("is encrypted (its member a.png); unpack it with its password")


def test_archives_are_known_by_their_endings() -> None:
    assert all(map(is_archive_name, ["a.tar", "b.TAR.GZ", "c.tgz", "d.tar.xz", "e.zip", "f.tar.bz2"]))
    assert not any(map(is_archive_name, ["a.png", "tar", "b.gz"]))


def test_a_label_is_the_name_without_the_ending() -> None:
    names = ["MH_01.zip", "desk.tgz", "slice.2.TAR.GZ", "plain.tar", "no archive"]
    assert [archive_label(name) for name in names] == ["MH_01", "desk", "slice.2", "plain", "no archive"]


def test_some_contents_are_read_while_an_archive_is_listed(tmp_path: Path) -> None:
    path = tar(tmp_path / "a.tar.gz", FILES, "w:gz")
    contents = [content for _, content in scan_members(path, lambda member: member.size < 10)]
    assert contents == [b"one", b"", None]


def test_a_missing_archive_is_an_error(tmp_path: Path) -> None:
    assert "No such file" in refused(tmp_path / "gone.tar")


@fuzzed(60)
@given(
    files=st.dictionaries(st.text("abc/é. ", min_size=1, max_size=12), st.binary(max_size=1500), max_size=4),
    flips=st.lists(st.tuples(st.floats(0, 1), st.integers(1, 255)), max_size=4),
    cut=st.floats(0, 1) | st.just(1.0),
    form=st.sampled_from(["w", "w:gz", "zip"]),
)
def test_a_damaged_archive_gives_its_members_or_one_error(
    tmp_path: Path, files: dict[str, bytes], flips: list[tuple[float, int]], cut: float, form: str
) -> None:
    path = tmp_path / "a.archive"
    if form == "zip":
        zipped(path, files)
    else:
        tar(path, files, form)
    data = bytearray(path.read_bytes())
    for where, mask in flips:
        data[int(where * (len(data) - 1))] ^= mask
    path.write_bytes(data[: int(cut * len(data))])
    try:
        members = list_members(path)
        contents = [len(content) for _, content in read_members(path, {member.name for member in members})]
        assert len(contents) <= len(members)
    except EverplaceError as error:
        assert "\n" not in str(error)
