"""Writing files so that they appear whole or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from everplace.errors import ConfigError, StorageError
from everplace.leftovers import LEFTOVER, sweep, temporary_token

__all__ = [
    "STANDARD_OUTPUT",
    "cache_directory",
    "filled_directory",
    "is_special",
    "json_text",
    "readable",
    "remove_file",
    "remove_leftovers",
    "require_free_directory",
    "whole_directory",
    "whole_file",
    "write_bytes",
    "write_json",
    "write_text",
]


STANDARD_OUTPUT = Path("-")
"""What stands for standard output among the files to write."""

_OPEN_FILES = re.compile(r"/dev/fd|/proc/[^/]+(/task/[^/]+)?/fd")
_MOST_LINKS = 40
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")


def readable(path: str | os.PathLike[str]) -> str:
    """Returns a path or name as text that can always be printed on one line.

    Bytes that are not UTF-8 are escaped, and so are control characters: a line break in a name breaks no message.
    """
    text = os.fsencode(os.fspath(path)).decode("utf-8", "backslashreplace")
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


def shortened(text: str, most: int = 80) -> str:
    """Returns a text of a file for a message, cut in its middle where it is longer than `most` characters."""
    if len(text) <= most:
        return text
    half = (most - 5) // 2
    return f"{text[:half]} ... {text[-half:]}"


def cache_directory(name: str) -> Path:
    """Returns where one sort of things is kept for the next time: in $EVERPLACE_CACHE, or else the user's cache."""
    from platformdirs import user_cache_path

    chosen = os.environ.get("EVERPLACE_CACHE")
    return (Path(chosen) if chosen else user_cache_path("everplace", appauthor=False)) / name


def is_special(path: Path) -> bool:
    """Whether a rename would put a file in the place of something else: a device, a FIFO, a socket, or a link to one.

    So is what another program has opened for this one, such as /dev/stdout: the file behind it may hold more.
    """
    if _is_open_file(path):
        return True
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # nothing is there, or nothing that could be
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _is_open_file(path: Path) -> bool:
    """Whether a path, or a link on its way, is one of a process's open files."""
    for _ in range(_MOST_LINKS):
        directory = os.path.realpath(path.parent)
        if _OPEN_FILES.fullmatch(directory):
            return True
        try:
            path = Path(directory, path.readlink())
        except (OSError, ValueError):  # no link
            return False
    return False


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Gives a temporary sibling to write to; on success it replaces `path` by rename, else it is removed.

    Args:
        path: The file to create or replace; a link is followed. Its directory is made if missing.
            `STANDARD_OUTPUT` is written to in the end.

    Yields:
        The temporary path to write to; it keeps the suffix of `path`, and does not exist yet.

    Raises:
        ConfigError: `path` is a device, a FIFO or a socket.
        StorageError: The disk is full or the place cannot be written to; `path` is as it was before.
        OSError: Of another file than the one that is written, as it came.
    """
    if path == STANDARD_OUTPUT:
        with _then_printed() as temporary:
            yield temporary
        return
    if is_special(path):
        raise ConfigError(f"{readable(path)} is a device, a FIFO or a socket; choose a file to write to")
    target = Path(os.path.realpath(path)) if path.is_symlink() else path  # the link stays one
    temporary = target.with_name(f".{target.stem}.{temporary_token()}.part{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        sweep(target.parent)
        try:
            yield temporary
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
            temporary.replace(target)
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink()
    except OSError as error:
        if _is_of_another(error, temporary):
            raise
        raise _cannot_write(path, error) from error


@contextlib.contextmanager
def _then_printed() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as directory:
        temporary = Path(directory, "output")
        yield temporary
        sys.stdout.flush()
        with temporary.open("rb") as file:
            shutil.copyfileobj(file, sys.stdout.buffer)
        sys.stdout.buffer.flush()


def remove_file(path: Path) -> None:
    """Removes a file if it is there.

    Raises:
        StorageError: It cannot be removed.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise StorageError(f"cannot remove {readable(path)}: {_reason(error)}; remove it by hand") from error


def remove_leftovers(*directories: Path) -> None:
    """Removes the temporary files of `whole_file` that a process left when it was killed.

    To be called by the one process that may write there: the file of a living one would go too.

    Args:
        directories: Where to look, not below; they need not exist.

    Raises:
        StorageError: One cannot be removed.
    """
    for directory in directories:
        for path in sorted(directory.glob(".*.part*")):
            if LEFTOVER.fullmatch(path.name) and not path.is_dir():
                remove_file(path)


@contextlib.contextmanager
def whole_directory(path: Path) -> Iterator[Path]:
    """Gives a temporary sibling directory to fill; on success it becomes `path` by rename, else it is removed.

    When `path` appeared meanwhile (another process was faster), that one is kept and ours is removed.

    Args:
        path: The directory to create; it must not exist yet, or the finished work is dropped in its favour.

    Yields:
        The temporary directory, which exists and is empty.

    Raises:
        StorageError: The disk is full or the place cannot be written to; nothing is left behind.
        OSError: Of a file that is not in the directory, as it came.
    """
    temporary = path.with_name(f".{path.name}.{temporary_token()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep(path.parent)
        temporary.mkdir()
        try:
            yield temporary
            try:
                temporary.rename(path)
            except OSError:
                if not path.is_dir():
                    raise
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        if _is_of_another(error, temporary):
            raise
        raise _cannot_write(path, error) from error


@contextlib.contextmanager
def filled_directory(path: Path) -> Iterator[Path]:
    """Gives a temporary directory to fill; on success its files go into `path`, else nothing changes there.

    Args:
        path: The directory; made if missing. Its files of the same names are replaced, others stay.

    Yields:
        The temporary directory, which exists and is empty.

    Raises:
        StorageError: The disk is full or the place cannot be written to.
    """
    made = [one for one in (path, *path.parents) if not one.exists()]
    temporary = path / f".files.{temporary_token()}.part"
    try:
        try:
            temporary.mkdir(parents=True)
            sweep(path)
            yield temporary
            for file in sorted(temporary.iterdir()):
                file.replace(path / file.name)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
            with contextlib.suppress(OSError):
                for one in made:
                    one.rmdir()  # where nothing came into it
    except OSError as error:
        if _is_of_another(error, temporary):
            raise
        raise _cannot_write(path, error) from error


def require_free_directory(path: Path) -> None:
    """Refuses a directory to create that is there already, unless it is empty.

    Raises:
        ConfigError: It is a file, or holds something.
        StorageError: It cannot be looked into.
    """
    try:
        free = not os.path.lexists(path) or (path.is_dir() and not any(path.iterdir()))
    except OSError as error:
        raise StorageError(f"cannot look into {readable(path)}: {error.strerror}; choose another place") from error
    if not free:
        raise ConfigError(f"{readable(path)} already exists and is not empty: choose another place")


def write_bytes(path: Path, data: bytes) -> None:
    """Writes a whole file by rename (see `whole_file`)."""
    with whole_file(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Writes a whole UTF-8 file by rename (see `whole_file`); what of a file name is not UTF-8 is escaped in it."""
    write_bytes(path, text.encode("utf-8", "backslashreplace"))


def write_json(path: Path, value: Any) -> None:
    """Writes a value as a whole JSON file by rename (see `whole_file`)."""
    write_text(path, json_text(value))


def json_text(value: Any) -> str:
    """Returns JSON for people to read; what of a file name is not UTF-8 stays in it, as JSON's own escapes."""
    text = json.dumps(value, indent=2, ensure_ascii=False) + "\n"
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def _is_of_another(error: OSError, temporary: Path) -> bool:
    """Whether an error names a file or directory that has nothing to do with what is written at `temporary`."""
    if not isinstance(error.filename, str | bytes | os.PathLike):
        return False  # a full disk names none
    path = Path.cwd() / os.fsdecode(error.filename)
    temporary = Path.cwd() / temporary
    return not (path.is_relative_to(temporary) or temporary.is_relative_to(path))


def _cannot_write(path: Path, error: OSError) -> StorageError:
    return StorageError(f"cannot write {readable(path)}: {_reason(error)}; free space or choose another place")


def _reason(error: OSError) -> str:
    """Why it failed, on one line; libraries put whole reports into the message."""
    return os.strerror(error.errno) if error.errno else str(error).splitlines()[0]
