"""Fingerprints of images: the same files give the same one, wherever they lie."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from everplace.images.decoding import read_image_bytes
from everplace.progress import Progress, quiet
from everplace.route.traverse import Traverse
from everplace.threads import usable_cores

__all__ = ["file_digests", "fingerprint", "image_digests", "traverse_fingerprint"]

_FILES_A_TASK = 64


def fingerprint(labels: Any, parts: Iterable[bytes | memoryview]) -> str:
    """SHA-256, in hex, of labels, which JSON can hold, and of the parts of a content after them."""
    digest = hashlib.sha256(json.dumps(labels).encode())
    for part in parts:
        digest.update(part)
    return digest.hexdigest()


def file_digests(traverse: Traverse, progress: Progress = quiet) -> Iterator[bytes]:
    """Yields the SHA-256 of every image file, in order, those of some files at a time joined.

    Args:
        traverse: The frames.
        progress: Told of the files read.

    Raises:
        ImageError: A file cannot be read.
    """

    def digests(start: int) -> bytes:
        paths = traverse[start : start + _FILES_A_TASK].paths
        return b"".join(hashlib.sha256(read_image_bytes(path)).digest() for path in paths)

    # Threads, because hashlib gives up the interpreter lock.
    starts = range(0, len(traverse), _FILES_A_TASK)
    with ThreadPoolExecutor(min(8, usable_cores()), thread_name_prefix="hash") as pool:
        yield from progress(pool.map(digests, starts), f"reading {traverse.name}", len(starts))


def image_digests(traverse: Traverse, progress: Progress = quiet) -> list[str]:
    """What tells each image file by its content, wherever it lies and whatever it is called: 48 bits, in hex, in order.

    Args:
        traverse: The frames.
        progress: Told of the files read.

    Raises:
        ImageError: A file cannot be read.
    """
    joined = b"".join(file_digests(traverse, progress))
    size = hashlib.sha256().digest_size
    return [joined[start : start + 6].hex() for start in range(0, len(joined), size)]


def traverse_fingerprint(traverse: Traverse, progress: Progress = quiet) -> str:
    """SHA-256, in hex, of the stems of a traverse and the content of its image files, in order.

    Args:
        traverse: The frames.
        progress: Told of the files read.

    Raises:
        ImageError: A file cannot be read.
    """
    return fingerprint(traverse.stems, file_digests(traverse, progress))
