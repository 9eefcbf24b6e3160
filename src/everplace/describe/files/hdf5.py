"""HDF5 as descriptor files need it: written to disk as it is made, read with a look at what a dataset announces."""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from everplace.errors import DescriptorsError
from everplace.files import whole_file

__all__ = [
    "OutputFile",
    "blocks_of_rows",
    "find_dataset",
    "read_text",
    "read_texts",
    "require_own_numbers",
    "whole_hdf5",
    "write_texts",
]

_BYTES_OF_NAMES = "surrogateescape"  # a name that is not UTF-8 keeps its bytes, as Python's file names do
_BLOCK_BYTES = 2**24
_MOST_COMPRESSED = 1000  # bytes out of one, about what deflate reaches on zeros
_TEXTS_AT_ONCE = 64


class OutputFile(h5py.File):  # type: ignore[misc]  # h5py states no types
    """An HDF5 file that is filled on disk."""

    def __init__(self, raw: io.FileIO) -> None:
        """Begins a file in an empty one."""
        self._storage = _PatientFile(raw)
        super().__init__(self._storage, "w")

    def require_room(self) -> None:
        """Raises the OSError of what could not be written so far, if there is any."""
        if self._storage.error is not None:
            raise self._storage.error


@contextlib.contextmanager
def whole_hdf5(path: Path) -> Iterator[OutputFile]:
    """A file that is filled on disk, and stands under its name once it is whole, or not at all.

    Raises:
        StorageError: The place cannot be written to.
    """
    with whole_file(path) as temporary, temporary.open("w+b", buffering=0) as raw:
        file = OutputFile(raw)
        try:
            with file:
                yield file
        finally:
            file.require_room()


class _PatientFile(io.RawIOBase):
    """A file whose failures to write are kept for the end: HDF5 itself crashes where the disk is full."""

    def __init__(self, raw: io.FileIO) -> None:
        self._raw = raw
        self.error: OSError | None = None

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        return self._raw.seek(offset, whence)

    def tell(self) -> int:
        return self._raw.tell()

    def readinto(self, buffer: Any, /) -> int:
        wanted = memoryview(buffer).cast("B")
        read = self._raw.readinto(wanted)
        wanted[read:] = bytes(len(wanted) - read)  # of what could not be written
        return len(wanted)

    def write(self, data: Any, /) -> int:
        left = memoryview(data).cast("B")
        whole = len(left)
        with self._kept_error():
            while left:
                left = left[self._raw.write(left) :]
        return whole

    def truncate(self, size: int | None = None, /) -> int:
        with self._kept_error():
            self._raw.truncate(size)
        return self._raw.tell() if size is None else size

    @contextlib.contextmanager
    def _kept_error(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.error = self.error or error


def write_texts(file: h5py.File, name: str, texts: Sequence[str]) -> None:
    """Writes a dataset of UTF-8 strings."""
    encoded = [text.encode("utf-8", _BYTES_OF_NAMES) for text in texts]
    file.create_dataset(name, data=encoded, dtype=h5py.string_dtype("utf-8"))


def find_dataset(file: h5py.File, name: str) -> Any:
    """Finds a dataset at the top of a file, and sees that it holds its numbers; see `require_own_numbers`.

    Raises:
        DescriptorsError: There is none, or it is a link to another place.
    """
    link = file.get(name, getlink=True)
    if link is not None and not isinstance(link, h5py.HardLink):
        raise DescriptorsError(f"`{name}` is a link to another place; write the numbers into the file itself")
    if not isinstance(found := file.get(name), h5py.Dataset):
        raise DescriptorsError(f"it holds no dataset `{name}`; make it again with `everplace describe`")
    require_own_numbers(found, name, file.id.get_filesize())
    return found


def require_own_numbers(dataset: Any, name: str, file_bytes: int) -> None:
    """Refuses what keeps its numbers elsewhere, or announces more than it can hold.

    Else a file of 1 KB could ask for all memory.

    Args:
        dataset: Of which nothing was read yet.
        name: What the message calls it.
        file_bytes: Size of its file.

    Raises:
        DescriptorsError: It does one of these.
    """
    if dataset.is_virtual or dataset.external:
        raise DescriptorsError(f"`{name}` keeps its numbers in other files; write them into the file itself")
    stored = min(dataset.id.get_storage_size(), file_bytes)
    compressed = dataset.id.get_create_plist().get_nfilters() > 0
    entries = max(dataset.size or 0, math.prod(dataset.chunks or (0,)))  # a chunk is read whole
    if dataset.size and entries * dataset.dtype.itemsize > stored * (_MOST_COMPRESSED if compressed else 1):
        raise DescriptorsError(f"`{name}` announces the shape {dataset.shape}, but holds only {stored} bytes")


def blocks_of_rows(dataset: Any) -> Iterator[NDArray[Any]]:
    """Reads an array in blocks of rows, so that it need not be in memory twice; each chunk of the file is read once."""
    rows = dataset.chunks[0] if dataset.chunks else 1
    rows *= max(1, _BLOCK_BYTES // max(1, rows * math.prod(dataset.shape[1:]) * dataset.dtype.itemsize))
    for start in range(0, len(dataset), rows):
        yield np.ascontiguousarray(dataset[start : start + rows])


def read_texts(dataset: Any, name: str) -> tuple[str, ...]:
    """Reads strings in chunks: all of them may point at the same long text.

    Raises:
        DescriptorsError: It is no list of strings, or they are longer than the file.
    """
    if h5py.check_string_dtype(dataset.dtype) is None or dataset.ndim != 1:
        raise DescriptorsError(f"`{name}` must be a list of strings, not {dataset.dtype} of shape {dataset.shape}")
    texts: list[str] = []
    total = 0
    most = max(dataset.file.id.get_filesize(), dataset.nbytes)
    for start in range(0, len(dataset), _TEXTS_AT_ONCE):
        texts.extend(dataset.asstr("utf-8", _BYTES_OF_NAMES)[start : start + _TEXTS_AT_ONCE])
        total += sum(map(len, texts[start:]))
        if total > most:
            raise DescriptorsError(f"its `{name}` are longer than the file; make it again with `everplace describe`")
    return tuple(texts)


def read_text(file: h5py.File, name: str, default: str) -> str:
    """Reads an attribute of the file.

    Raises:
        DescriptorsError: It is no text.
    """
    value = file.attrs.get(name, default)
    if not isinstance(value, str):
        raise DescriptorsError(f"its attribute `{name}` must be text, not {type(value).__name__}")
    return value
