"""Traverses decoded once: pixels in a memory-mapped file, kept in a cache outside the route.

A pack is a directory `<cache>/<key>/` with `pixels.npy` (uint8 N×H×W×C) and `pack.json` (what is in it, for
people). The key is the hash of the settings, the stems and the content of every image file, so a pack never
goes stale; it appears whole by rename, so several processes may make the same one at once.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import shutil
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError, RouteError, StorageError
from everplace.files import cache_directory, readable, whole_directory, write_text
from everplace.images.decoding import ImageSpec, decode_images
from everplace.progress import Progress, quiet
from everplace.route.fingerprint import file_digests, fingerprint
from everplace.route.traverse import Traverse

if sys.platform != "win32":
    import fcntl

__all__ = ["PackedImages", "default_cache", "pack"]

_VERSION = 2  # also raised when a file is decoded to other pixels
_PIXELS = "pixels.npy"
_ABOUT = "pack.json"
_BUFFER_BYTES = 2**20
_SECONDS_UNTIL_LOCKED = 60.0


@dataclass(frozen=True, eq=False, slots=True)
class PackedImages:
    """The decoded frames of a traverse.

    Attributes:
        pixels: uint8 N×H×W×C, memory-mapped and read-only.
        stems: The frames' stems, in the order of `pixels`.
    """

    pixels: NDArray[np.uint8]
    stems: tuple[str, ...]

    def __len__(self) -> int:
        """Returns the number of frames."""
        return len(self.stems)


def default_cache() -> Path:
    """Returns where packs are kept: `packed` in $EVERPLACE_CACHE, or else in the user's cache directory."""
    return cache_directory("packed")


def pack(traverse: Traverse, spec: ImageSpec, *, cache: Path | None = None, progress: Progress = quiet) -> PackedImages:
    """Decodes a traverse, or opens the pack that an earlier call made of the same files.

    Args:
        traverse: The frames.
        spec: The size (required) and channels.
        cache: Where packs are kept; None: `default_cache()`.
        progress: Told of the frames read, and of the frames decoded where that is needed.

    Returns:
        The decoded frames.

    Raises:
        ConfigError: `spec` has no size.
        ImageError: A frame cannot be decoded; nothing is left behind.
        StorageError: The cache cannot be written to; nothing is left behind.
    """
    if spec.size is None:
        raise ConfigError("packing needs one size for all images; give an image size")
    if not len(traverse):
        raise RouteError(f"the traverse {traverse.name!r} has no frames to pack; choose at least one")
    shape = (len(traverse), *spec.size, spec.channels)
    cache = default_cache() if cache is None else cache
    directory = cache / _key(traverse, spec, progress)
    # Twice, because between two looks another process may have set aside what this one has just made.
    for _ in range(2):
        pixels = _open(directory, shape)
        if pixels is None:
            _remove_leftovers(cache)
            try:
                _make(directory, traverse, spec, shape, progress)
            except StorageError as error:
                raise StorageError(f"{error} (EVERPLACE_CACHE says where packed images are kept)") from error
            pixels = _open(directory, shape)
        if pixels is not None:
            return PackedImages(pixels, traverse.stems)
    raise StorageError(f"{readable(directory)} was altered while it was made; run the command again")


def _key(traverse: Traverse, spec: ImageSpec, progress: Progress) -> str:
    """Returns the hash of all that decides what a pack holds."""
    settings = {"version": _VERSION, "size": spec.size, "grey": spec.grey, "stems": traverse.stems}
    return fingerprint(settings, file_digests(traverse, progress))[:40]


def _open(directory: Path, shape: tuple[int, ...]) -> NDArray[np.uint8] | None:
    """Maps the pixels of a pack, or returns None if there is no whole one."""
    path = directory / _PIXELS
    try:
        pixels = np.lib.format.open_memmap(path, mode="r")
        size = path.stat().st_size
    except (OSError, ValueError):
        return None
    whole = pixels.shape == shape and pixels.dtype == np.uint8 and pixels.flags.c_contiguous
    return pixels if whole and size == pixels.offset + pixels.nbytes else None


def _make(directory: Path, traverse: Traverse, spec: ImageSpec, shape: tuple[int, ...], progress: Progress) -> None:
    """Makes a pack, unless another process has just done so."""
    if not _set_aside(directory, shape):
        return
    # The lock is let go of last, after the rename.
    with contextlib.ExitStack() as lock, whole_directory(directory) as temporary:
        _take(lock, temporary)
        _fill(temporary, traverse, spec, shape, progress)


def _fill(directory: Path, traverse: Traverse, spec: ImageSpec, shape: tuple[int, ...], progress: Progress) -> None:
    """Writes the two files of a pack."""
    header = {"descr": "|u1", "fortran_order": False, "shape": shape}
    # Written, not mapped: on a full disk a write raises OSError, a store to a mapped page kills the process.
    with (directory / _PIXELS).open("wb", buffering=_BUFFER_BYTES) as file:
        np.lib.format.write_array_header_1_0(file, header)
        for image in progress(decode_images(traverse.paths, spec), f"decoding {traverse.name}", len(traverse)):
            file.write(image.data)
        file.flush()
        os.fsync(file.fileno())
    about = {"version": _VERSION, "traverse": traverse.name, "shape": shape, "stems": traverse.stems}
    write_text(directory / _ABOUT, json.dumps(about))


def _take(lock: contextlib.ExitStack, directory: Path) -> None:
    """Locks a directory that is being filled; when the process dies the system lets go of it."""
    if sys.platform != "win32":
        descriptor = os.open(directory, os.O_RDONLY)
        lock.callback(os.close, descriptor)
        fcntl.flock(descriptor, fcntl.LOCK_EX)


def _remove_leftovers(cache: Path) -> None:
    """Removes half-made packs that nobody has locked: their process is dead."""
    if sys.platform == "win32":
        return
    for leftover in sorted(cache.glob(".*.part")):
        with contextlib.suppress(OSError), contextlib.ExitStack() as lock:
            descriptor = os.open(leftover, os.O_RDONLY)
            lock.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # One that was made a moment ago may not be locked yet.
            age = time.time() - leftover.stat().st_mtime
            if any(leftover.iterdir()) or age > _SECONDS_UNTIL_LOCKED:
                shutil.rmtree(leftover, ignore_errors=True)


def _set_aside(directory: Path, shape: tuple[int, ...]) -> bool:
    """Removes a pack that was altered; by rename first, so that nobody opens it half removed.

    Returns:
        Whether the place is free; not so if another process has finished the pack meanwhile.
    """
    if _open(directory, shape) is not None:
        return False
    aside = directory.with_name(f".{directory.name}.{secrets.token_hex(4)}.part")
    try:
        directory.rename(aside)
    except FileNotFoundError:
        return True
    except OSError as error:
        raise StorageError(f"cannot replace {readable(directory)}: {error.strerror or error}; remove it") from error
    shutil.rmtree(aside, ignore_errors=True)
    return True
