"""Reading files inside tar and zip archives as a stream, without unpacking them.

Nothing is ever written, and an archive that names a place outside itself (`../`, an absolute name, a link that leads
out) or a device is refused as a whole: whoever made it wanted something else than to hand over pictures. Python's
`tarfile` takes a damaged header for the end of the archive; here only the end mark is the end.
"""

from __future__ import annotations

import bz2
import contextlib
import gzip
import io
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

from everplace.data.images import MAX_FILE_BYTES
from everplace.errors import RouteError
from everplace.files import readable

__all__ = ["ARCHIVE_ENDINGS", "Member", "is_archive_name", "list_members", "read_members"]

ARCHIVE_ENDINGS = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz", ".zip")
"""Endings (lower case) of the archives that can be read."""

# Pictures hardly compress; a tar of a million tiny files does by its padding, but not a hundredfold.
_MOST_EXPANSION = 200
_FREE_EXPANSION = 2**30
_BLOCK = 512
_MOST_HEADER = 2**20
_DRIVE = re.compile("[A-Za-z]:")
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
    """A regular file in an archive.

    Attributes:
        name: Its name, parts separated by `/`, without `.` parts.
        size: Its bytes once decompressed, as the archive says.
    """

    name: str
    size: int


_Opener: TypeAlias = Callable[[], IO[bytes]]


class _RefusedError(Exception):
    """Carries what is wrong with an archive to where its name is known."""


def is_archive_name(name: str) -> bool:
    """Says whether a file's name is that of an archive."""
    return name.lower().endswith(ARCHIVE_ENDINGS)


def list_members(path: Path) -> Iterator[Member]:
    """Lists the regular files in an archive, in its order.

    Args:
        path: A tar (also compressed by gzip, bzip2 or xz: the content decides) or a zip.

    Yields:
        Directories, and links that lead to something inside, are left out.

    Raises:
        RouteError: The archive cannot be read, is truncated or damaged, or holds a member that leads outside, is a
            device, is larger than an image may be, or decompresses out of all proportion.
    """
    with _refusing(path) as last:
        for member, _ in _walk(path, last):
            yield member


def read_members(path: Path, wanted: Collection[str]) -> Iterator[tuple[str, bytes]]:
    """Reads some files of an archive in one pass.

    Args:
        path: The archive.
        wanted: Names as `list_members` gives them.

    Yields:
        Name and content, in the order of the archive; each name once.

    Raises:
        RouteError: As for `list_members`; or a wanted member is not there.
    """
    left = set(wanted)
    with _refusing(path) as last:
        for member, open_member in _walk(path, last):
            if member.name not in left:
                continue
            with open_member() as file:
                content = file.read(member.size + 1)
            if len(content) != member.size:
                raise _RefusedError(f"holds {len(content)} bytes of {_printable(member.name)}, but says {member.size}")
            yield member.name, content
            left.remove(member.name)
            if not left:
                return
        if left:
            raise _RefusedError(f"no longer holds {_printable(min(left))}")


class _Last:
    """The member that is being read, for the message if it breaks."""

    name = ""


@contextlib.contextmanager
def _refusing(path: Path) -> Iterator[_Last]:
    """Turns whatever breaks inside into one sentence that names the archive and the member."""
    last = _Last()
    try:
        yield last
    except _RefusedError as error:
        raise RouteError(f"{readable(path)} {error}; get it again from where you trust it") from error
    except (*_BROKEN, OSError, NotImplementedError, RuntimeError) as error:
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
    """Yields the regular files with what opens them."""
    with path.open("rb") as file:
        start = file.read(6)
        file.seek(0)
        if start.startswith((b"PK\3\4", b"PK\5\6", b"PK\7\b")):
            yield from _walk_zip(file, path.stat().st_size, last)
        else:
            yield from _walk_tar(file, start, path.stat().st_size, last)


def _walk_zip(file: IO[bytes], size: int, last: _Last) -> Iterator[tuple[Member, _Opener]]:
    left = _FREE_EXPANSION + _MOST_EXPANSION * size
    with zipfile.ZipFile(file) as archive:
        for info in archive.infolist():
            name = last.name = _clean(info.filename)
            kind = stat.S_IFMT(info.external_attr >> 16)
            if kind == stat.S_IFLNK:
                _check_target(name, archive.open(info).read(4096).decode("utf-8", "surrogateescape"), name)
            elif kind not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise _RefusedError(f"holds {_printable(name)}, which is neither a file nor a directory")
            elif not info.is_dir():
                if info.flag_bits & 1:
                    raise _RefusedError(f"is encrypted (its member {_printable(name)})")
                _check_size(name, info.file_size)
                left -= info.file_size
                if left < 0:
                    raise _RefusedError("decompresses out of all proportion")
                yield Member(name, info.file_size), lambda info=info: archive.open(info)  # type: ignore[misc]


def _walk_tar(file: IO[bytes], start: bytes, size: int, last: _Last) -> Iterator[tuple[Member, _Opener]]:
    stream = _Stream(_decompressed(file, start), size)
    # Names that are not UTF-8 keep their bytes as surrogates, so that a message can show them.
    with tarfile.TarFile(fileobj=stream, mode="r", encoding="utf-8", errors="surrogateescape") as archive:
        while (info := archive.next()) is not None:
            stream.most_at_once = _MOST_HEADER
            # tarfile remembers every member, for links; half a kilobyte each adds up.
            archive.members = []  # type: ignore[attr-defined]
            name = last.name = _clean(info.name)
            if info.issym() or info.islnk():
                _check_target(name, info.linkname, name if info.issym() else "")
            elif info.isreg():
                _check_size(name, info.size)
                yield Member(name, info.size), lambda info=info: _member(archive, stream, info)  # type: ignore[misc]
            elif not info.isdir():
                raise _RefusedError(f"holds {_printable(name)}, which is neither a file nor a directory")
    if not stream.ended_with_mark:
        raise tarfile.ReadError("its end mark is missing")
    stream.read_to_end()


def _member(archive: tarfile.TarFile, stream: _Stream, info: tarfile.TarInfo) -> IO[bytes]:
    stream.most_at_once = MAX_FILE_BYTES
    file = archive.extractfile(info)
    if file is None:
        raise tarfile.ReadError("no content")
    return file


def _decompressed(file: IO[bytes], start: bytes) -> IO[bytes]:
    if start.startswith(b"\x1f\x8b"):
        return gzip.GzipFile(fileobj=file)  # type: ignore[return-value]
    if start.startswith(b"BZh"):
        return bz2.BZ2File(file)
    if start.startswith(b"\xfd7zXZ\0"):
        return lzma.LZMAFile(file)
    return file


class _Stream(io.RawIOBase):
    """What `tarfile` reads from: forward only, and never more than the archive's size allows.

    A broken length field can point back, which `tarfile` would follow for ever.

    Attributes:
        most_at_once: Bytes that may be asked for at a time, so that a header that claims to be huge takes no memory.
    """

    def __init__(self, source: IO[bytes], compressed: int) -> None:
        self._source = source
        self._position = 0
        self._most = _FREE_EXPANSION + _MOST_EXPANSION * compressed
        self._last_block = b""
        self.most_at_once = _MOST_HEADER

    @property
    def ended_with_mark(self) -> bool:
        """Whether the last block that was read is the one of zeros that ends a tar."""
        return self._last_block == bytes(_BLOCK)

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._position

    def seek(self, offset: int, whence: int = 0) -> int:
        if whence != 0 or offset < self._position:
            raise tarfile.ReadError("a member begins before the one that it follows")
        if self._source.seekable() and isinstance(self._source, io.BufferedReader):
            self._position = self._source.seek(offset)
        while self._position < offset and self.read(min(offset - self._position, _MOST_HEADER)):
            pass
        return self._position

    def read(self, size: int = -1) -> bytes:
        if size < 0 or size > self.most_at_once:
            raise tarfile.ReadError(f"a header of {size} bytes")
        if self._position + size > self._most:
            raise _RefusedError(f"decompresses out of all proportion, to more than {self._most} bytes")
        data = self._source.read(size)
        self._position += len(data)
        if size == _BLOCK:
            self._last_block = data
        return data

    def read_to_end(self) -> None:
        """Reads what follows the end mark: only there does a compressed file's checksum come."""
        while self.read(_MOST_HEADER):
            pass


def _clean(name: str) -> str:
    """Returns a member's name without `.` parts.

    Raises:
        _RefusedError: It leads outside.
    """
    slashed = name.replace("\\", "/")
    parts = [part for part in slashed.split("/") if part not in ("", ".")]
    if slashed.startswith("/") or _DRIVE.match(slashed) or ".." in parts or "\0" in name:
        raise _RefusedError(f"holds the member {_printable(name)}, which leads outside the archive")
    return "/".join(part for part in name.split("/") if part not in ("", "."))


def _check_target(name: str, target: str, relative_to: str) -> None:
    """Raises `_RefusedError` for a link that leads outside; `relative_to` is empty where targets are from the top."""
    whole = posixpath.normpath(posixpath.join(posixpath.dirname(relative_to), target.replace("\\", "/")))
    if whole.startswith(("/", "../")) or whole == ".." or _DRIVE.match(whole):
        raise _RefusedError(f"holds the link {_printable(name)}, which leads outside to {_printable(target)}")


def _check_size(name: str, size: int) -> None:
    if size > MAX_FILE_BYTES:
        raise _RefusedError(f"holds {_printable(name)} of {size} bytes, more than the limit of {MAX_FILE_BYTES}")


def _printable(name: str) -> str:
    """Returns a member's name as text that can be printed on one line."""
    return ascii(name)[1:-1]
