"""Reading files inside tar and zip archives as a stream, without unpacking them.

Nothing is ever written, and an archive that names a place outside itself (`../`, an absolute name, a link that leads
out) or a device is refused as a whole: whoever made it wanted something else than to hand over pictures. Python's
`tarfile` takes a damaged header for the end of the archive; here only the end mark is the end.
"""

from __future__ import annotations

import contextlib
import lzma
import posixpath
import re
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import IO, NamedTuple, TypeAlias

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import MAX_FILE_BYTES
from everplace.importing.containers.tar_stream import MAX_HEADER, DisproportionError, TarStream, expansion_limit

__all__ = [
    "ARCHIVE_ENDINGS",
    "Member",
    "archive_label",
    "is_archive_name",
    "read_members",
    "scan_members",
]

ARCHIVE_ENDINGS = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz", ".zip")
"""Endings (lower case) of the archives that can be read."""

_DRIVE = re.compile("[A-Za-z]:")
# No file system takes more; the work of a tree of names grows with their depth.
_LONGEST_NAME = 4096
_MOST_PARTS = 100
_MOST_PRINTED = 200
_MISTRUST = "get it again from where you trust it"
# What the standard library raises on broken bytes, a broken length field among them.
_BROKEN = (
    tarfile.TarError,
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    EOFError,
    ValueError,
    OverflowError,
    LookupError,
    TypeError,
    AttributeError,
    struct.error,
    MemoryError,
)


class Member(NamedTuple):
    """A regular file in an archive, or a link to something in it.

    Attributes:
        name: Its name, parts separated by `/`, without `.` parts.
        size: Its bytes once decompressed, as the archive says.
        target: The name of what it is a link to; empty: it is a file.
    """

    name: str
    size: int
    target: str = ""


_Opener: TypeAlias = Callable[[], IO[bytes]]


class _RefusedError(Exception):
    """Carries what is wrong with an archive, and what to do, to where its name is known."""

    def __init__(self, problem: str, remedy: str = _MISTRUST) -> None:
        super().__init__(problem)
        self.remedy = remedy


def is_archive_name(name: str) -> bool:
    """Says whether a file's name is that of an archive."""
    return name.lower().endswith(ARCHIVE_ENDINGS)


def archive_label(name: str) -> str:
    """Returns an archive's file name without the ending: what it would be unpacked into."""
    endings = (ending for ending in ARCHIVE_ENDINGS if name.lower().endswith(ending))
    return name[: -len(max(endings, key=len, default="")) or None]


def scan_members(path: Path, wanted: Callable[[Member], bool] | None = None) -> Iterator[tuple[Member, bytes | None]]:
    """Lists the regular files and the links in an archive, with the content of some files, in one pass.

    Args:
        path: A tar (also compressed by gzip, bzip2 or xz: the content decides) or a zip.
        wanted: Says whether to read a file; None: read none.

    Yields:
        Each file or link, and its content if it is a file that was wanted, in the order of the archive. Directories
        are left out.

    Raises:
        RouteError: The archive cannot be read, is truncated or damaged, or holds a member that leads outside, is a
            device or has a name out of all proportion, or the archive decompresses so; or a wanted file is larger than
            an image may be.
    """
    with _refusing(path) as last:
        for member, open_member in _walk(path, last):
            chosen = wanted is not None and not member.target and wanted(member)
            yield member, _read(member, open_member) if chosen else None


def read_members(path: Path, wanted: Collection[str]) -> Iterator[tuple[str, bytes]]:
    """Reads some files of an archive in one pass; links are not followed.

    Args:
        path: The archive.
        wanted: Names as `scan_members` gives them.

    Yields:
        Name and content, in the order of the archive; each name once.

    Raises:
        RouteError: As for `scan_members`; or a wanted member is not there.
    """
    left = set(wanted)
    if not left:
        return
    for member, content in scan_members(path, lambda member: member.name in left):
        if content is not None:
            yield member.name, content
            left.remove(member.name)
            if not left:
                return
    raise RouteError(f"{readable(path)} no longer holds {_printable(min(left))}; get it again from where you trust it")


def _read(member: Member, open_member: _Opener) -> bytes:
    if member.size > MAX_FILE_BYTES:
        raise _RefusedError(
            f"holds {_printable(member.name)} of {member.size} bytes, more than the {MAX_FILE_BYTES} that are read "
            "from inside an archive",
            "unpack it",
        )
    with open_member() as file:
        content = file.read(member.size + 1)
    if len(content) != member.size:
        raise _RefusedError(f"holds {len(content)} bytes of {_printable(member.name)}, but says {member.size}")
    return content


class _Last:
    """The member that is being read, for the message if it breaks."""

    name = ""


@contextlib.contextmanager
def _refusing(path: Path) -> Iterator[_Last]:
    """Turns whatever breaks inside into one sentence that names the archive and the member."""
    last = _Last()
    try:
        yield last
    except (_RefusedError, DisproportionError) as error:
        remedy = error.remedy if isinstance(error, _RefusedError) else _MISTRUST
        raise RouteError(f"{readable(path)} {error}; {remedy}") from error
    except NotImplementedError as error:
        where = f" (its member {_printable(last.name)})" if last.name else ""
        raise RouteError(f"{readable(path)} uses a compression that cannot be read{where}; unpack it") from error
    except (*_BROKEN, OSError, RuntimeError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise RouteError(
                f"cannot read {readable(path)}: {error.strerror or error}; check the file and its permissions"
            ) from error
        where = f" at or after the member {_printable(last.name)}" if last.name else ""
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RouteError(
            f"the archive {readable(path)} is truncated or damaged{where} ({reason}); fetch or copy it again"
        ) from error


def _walk(path: Path, last: _Last) -> Iterator[tuple[Member, _Opener]]:
    """Yields the regular files and links with what opens a file."""
    if path.exists() and not path.is_file():
        raise _RefusedError("is no regular file", "give an archive that is one")
    with path.open("rb") as file:
        start = file.read(6)
        file.seek(0)
        if start.startswith((b"PK\3\4", b"PK\5\6", b"PK\7\b")):
            yield from _walk_zip(file, path.stat().st_size, last)
        else:
            yield from _walk_tar(TarStream(file, path.stat().st_size), last)


def _walk_zip(file: IO[bytes], size: int, last: _Last) -> Iterator[tuple[Member, _Opener]]:
    left = expansion_limit(size)
    with zipfile.ZipFile(file) as archive:
        for info in archive.infolist():
            # Some that pack on Windows separate the parts so; unzip takes it for the same.
            name = last.name = _clean(_clean(info.filename).replace("\\", "/"))
            if info.flag_bits & 1:
                raise _RefusedError(f"is encrypted (its member {_printable(name)})", "unpack it with its password")
            kind = stat.S_IFMT(info.external_attr >> 16)
            if kind == stat.S_IFLNK:
                target = archive.open(info).read(4096).decode("utf-8", "surrogateescape")
                yield Member(name, 0, _target(name, target, name)), lambda info=info: archive.open(info)  # type: ignore[misc]
            elif kind not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise _RefusedError(f"holds {_printable(name)}, which is neither a file nor a directory")
            elif not info.filename.endswith(("/", "\\")):
                left -= info.file_size
                if left < 0:
                    raise DisproportionError("decompresses out of all proportion")
                yield Member(name, info.file_size), lambda info=info: archive.open(info)  # type: ignore[misc]


def _walk_tar(stream: TarStream, last: _Last) -> Iterator[tuple[Member, _Opener]]:
    # Names that are not UTF-8 keep their bytes as surrogates, so that a message can show them.
    with tarfile.TarFile(fileobj=stream, mode="r", encoding="utf-8", errors="surrogateescape") as archive:
        while (info := archive.next()) is not None:
            stream.most_at_once = MAX_HEADER
            # tarfile remembers every member, for links; half a kilobyte each adds up.
            archive.members = []  # type: ignore[attr-defined]
            name = last.name = _clean(info.name)
            if info.issym() or info.islnk():
                target = _target(name, info.linkname, name if info.issym() else "")
                yield Member(name, 0, target), lambda info=info: _member(archive, stream, info)  # type: ignore[misc]
            elif info.isreg():
                yield Member(name, info.size), lambda info=info: _member(archive, stream, info)  # type: ignore[misc]
            elif not info.isdir():
                raise _RefusedError(f"holds {_printable(name)}, which is neither a file nor a directory")
    if not stream.ended_with_mark:
        raise tarfile.ReadError("its end mark is missing")
    stream.read_to_end()


def _member(archive: tarfile.TarFile, stream: TarStream, info: tarfile.TarInfo) -> IO[bytes]:
    stream.most_at_once = MAX_FILE_BYTES
    file = archive.extractfile(info)
    if file is None:
        raise tarfile.ReadError("no content")
    return file


def _clean(name: str) -> str:
    """Returns a member's name without `.` parts.

    Raises:
        _RefusedError: It leads outside, or is too long.
    """
    slashed = name.replace("\\", "/")
    parts = [part for part in slashed.split("/") if part not in ("", ".")]
    if len(name.encode("utf-8", "surrogateescape")) > _LONGEST_NAME or len(parts) > _MOST_PARTS:
        raise _RefusedError(
            f"holds the member {_printable(name)}, whose name is longer than {_LONGEST_NAME} bytes or has more than "
            f"{_MOST_PARTS} parts"
        )
    if slashed.startswith("/") or _DRIVE.match(slashed) or ".." in parts or "\0" in name:
        raise _RefusedError(f"holds the member {_printable(name)}, which leads outside the archive")
    return "/".join(part for part in name.split("/") if part not in ("", "."))


def _target(name: str, target: str, relative_to: str) -> str:
    """Returns what a link leads to, from the top; `relative_to` is empty where targets are from there already.

    Raises:
        _RefusedError: It leads outside.
    """
    whole = posixpath.normpath(posixpath.join(posixpath.dirname(relative_to), target.replace("\\", "/")))
    if whole.startswith(("/", "../")) or whole == ".." or _DRIVE.match(whole) or "\0" in whole:
        raise _RefusedError(f"holds the link {_printable(name)}, which leads outside to {_printable(target)}")
    return whole


def _printable(name: str) -> str:
    """Returns a member's name, or its start, as text that can be printed on one line."""
    return ascii(name[:_MOST_PRINTED])[1:-1] + ("..." if len(name) > _MOST_PRINTED else "")
