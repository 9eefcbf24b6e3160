"""Reading files inside tar and zip archives as a stream, without unpacking them.

Nothing is ever written, and an archive that names a place outside itself (`../`, an absolute name, a link that leads
out) or a device is refused as a whole: whoever made it wanted something else than to hand over pictures. Python's
`tarfile` takes a damaged header for the end of the archive; here only the end mark is the end.
"""

from __future__ import annotations

import bz2
import gzip
import lzma
import posixpath
import re
import stat
import tarfile
import zipfile
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, cast

from everplace.errors import RouteError
from everplace.files import readable
from everplace.git_lfs import POINTER_BYTES, is_pointer, pointer_sentence
from everplace.images.decoding import MAX_FILE_BYTES
from everplace.importing.containers.expansion import MOST_TIMES, SmallSteps, read_in_proportion

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["ARCHIVE_ENDINGS", "Member", "archive_label", "is_archive_name", "read_members", "scan_members"]

ARCHIVE_ENDINGS = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz", ".zip")
"""Endings (lower case) of the archives that can be read."""

_DECOMPRESSORS: dict[bytes, Callable[[Any], Any]] = {b"\x1f\x8b": gzip.open, b"BZ": bz2.open, b"\xfd7": lzma.open}
_DRIVE = re.compile("[A-Za-z]:")
# No file system takes more; the work of a tree of names grows with their depth.
_LONGEST_NAME = 4096
_MOST_PARTS = 100
_MOST_PRINTED = 200
# Pictures hardly compress; a tar of a million tiny files does by its padding, but not a hundredfold.
_MOST_EXPANSION = 200
_FREE_EXPANSION = 2**30
# Long names and extended attributes are headers of their own, which `tarfile` reads at once.
_LONGEST_HEADER = 2**20
_LONG_HEADERS = (
    tarfile.GNUTYPE_LONGNAME,
    tarfile.GNUTYPE_LONGLINK,
    tarfile.XHDTYPE,
    tarfile.XGLTYPE,
    tarfile.SOLARIS_XHDTYPE,
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


_Readable: TypeAlias = tuple[Member, Callable[[], IO[bytes]], Callable[[], int] | None]
"""A file, what opens it, and what says how many packed bytes were taken for it so far (None: it is not packed)."""


class _RefusedError(Exception):
    """Carries what is wrong with an archive, and what to do, to where its name is known."""

    def __init__(self, problem: str, remedy: str = "get it again from where you trust it") -> None:
        super().__init__(f"{problem}; {remedy}")


def is_archive_name(name: str) -> bool:
    """Says whether a file's name is that of an archive."""
    return name.lower().endswith(ARCHIVE_ENDINGS)


def archive_label(name: str) -> str:
    """Returns an archive's file name without the ending: what it would be unpacked into."""
    endings = (ending for ending in ARCHIVE_ENDINGS if name.lower().endswith(ending))
    return name[: -len(max(endings, key=len, default="")) or None]


def scan_members(
    path: Path, wanted: Callable[[Member], bool] = lambda _: False, *, bombs: Literal["refuse", "skip"] = "refuse"
) -> Iterator[tuple[Member, bytes | None]]:
    """Lists the regular files and the links in an archive, with the content of some files, in one pass.

    Args:
        path: A tar (also compressed by gzip, bzip2 or xz: the content decides) or a zip.
        wanted: Says whether to read a file.
        bombs: What to do with a wanted file that unpacks out of all proportion (see `read_in_proportion`): refuse the
            archive, or skip its content.

    Yields:
        Each file or link, and its content if it is a file that was wanted, in the order of the archive. Directories
        are left out.

    Raises:
        RouteError: The archive cannot be read, is truncated or damaged, or holds a member that leads outside, is a
            device or has a name out of all proportion, or the archive decompresses so; or a wanted file is larger than
            an image may be.
    """
    last = ""
    try:
        if path.exists() and not path.is_file():
            raise _RefusedError("is no regular file", "give an archive that is one")
        limit = _FREE_EXPANSION + _MOST_EXPANSION * path.stat().st_size
        with path.open("rb") as file:
            if is_pointer(file.read(POINTER_BYTES)):
                raise RouteError(pointer_sentence(readable(path)))
            file.seek(0)
            is_zip = file.read(4) in (b"PK\3\4", b"PK\5\6", b"PK\7\b")
            file.seek(0)
            for member, open_member, spent in _zip_members(file, limit) if is_zip else _tar_members(file, limit):
                last = _printable(member.name)
                content = None
                if not member.target and wanted(member):
                    content = _read(member, open_member, spent)
                    if content is None and bombs == "refuse":
                        raise _RefusedError(
                            f"holds {last}, which unpacks to more than {MOST_TIMES} times its size and is no image of "
                            "so many pixels"
                        )
                yield member, content
    except RouteError:
        raise
    except _RefusedError as error:
        raise RouteError(f"{readable(path)} {error}") from error
    except NotImplementedError as error:
        raise RouteError(
            f"{readable(path)} uses a compression that cannot be read (its member {last}); unpack it"
        ) from error
    except Exception as error:  # on broken bytes the standard library raises nearly anything
        if isinstance(error, OSError) and error.errno is not None:
            raise RouteError(
                f"cannot read {readable(path)}: {error.strerror or error}; check the file and its permissions"
            ) from error
        where = f" at or after the member {last}" if last else ""
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RouteError(
            f"the archive {readable(path)} is truncated or damaged{where} ({reason}); fetch or copy it again"
        ) from error


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


def _read(member: Member, open_member: Callable[[], IO[bytes]], spent: Callable[[], int] | None) -> bytes | None:
    if member.size > MAX_FILE_BYTES:
        raise _RefusedError(
            f"holds {_printable(member.name)} of {member.size} bytes, more than the {MAX_FILE_BYTES} that are read "
            "from inside an archive",
            "unpack it",
        )
    with open_member() as file:
        return read_in_proportion(file, member.size, spent)


def _zip_members(file: IO[bytes], limit: int) -> Iterator[_Readable]:
    """Yields the regular files and links of a zip with what opens a file."""
    with zipfile.ZipFile(file) as archive:
        for info in archive.infolist():
            # Some that pack on Windows separate the parts so; unzip takes it for the same.
            name = _clean(_clean(info.filename).replace("\\", "/"))
            kind = stat.S_IFMT(info.external_attr >> 16)
            limit -= info.file_size
            if info.flag_bits & 1:
                raise _RefusedError(f"is encrypted (its member {_printable(name)})", "unpack it with its password")
            if limit < 0:
                raise _RefusedError("decompresses out of all proportion")
            if kind == stat.S_IFLNK:
                target = archive.open(info).read(_LONGEST_NAME).decode("utf-8", "surrogateescape")
                yield _link(name, target, posixpath.dirname(name)), lambda info=info: archive.open(info), None  # type: ignore[misc]
            elif kind not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise _RefusedError(f"holds {_printable(name)}, which is neither a file nor a directory")
            elif not info.filename.endswith(("/", "\\")):
                member = Member(name, info.file_size)
                yield member, lambda info=info: archive.open(info), lambda info=info: info.compress_size  # type: ignore[misc]


def _tar_members(file: IO[bytes], limit: int) -> Iterator[_Readable]:
    """Yields the regular files and links of a tar with what opens a file; reads to the end, where the checksum is."""
    decompressor = _DECOMPRESSORS.get(file.read(2))
    file.seek(0)
    packed = SmallSteps(file)
    stream: IO[bytes] = decompressor(packed) if decompressor else file
    # Names that are not UTF-8 keep their bytes as surrogates, so that a message can show them.
    with tarfile.TarFile(
        fileobj=stream, mode="r", tarinfo=_StrictInfo, encoding="utf-8", errors="surrogateescape"
    ) as archive:
        while (info := archive.next()) is not None:
            if decompressor and archive.offset > limit:
                raise _RefusedError("decompresses out of all proportion")
            # tarfile remembers every member, for links; half a kilobyte each adds up.
            archive.members = []  # type: ignore[attr-defined]
            name = _clean(info.name)
            if info.issym() or info.islnk():
                member = _link(name, info.linkname, posixpath.dirname(name) if info.issym() else "")
            elif info.isreg():
                member = Member(name, info.size)
            elif info.isdir():
                continue
            else:
                raise _RefusedError(f"holds {_printable(name)}, which is neither a file nor a directory")
            spent = partial(packed.spent_since, packed.tell()) if decompressor else None
            yield member, lambda info=info: cast(IO[bytes], archive.extractfile(info)), spent  # type: ignore[misc]
    while stream.read(_LONGEST_HEADER):
        if stream.tell() > limit:
            raise _RefusedError("decompresses out of all proportion")


class _StrictInfo(tarfile.TarInfo):
    """A header of a tar; a damaged one is an error and not the end, and no length takes memory or leads back."""

    @classmethod
    def fromtarfile(cls, archive: tarfile.TarFile) -> Self:
        """Reads the next header; at the end mark it raises what `tarfile` expects."""
        try:
            return super().fromtarfile(archive)._checked()
        except tarfile.EOFHeaderError:  # type: ignore[attr-defined]
            raise
        except tarfile.HeaderError as error:
            raise tarfile.ReadError(str(error)) from error

    @classmethod
    def frombuf(cls, buffer: bytes | bytearray, encoding: str, errors: str) -> Self:
        """Makes a header of its block, before what follows it is read."""
        return super().frombuf(buffer, encoding, errors)._checked()

    def _checked(self) -> Self:
        if self.size < 0 or (self.type in _LONG_HEADERS and self.size > _LONGEST_HEADER):
            raise tarfile.ReadError(f"a header of {self.size} bytes")
        return self


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


def _link(name: str, target: str, directory: str) -> Member:
    """Returns a link; its target is given from a directory of the archive, empty: the top.

    Raises:
        _RefusedError: It leads outside.
    """
    whole = posixpath.normpath(posixpath.join(directory, target.replace("\\", "/")))
    if whole.startswith(("/", "../")) or whole == ".." or _DRIVE.match(whole) or "\0" in whole:
        raise _RefusedError(f"holds the link {_printable(name)}, which leads outside to {_printable(target)}")
    return Member(name, 0, whole)


def _printable(name: str) -> str:
    """Returns a member's name, or its start, as text that can be printed on one line."""
    return ascii(name[:_MOST_PRINTED])[1:-1] + ("..." if len(name) > _MOST_PRINTED else "")
