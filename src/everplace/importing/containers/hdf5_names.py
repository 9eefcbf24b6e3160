"""The images that an HDF5 file names, read in a child process: libhdf5 crashes on damaged files, or never ends."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import IO, Any

from everplace.child_process import ChildError, file_limits, output_of_child
from everplace.errors import RouteError
from everplace.files import readable
from everplace.git_lfs import refuse_pointer
from everplace.importing.containers.file_trees import TreePath

__all__ = ["read_image_names"]

_OWN_NAMES = ("image_names", "names")  # everplace's own layout; older files have the second alone


def read_image_names(path: TreePath) -> list[str]:
    """Returns the names of the images in a file of features or descriptors.

    They are those of everplace's own layout, or else the paths of the groups that hold no more groups.

    Raises:
        RouteError: The file is missing, damaged, or no such file.
    """
    if path.is_on_disk:
        refuse_pointer(path.source, RouteError)
        return _from_child(path.source, path)
    with path.open() as file, tempfile.TemporaryDirectory() as directory:
        unpacked = Path(directory) / "names.h5"
        unpacked.write_bytes(file.read())
        return _from_child(unpacked, path)


def _from_child(file: Path, named: os.PathLike[str]) -> list[str]:
    try:
        seconds, memory = file_limits(file)
        with output_of_child(_send, str(file), seconds=seconds, memory=memory) as sent:
            answer = sent.read()
            if not answer.endswith(b"\n"):
                raise EOFError
            received: dict[str, Any] = json.loads(answer)
        if "names" in received:
            return [str(name) for name in received["names"]]
        reason = received["damaged"]
    except (ChildError, OSError) as error:
        reason = str(error)
    raise RouteError(f"{readable(named)} is not a readable HDF5 file ({reason}); get it again")


def _send(out: IO[bytes], path: str) -> None:
    """Writes the names, or what is wrong, as a line of JSON."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            own = next((name for name in _OWN_NAMES if isinstance(file.get(name), h5py.Dataset)), None)
            names = _leaf_groups(file) if own is None else [str(name) for name in file[own].asstr()[:].ravel()]
        answer: dict[str, Any] = {"names": names}
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:  # what h5py raises for a damaged file
        answer = {"damaged": str(error).splitlines()[0][:200] if str(error) else type(error).__name__}
    out.write(json.dumps(answer).encode() + b"\n")


def _leaf_groups(file: Any) -> list[str]:
    """The groups that hold no group; each is visited once, and links are not followed, so nothing leads in circles."""
    import h5py

    groups: list[str] = []

    def note(name: str, item: object) -> None:
        if isinstance(item, h5py.Group):
            groups.append(name)

    file.visititems(note)
    holders = {group.rpartition("/")[0] for group in groups}
    return [group for group in groups if group not in holders]
