"""From images to a descriptor file: the descriptors are written as they are made, so memory does not grow with them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from everplace.choices import DescriptorFormat
from everplace.describe.describer import Describer, PassingDescriptors
from everplace.describe.equal_descriptors import MajorityVote
from everplace.describe.files.descriptors import checked_names, checked_values, write_origin
from everplace.describe.files.hdf5 import OutputFile, blocks_of_rows, whole_hdf5, write_texts
from everplace.describe.files.hloc_layout import rows_of_groups, write_groups
from everplace.describe.recorded_frames import RecordedFrames
from everplace.progress import Progress, quiet
from everplace.route.traverse import Traverse

__all__ = ["describe_to_file"]

_BLOCK_BYTES = 2**20


def describe_to_file(
    describer: Describer,
    images: Traverse | RecordedFrames,
    path: Path,
    *,
    layout: DescriptorFormat = "everplace",
    directory: str = "",
    batch: int | None = None,
    progress: Progress = quiet,
) -> int:
    """Does what `Describer.describe` and `Descriptors.save` or `write_hloc` do, with two batches in memory.

    Args:
        describer: The method.
        images: What to describe.
        path: The file, which is written whole or not at all.
        layout: everplace's own, or hloc's.
        directory: What the image files lie in: comes before their names, with a slash; empty: nothing.
        batch: As for `describe`.
        progress: Shows how many images are described.

    Returns:
        The number of descriptors.

    Raises:
        EverplaceError: As `describe`, `save` and `write_hloc` raise.

    Warns:
        UserWarning: As `describe` warns.
    """
    passing = describer.describe_passing(images, batch=batch, progress=progress)
    image_names = passing.image_names
    if image_names is not None and directory:
        image_names = tuple(f"{directory}/{name}" for name in image_names)
    vote = MajorityVote()
    with whole_hdf5(path) as file:
        checked = _checked(passing, vote)
        if layout == "hloc":
            images_of_rows = passing.names if image_names is None else image_names
            write_groups(file, images_of_rows, checked)
            checked_names(images_of_rows)
            written = rows_of_groups(file, images_of_rows)
        else:
            dataset = _write_rows(file, checked, passing.expected, describer.dimension)
            write_texts(file, "names", checked_names(passing.names))
            if image_names is not None:
                write_texts(file, "image_names", checked_names(image_names))
            written = chain.from_iterable(blocks_of_rows(dataset))
        write_origin(file, describer.method, describer.metric, describer.settings())
        file.require_room()
        if passing.source is not None:
            vote.warn_of_equal(written, passing.source)
    return len(passing.names)


def _checked(passing: PassingDescriptors, vote: MajorityVote) -> Iterator[NDArray[np.float32]]:
    for number, row in enumerate(passing.rows):
        vote.see(row)
        yield checked_values(row[None], passing.names[number : number + 1])[0]


def _write_rows(
    file: OutputFile, rows: Iterator[NDArray[np.float32]], expected: int | None, dimension: int
) -> h5py.Dataset:
    """Writes N×D numbers of which N is known for sure only in the end."""
    at_once = max(1, _BLOCK_BYTES // (4 * dimension))
    if expected:  # chunks of one size, of which the last is nearly full too
        at_once = math.ceil(expected / math.ceil(expected / at_once))
    dataset = file.create_dataset(
        "descriptors", (0, dimension), np.float32, maxshape=(None, dimension), chunks=(at_once, dimension)
    )
    while block := list(islice(rows, at_once)):
        dataset.resize(len(dataset) + len(block), axis=0)
        dataset[-len(block) :] = np.stack(block)
        dataset.flush()  # else HDF5 keeps some chunks back, and with them the error
        file.require_room()
    return dataset
