"""Descriptors of a traverse: in memory, in everplace's HDF5 file, and in hloc's layout.

The file: dataset `descriptors` N×D float32, dataset `names` N UTF-8 strings, where known `image_names` N UTF-8
strings, and the attributes `method`, `metric`, `settings` (JSON), `everplace_version`.
A file from elsewhere needs the first two only: its method is then "unknown" and its metric cosine. hloc's layout
(`everplace.describe.files.hloc_layout`) gets the same attributes, which hloc does not look at.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, TypeAlias, cast, get_args

import h5py
import numpy as np
from numpy.typing import NDArray

from everplace.describe.files.hdf5 import whole_hdf5, write_texts
from everplace.describe.files.hdf5_content import read_hdf5
from everplace.describe.files.hloc_layout import write_groups
from everplace.errors import DescriptorsError
from everplace.files import readable, shortened
from everplace.images.decoding import is_image_name
from everplace.importing.containers.file_trees import stem_of
from everplace.route.natural_order import natural_key

__all__ = ["Descriptors", "Metric", "Settings", "checked_names", "checked_values", "load_descriptors", "write_origin"]

Metric: TypeAlias = Literal["cosine", "mean-absolute-difference", "place-posterior"]
Settings: TypeAlias = Mapping[str, str | int | float | bool]

_UNNAMEABLE = re.compile("[\0\ud800-\udc7f\udd00-\udfff]")  # surrogates, but for those of bytes that are not UTF-8


@dataclass(frozen=True, slots=True, eq=False)
class Descriptors:
    """N descriptors with the names of their frames and how they were made.

    Attributes:
        values: N×D float32, finite.
        names: N distinct names, frame by frame.
        method: The method that made them.
        metric: How two of them are compared.
        settings: All that changed the numbers; descriptors of other settings are not compared.
        image_names: N distinct names of the image files, with their endings, from the directory of images on, where
            they are known.
        path: The file that they were read from; None: none.

    Raises:
        DescriptorsError: The arrays and names do not fit together, or a value is not finite.
    """

    values: NDArray[np.float32]
    names: tuple[str, ...]
    method: str
    metric: Metric = "cosine"
    settings: Settings = field(default_factory=dict)
    image_names: tuple[str, ...] | None = None
    path: Path | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", checked_names(self.names))
        if self.image_names is not None:
            object.__setattr__(self, "image_names", checked_names(self.image_names))
            if len(self.image_names) != len(self.names):
                raise DescriptorsError(f"there are {len(self.image_names)} image names for {len(self.names)} names")
        object.__setattr__(self, "values", checked_values(self.values, self.names))
        if self.metric not in get_args(Metric):
            raise DescriptorsError(
                f"the metric must be one of {', '.join(get_args(Metric))}, not {shortened(self.metric)!r}"
            )

    def __repr__(self) -> str:
        return f"Descriptors({self.method}: {len(self)}×{self.dimension}, {self.metric})"

    def __len__(self) -> int:
        return len(self.names)

    @property
    def dimension(self) -> int:
        """D, the number of values of one descriptor."""
        return int(self.values.shape[1])

    @property
    def known_as(self) -> str:
        """What messages call them: their method, and the file that they were read from."""
        method = shortened(readable(self.method))
        return method if self.path is None else f"{method} ({readable(self.path)})"

    def of(self, names: Sequence[str]) -> Descriptors:
        """The descriptors of the frames with these names, in the order given.

        Raises:
            DescriptorsError: A name is not among them, or occurs twice.
        """
        if tuple(names) == self.names:
            return self
        position = {name: index for index, name in enumerate(self.names)}
        for name in names:
            if name not in position:
                raise DescriptorsError(
                    f"there is no descriptor of the frame {shortened(readable(name))!r}; describe it too"
                )
        return self.take([position[name] for name in names])

    def take(self, frames: slice | Sequence[int]) -> Descriptors:
        """The descriptors of the frames at these positions, in the order given; no position twice."""
        rows = np.arange(len(self))[frames].tolist()
        image_names = self.image_names
        return replace(
            self,
            values=self.values[frames],
            names=tuple(self.names[row] for row in rows),
            image_names=None if image_names is None else tuple(image_names[row] for row in rows),
        )

    def under(self, directory: str) -> Descriptors:
        """The same, the image files named from further up: `directory` and a slash come before each name."""
        if self.image_names is None:
            return self
        return replace(self, image_names=tuple(f"{directory}/{name}" for name in self.image_names))

    def save(self, path: str | Path) -> None:
        """Writes everplace's HDF5 file, whole or not at all.

        Raises:
            StorageError: The place cannot be written to.
        """
        with whole_hdf5(Path(path)) as file:
            file["descriptors"] = self.values
            write_texts(file, "names", self.names)
            if self.image_names is not None:
                write_texts(file, "image_names", self.image_names)
            write_origin(file, self.method, self.metric, self.settings)

    def write_hloc(self, path: str | Path) -> None:
        """Writes hloc's layout, see `everplace.describe.files.hloc_layout`; without image names, by the names.

        Raises:
            DescriptorsError: A name cannot be an HDF5 group: it is not UTF-8, holds a line break, has an empty part,
                or is the directory of another.
            StorageError: The place cannot be written to.
        """
        with whole_hdf5(Path(path)) as file:
            write_groups(file, self.names if self.image_names is None else self.image_names, self.values)
            write_origin(file, self.method, self.metric, self.settings)


def write_origin(file: h5py.File, method: str, metric: Metric, settings: Settings) -> None:
    """Writes how the descriptors of a file were made, as its attributes."""
    file.attrs["method"] = method
    file.attrs["metric"] = metric
    file.attrs["settings"] = json.dumps(dict(settings), sort_keys=True)
    file.attrs["everplace_version"] = version("everplace")


def load_descriptors(path: str | Path) -> Descriptors:
    """Reads everplace's HDF5 file of descriptors, or hloc's layout, whose frames come in natural order of their stems.

    Raises:
        DescriptorsError: The file is missing, is no such file, or its parts do not fit together.
    """
    path = Path(path)
    if not path.is_file():
        raise DescriptorsError(f"there is no descriptor file {readable(path)}; make one with `everplace describe`")
    content = read_hdf5(path)
    names, image_names, values = content.names, content.image_names, content.values
    try:
        if names is None:
            names, order = _natural_order(image_names or ())
            image_names, values = tuple((image_names or ())[index] for index in order), values[order]
        metric = cast("Metric", content.metric)
        return Descriptors(values, names, content.method, metric, _settings(content.settings), image_names, path)
    except DescriptorsError as error:
        raise DescriptorsError(f"{readable(path)} cannot be read: {error}") from error


def _natural_order(image_names: tuple[str, ...]) -> tuple[tuple[str, ...], list[int]]:
    """The stems of images as an imported route has them, in natural order, and the places of the images.

    A name without an image's ending is kept as it is.
    """
    found: dict[str, int] = {}
    for index, image in enumerate(image_names):
        stem = stem_of(image) if is_image_name(image) else image
        if stem in found:
            raise DescriptorsError(
                f"the images {shortened(readable(image_names[found[stem]]))!r} and {shortened(readable(image))!r} have "
                "one stem; rename one of them"
            )
        found[stem] = index
    names = tuple(sorted(found, key=natural_key))
    return names, [found[name] for name in names]


def _settings(text: str) -> Settings:
    try:
        settings = json.loads(text)
    except ValueError as error:
        raise DescriptorsError(f"its attribute `settings` is no JSON ({error})") from error
    if not isinstance(settings, dict) or not all(isinstance(v, str | int | float) for v in settings.values()):
        raise DescriptorsError("its attribute `settings` must be a JSON object of texts, numbers, true and false")
    return settings


def checked_names(names: Sequence[str]) -> tuple[str, ...]:
    """Returns names of frames.

    Raises:
        DescriptorsError: One of them cannot name a frame, or occurs twice.
    """
    names = tuple(names)
    for name in names:
        if not name or _UNNAMEABLE.search(name):
            raise DescriptorsError(f"{shortened(name)!r} cannot name a frame; give it a name that a file could have")
    if len(set(names)) < len(names):
        twice = Counter(names).most_common(1)[0][0]
        raise DescriptorsError(f"the name {shortened(readable(twice))!r} occurs twice; every frame needs its own")
    return names


def checked_values(values: NDArray[Any], names: Sequence[str]) -> NDArray[np.float32]:
    """Returns N×D descriptors as float32.

    Args:
        values: The numbers.
        names: N, for the message.

    Raises:
        DescriptorsError: They are no N×D floating-point numbers, N is 0, or one is not finite.
    """
    values = np.asarray(values)
    if values.dtype.kind != "f":
        raise DescriptorsError(f"the descriptors must be floating-point numbers, not {values.dtype}")
    if values.ndim != 2 or values.size == 0:
        raise DescriptorsError(
            f"the descriptors must be N×D numbers of at least one frame, not of shape {values.shape}"
        )
    if len(values) != len(names):
        raise DescriptorsError(f"there are {len(values)} rows of descriptors for {len(names)} names")
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is named below
        values = np.ascontiguousarray(values, np.float32)
    finite = np.isfinite(values.min(axis=1)) & np.isfinite(values.max(axis=1))  # both hand NaN on
    if not finite.all():
        name = names[int(np.argmin(finite))]
        raise DescriptorsError(
            f"the descriptor of frame {shortened(readable(name))!r} holds NaN or infinity; look at its image"
        )
    return values
