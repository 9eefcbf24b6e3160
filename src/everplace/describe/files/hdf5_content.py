"""What a descriptor file holds, read in a child process: libhdf5 crashes on damaged files, or reads them for ever."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from everplace.child_process import ChildError, file_limits, output_of_child
from everplace.describe.files.hdf5 import blocks_of_rows, find_dataset, read_text, read_texts
from everplace.describe.files.hloc_layout import is_hloc_layout, read_groups
from everplace.errors import DescriptorsError
from everplace.files import readable
from everplace.git_lfs import refuse_pointer

__all__ = ["Hdf5Content", "read_hdf5"]


@dataclass(frozen=True, eq=False)
class Hdf5Content:
    """What stands in a file, not yet looked at.

    Attributes:
        values: N×D floating-point numbers.
        names: The names of the frames; None in hloc's layout, which has image names only.
        image_names: The names of the image files, where they are known.
        method: The method that made them.
        metric: How two of them are compared.
        settings: JSON.
    """

    values: NDArray[Any]
    names: tuple[str, ...] | None
    image_names: tuple[str, ...] | None
    method: str
    metric: str
    settings: str


def read_hdf5(path: Path) -> Hdf5Content:
    """Reads everplace's file or hloc's layout.

    Raises:
        DescriptorsError: The file is none of these, is damaged, or takes longer than 20 s and a second for each MiB.
    """
    refuse_pointer(path, DescriptorsError)
    seconds, memory = file_limits(path)
    try:
        with output_of_child(_send, str(path), seconds=seconds, memory=memory) as sent:
            head = _receive(sent, path)
            values = np.empty(head.pop("shape"), head.pop("type"))
            row = 0
            while row < len(values):
                block = values[row : row + _receive(sent, path)["rows"]]
                if sent.readinto(block.view(np.uint8)) < block.nbytes:  # type: ignore[attr-defined]
                    raise EOFError
                row += len(block)
            names, image_names = (
                None if texts is None else tuple(texts) for texts in (head.pop("names"), head.pop("image_names"))
            )
    except ChildError as error:
        raise _damaged(path, error) from None
    return Hdf5Content(values, names, image_names, **head)


def _receive(sent: IO[bytes], path: Path) -> dict[str, Any]:
    """Reads the next line of JSON from the child, which may be an error."""
    line = sent.readline()
    if not line.endswith(b"\n"):
        raise EOFError
    received: dict[str, Any] = json.loads(line)
    if "wrong" in received:
        raise DescriptorsError(f"{readable(path)} cannot be read: {received['wrong']}")
    if "damaged" in received:
        raise _damaged(path, received["damaged"])
    return received


def _damaged(path: Path, reason: object) -> DescriptorsError:
    return DescriptorsError(
        f"{readable(path)} is no readable HDF5 file ({reason}); make it again with `everplace describe`"
    )


def _send(out: IO[bytes], path: str) -> None:
    """Writes what a file holds: a line of JSON, then blocks of rows, each after a line with their number."""
    try:
        with h5py.File(path, "r") as file:
            _send_content(out, file)
    except DescriptorsError as error:
        _send_line(out, {"wrong": str(error)})
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:  # what h5py raises for a damaged file
        _send_line(out, {"damaged": str(error)})


def _send_content(out: IO[bytes], file: h5py.File) -> None:
    head = {name: read_text(file, name, text) for name, text in _ATTRIBUTES.items()}
    names = image_names = None
    blocks: Iterator[NDArray[Any]]
    if is_hloc_layout(file):
        image_names, values = read_groups(file)
        blocks = iter((values,))
    else:
        values = find_dataset(file, "descriptors")
        if values.dtype.kind != "f" or values.ndim != 2:  # before anything of it is read
            raise DescriptorsError(
                f"`descriptors` must be N×D floating-point numbers, not {values.dtype} of {values.shape}"
            )
        blocks = blocks_of_rows(values)
        names = read_texts(find_dataset(file, "names"), "names")
        if "image_names" in file:
            image_names = read_texts(find_dataset(file, "image_names"), "image_names")
    content = {"shape": values.shape, "type": values.dtype.str, "names": names, "image_names": image_names}
    _send_line(out, {**head, **content})
    for block in blocks:
        _send_line(out, {"rows": len(block)})
        out.write(block.data)


_ATTRIBUTES = {"method": "unknown", "metric": "cosine", "settings": "{}"}


def _send_line(out: IO[bytes], line: dict[str, Any]) -> None:
    out.write(json.dumps(line).encode() + b"\n")
