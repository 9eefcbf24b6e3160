"""Descriptors of a traverse: in memory, in everplace's HDF5 file, and in hloc's layout.

The file: dataset `descriptors` N×D float32, dataset `names` N UTF-8 strings, where known `variance` N×D
float32, and the attributes `method`, `metric`, `settings` (JSON), `everplace_version`. A file from elsewhere
needs the first two only: its method is then "unknown" and its metric cosine.
"""

from __future__ import annotations

import importlib.metadata
import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast, get_args

import h5py
import numpy as np
from numpy.typing import NDArray

from everplace.describe.protocol import Metric, Settings
from everplace.errors import DescriptorsError
from everplace.files import readable, write_bytes

__all__ = ["Descriptors", "load_descriptors"]

_BYTES_OF_NAMES = "surrogateescape"  # a name that is not UTF-8 keeps its bytes, as Python's file names do
_GROWS_BY = 2**20
_MOST_COMPRESSED = 1000  # bytes out of one, about what deflate reaches on zeros
_NAMES_AT_ONCE = 64


@dataclass(frozen=True, slots=True, eq=False)
class Descriptors:
    """N descriptors with the names of their frames and how they were made.

    Attributes:
        values: N×D float32, finite.
        names: N distinct names, frame by frame.
        method: The method that made them.
        metric: How two of them are compared.
        settings: All that changed the numbers; descriptors of other settings are not compared.
        variance: N×D float32, finite and not negative, where the method knows it.

    Raises:
        DescriptorsError: The arrays and names do not fit together, or a value is not finite.
    """

    values: NDArray[np.float32]
    names: tuple[str, ...]
    method: str
    metric: Metric = "cosine"
    settings: Settings = field(default_factory=dict)
    variance: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        self._check_names()
        object.__setattr__(self, "values", self._checked(self.values, "descriptors"))
        if self.metric not in get_args(Metric):
            raise DescriptorsError(f"the metric must be one of {', '.join(get_args(Metric))}, not {self.metric!r}")
        if self.variance is not None:
            object.__setattr__(self, "variance", self._checked_variance(self.variance))

    def __len__(self) -> int:
        return len(self.names)

    @property
    def dimension(self) -> int:
        """D, the number of values of one descriptor."""
        return int(self.values.shape[1])

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
                raise DescriptorsError(f"there is no descriptor of the frame {readable(name)!r}; describe it too")
        rows = [position[name] for name in names]
        return replace(
            self,
            values=self.values[rows],
            names=tuple(names),
            variance=None if self.variance is None else self.variance[rows],
        )

    def _checked(self, array: NDArray[Any], what: str) -> NDArray[np.float32]:
        array = np.asarray(array)
        if array.dtype.kind != "f":
            raise DescriptorsError(f"the {what} must be floating-point numbers, not {array.dtype}")
        if array.ndim != 2 or array.size == 0:
            raise DescriptorsError(f"the {what} must be N×D numbers of at least one frame, not of shape {array.shape}")
        if len(array) != len(self.names):
            raise DescriptorsError(f"there are {len(array)} rows of {what} for {len(self.names)} names")
        with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is named below
            array = np.ascontiguousarray(array, np.float32)
        finite = np.isfinite(array.min(axis=1)) & np.isfinite(array.max(axis=1))  # both hand NaN on
        if not finite.all():
            name = self.names[int(np.argmin(finite))]
            raise DescriptorsError(f"the {what} of frame {readable(name)!r} holds NaN or infinity; look at its image")
        return array

    def _check_names(self) -> None:
        for name in self.names:
            if not name or "\0" in name or not _is_encodable(name):
                raise DescriptorsError(f"{name!r} cannot name a frame; give it a name that a file could have")
        if len(set(self.names)) < len(self.names):
            twice = Counter(self.names).most_common(1)[0][0]
            raise DescriptorsError(f"the name {readable(twice)!r} occurs twice; every frame needs its own")

    def _checked_variance(self, array: NDArray[Any]) -> NDArray[np.float32]:
        variance = self._checked(array, "variance")
        if variance.shape != self.values.shape:
            raise DescriptorsError(
                f"the variance has shape {variance.shape}, not {self.values.shape} as the descriptors"
            )
        negative = variance.min(axis=1) < 0
        if negative.any():
            name = self.names[int(np.argmax(negative))]
            raise DescriptorsError(f"the variance of frame {readable(name)!r} is negative; look at the model")
        return variance

    def save(self, path: str | Path) -> None:
        """Writes everplace's HDF5 file, whole or not at all.

        Raises:
            StorageError: The place cannot be written to.
        """
        with _in_memory() as file:
            file["descriptors"] = self.values
            if self.variance is not None:
                file["variance"] = self.variance
            encoded = [name.encode("utf-8", _BYTES_OF_NAMES) for name in self.names]
            file.create_dataset("names", data=encoded, dtype=h5py.string_dtype("utf-8"))
            self._write_attributes(file)
            image = _image(file)
        write_bytes(Path(path), image)

    def write_hloc(self, path: str | Path) -> None:
        """Writes hloc's layout: a group for every name (`/` nests) that holds `global_descriptor`, D float32.

        Raises:
            DescriptorsError: A name cannot be an HDF5 group: it is not UTF-8, holds a line break, has an empty part,
                or is the directory of another.
            StorageError: The place cannot be written to.
        """
        with _in_memory() as file:
            for name, row in zip(self.names, self.values, strict=True):
                parts = name.split("/")
                reserved = any(part in {"", ".", "global_descriptor"} for part in parts)
                if reserved or readable(name) != name or name in file:
                    raise DescriptorsError(
                        f"{readable(name)!r} cannot name a group in hloc's layout; rename the image or write "
                        "everplace's own format"
                    )
                file.create_group(name)["global_descriptor"] = row
            self._write_attributes(file)
            image = _image(file)
        write_bytes(Path(path), image)

    def _write_attributes(self, file: h5py.File) -> None:
        file.attrs["method"] = self.method
        file.attrs["metric"] = self.metric
        file.attrs["settings"] = json.dumps(dict(self.settings), sort_keys=True)
        file.attrs["everplace_version"] = _version()


def load_descriptors(path: str | Path) -> Descriptors:
    """Reads everplace's HDF5 file of descriptors.

    Raises:
        DescriptorsError: The file is missing, is no such file, or its parts do not fit together.
    """
    path = Path(path)
    if not path.is_file():
        raise DescriptorsError(f"there is no descriptor file {readable(path)}; make one with `everplace describe`")
    try:
        with h5py.File(path, "r") as file:
            return _read(file)
    except DescriptorsError as error:
        raise DescriptorsError(f"{readable(path)} cannot be read: {error}") from error
    except (
        OSError,
        RuntimeError,
        KeyError,
        ValueError,
        TypeError,
    ) as error:  # what h5py raises for a damaged file
        raise DescriptorsError(
            f"{readable(path)} is no readable HDF5 file ({error}); make it again with `everplace describe`"
        ) from error


def _in_memory() -> h5py.File:
    """A file to fill in memory: HDF5 itself crashes, or leaves its file behind, where the disk is full."""
    return h5py.File("descriptors", "w", driver="core", backing_store=False, block_size=_GROWS_BY)


def _image(file: h5py.File) -> bytes:
    file.flush()
    return cast("bytes", file.id.get_file_image())


def _read(file: h5py.File) -> Descriptors:
    values = _dataset(file, "descriptors")
    names = _dataset(file, "names")
    if h5py.check_string_dtype(names.dtype) is None or names.ndim != 1:
        raise DescriptorsError(f"`names` must be a list of strings, not {names.dtype} of shape {names.shape}")
    if values.ndim == 2 and len(names) != len(values):
        raise DescriptorsError(f"there are {len(values)} rows of descriptors for {len(names)} names")
    return Descriptors(
        values=_numbers(values, "descriptors"),
        names=_texts(names),
        method=_text(file, "method", "unknown"),
        metric=cast("Metric", _text(file, "metric", "cosine")),
        settings=_settings(_text(file, "settings", "{}")),
        variance=_numbers(_dataset(file, "variance"), "variance") if "variance" in file else None,
    )


def _dataset(file: h5py.File, name: str) -> Any:
    """Finds a dataset; one that keeps its numbers elsewhere, or too few for what it announces, is refused."""
    link = file.get(name, getlink=True)
    if link is not None and not isinstance(link, h5py.HardLink):
        raise DescriptorsError(f"`{name}` is a link to another place; write the numbers into the file itself")
    if not isinstance(found := file.get(name), h5py.Dataset):
        raise DescriptorsError(f"it holds no dataset `{name}`; make it again with `everplace describe`")
    if found.is_virtual or found.external:
        raise DescriptorsError(f"`{name}` keeps its numbers in other files; write them into the file itself")
    _check_size(found, name, file.id.get_filesize())
    return found


def _check_size(dataset: Any, name: str, file_bytes: int) -> None:
    """Refuses what announces more than it can hold: else a file of 1 KB could ask for all memory."""
    stored = min(dataset.id.get_storage_size(), file_bytes)
    compressed = dataset.id.get_create_plist().get_nfilters() > 0
    entries = max(dataset.size or 0, math.prod(dataset.chunks or (0,)))  # a chunk is read whole
    if dataset.size and entries * dataset.dtype.itemsize > stored * (_MOST_COMPRESSED if compressed else 1):
        raise DescriptorsError(f"`{name}` announces the shape {dataset.shape}, but holds only {stored} bytes")


def _numbers(dataset: Any, what: str) -> NDArray[Any]:
    """Reads an array, after a look at its type: object types are refused before anything of them is read."""
    if dataset.dtype.kind != "f" or dataset.ndim != 2:
        raise DescriptorsError(f"`{what}` must be N×D floating-point numbers, not {dataset.dtype} of {dataset.shape}")
    return np.asarray(dataset[:])


def _texts(dataset: Any) -> tuple[str, ...]:
    """Reads strings bit by bit: all of them may point at the same long text."""
    texts: list[str] = []
    total = 0
    most = max(dataset.file.id.get_filesize(), dataset.nbytes)
    for start in range(0, len(dataset), _NAMES_AT_ONCE):
        texts.extend(dataset.asstr("utf-8", _BYTES_OF_NAMES)[start : start + _NAMES_AT_ONCE])
        total += sum(map(len, texts[start:]))
        if total > most:
            raise DescriptorsError("its `names` are longer than the file; make it again with `everplace describe`")
    return tuple(texts)


def _text(file: h5py.File, name: str, default: str) -> str:
    value = file.attrs.get(name, default)
    if not isinstance(value, str):
        raise DescriptorsError(f"its attribute `{name}` must be text, not {type(value).__name__}")
    return value


def _settings(text: str) -> Settings:
    try:
        settings = json.loads(text)
    except ValueError as error:
        raise DescriptorsError(f"its attribute `settings` is no JSON ({error})") from error
    if not isinstance(settings, dict) or not all(isinstance(v, str | int | float) for v in settings.values()):
        raise DescriptorsError("its attribute `settings` must be a JSON object of texts, numbers, true and false")
    return settings


def _is_encodable(name: str) -> bool:
    try:
        name.encode("utf-8", _BYTES_OF_NAMES)
    except UnicodeEncodeError:  # half of a surrogate pair
        return False
    return True


def _version() -> str:
    try:
        return importlib.metadata.version("everplace")
    except importlib.metadata.PackageNotFoundError:  # run from a source tree that is not installed
        return "unknown"
