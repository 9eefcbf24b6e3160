"""hloc's layout of global descriptors in HDF5: a group for every image, which holds the dataset `global_descriptor`.

The group's path is the image's, with its ending, from the directory of images on. The layout keeps no order. Sarlin
et al., "From Coarse to Fine: Robust Hierarchical Localization at Large Scale", CVPR 2019.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from everplace.describe.files.hdf5 import OutputFile, require_own_numbers
from everplace.errors import DescriptorsError
from everplace.files import readable

__all__ = ["is_hloc_layout", "read_groups", "rows_of_groups", "write_groups"]

_GLOBAL = "global_descriptor"
_OWN = ("descriptors", "names")


def is_hloc_layout(file: h5py.File) -> bool:
    """Whether a file has none of the datasets of everplace's own layout; directories may be called like them."""
    links = {name: file.get(name, getlink=True) for name in _OWN}
    return all(
        link is None or (isinstance(link, h5py.HardLink) and isinstance(file[name], h5py.Group))
        for name, link in links.items()
    )


def write_groups(file: OutputFile, images: Iterable[str], values: Iterable[NDArray[np.float32]]) -> None:
    """Writes a group for every image (`/` nests).

    Args:
        file: The file to fill.
        images: N names.
        values: (D,) each.

    Raises:
        DescriptorsError: A name cannot be an HDF5 group: it is not UTF-8, holds a line break, has an empty part, or is
            the directory of another.
    """
    for row, image in zip(values, images, strict=True):  # names may be told as the rows are made
        reserved = any(part in {"", ".", _GLOBAL} for part in image.split("/"))
        if reserved or readable(image) != image or image in file:
            raise DescriptorsError(
                f"{readable(image)!r} cannot name a group in hloc's layout; rename the image or write everplace's own "
                "format"
            )
        file.create_group(image)[_GLOBAL] = row
        file.require_room()


def rows_of_groups(file: h5py.File, images: Sequence[str]) -> Iterator[NDArray[np.float32]]:
    """Reads what `write_groups` wrote."""
    for image in images:
        yield file[image][_GLOBAL][:]


def read_groups(file: h5py.File) -> tuple[tuple[str, ...], NDArray[Any]]:
    """Reads the descriptors of all images, in the order of the file.

    Links are not followed, and what else a group holds is left alone.

    Args:
        file: The file.

    Returns:
        N names of images, and N×D floating-point numbers.

    Raises:
        DescriptorsError: It holds no `global_descriptor`, or one that is not as many numbers as the others.
    """
    rows: dict[str, NDArray[Any]] = {}
    file_bytes = file.id.get_filesize()

    def take(path: str, item: Any) -> None:
        image, _, last = path.rpartition("/")
        if image and last == _GLOBAL and isinstance(item, h5py.Dataset):
            rows[image] = _row(item, path, file_bytes)

    file.visititems(take)
    if not rows:
        raise DescriptorsError(
            f"it holds neither datasets `descriptors` and `names` nor a group for each image with `{_GLOBAL}`; make it "
            "with `everplace describe`"
        )
    first, length = next((image, len(row)) for image, row in rows.items())
    for image, row in rows.items():
        if len(row) != length:
            raise DescriptorsError(
                f"the descriptor of {readable(image)!r} has {len(row)} numbers and that of {readable(first)!r} "
                f"{length}; describe both alike"
            )
    return tuple(rows), np.stack(list(rows.values()))


def _row(dataset: Any, path: str, file_bytes: int) -> NDArray[Any]:
    if dataset.dtype.kind != "f" or dataset.ndim != 1:
        raise DescriptorsError(
            f"`{readable(path)}` must be D floating-point numbers, not {dataset.dtype} of {dataset.shape}"
        )
    require_own_numbers(dataset, readable(path), file_bytes)
    return np.asarray(dataset[:])
