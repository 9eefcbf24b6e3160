"""The sequences of KAIST's data sets on disk: `.seq` videos or directories of extracted images."""

from __future__ import annotations

import io
import re
from collections.abc import Collection, Iterator
from collections.abc import Sequence as Items
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL.TiffImagePlugin import TiffImageFile

from everplace.errors import ConfigError, ImageError, RouteError
from everplace.files import readable
from everplace.images.decoding import BROKEN_IMAGE_ERRORS, IMAGE_ENDINGS, MAX_PIXELS, read_image_bytes
from everplace.importing.containers.seq import SeqFile, open_seq
from everplace.importing.foreign_route import Content
from everplace.route.natural_order import natural_key, natural_sorted

__all__ = ["Sequence", "find_sequences", "visible_channels"]

_SET = re.compile(r"set[0-9]+", re.IGNORECASE)
_VIDEO = re.compile(r"(?:visible_)?(V[0-9]+)(?:\.seq)?", re.IGNORECASE)
_VISIBLE = "visible"


class Sequence(Protocol):
    """One drive.

    Attributes:
        set: The directory of its set, such as set00.
        video: Its number in the set, such as V000.
        frames: The names of its frames, such as I00000, in the order of travel.
        notes: Sentences that the user should read.
    """

    @property
    def set(self) -> str: ...

    @property
    def video(self) -> str: ...

    @property
    def frames(self) -> Items[str]: ...

    @property
    def notes(self) -> tuple[str, ...]: ...

    @property
    def key(self) -> str:
        """`SET/VIDEO`."""
        ...

    def __len__(self) -> int:
        """Returns the number of frames."""
        ...

    def seconds(self) -> NDArray[np.float64] | None:
        """Returns when each frame was taken, or None if nobody knows."""
        ...

    def read(self, indices: Items[int]) -> Iterator[tuple[Content, float]]:
        """Reads frames one by one, each with its time (NaN: not known)."""
        ...


@dataclass(frozen=True)
class _Video:
    set: str
    video: str
    file: SeqFile = field(repr=False)

    @property
    def key(self) -> str:
        return f"{self.set}/{self.video}"

    @property
    def frames(self) -> Items[str]:
        return [f"I{number:05d}" for number in range(len(self.file))]

    @property
    def notes(self) -> tuple[str, ...]:
        if not self.file.missing:
            return ()
        announced = len(self.file) + self.file.missing
        return (
            f"{readable(self.file.path)} is damaged or was cut off: {self.file.missing} of its {announced} frames are "
            f"lost, the first {len(self.file)} were kept.",
        )

    def __len__(self) -> int:
        return len(self.file)

    def seconds(self) -> NDArray[np.float64] | None:
        return np.array(self.file.seconds())

    def read(self, indices: Items[int]) -> Iterator[tuple[Content, float]]:
        for frame in self.file.frames(indices):
            yield frame.content, frame.seconds


@dataclass(frozen=True)
class _Images:
    set: str
    video: str
    directory: Path
    names: tuple[str, ...] = field(repr=False)
    notes: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        return f"{self.set}/{self.video}"

    @property
    def frames(self) -> Items[str]:
        return [name.rpartition(".")[0] for name in self.names]

    def __len__(self) -> int:
        return len(self.names)

    def seconds(self) -> NDArray[np.float64] | None:
        return None

    def read(self, indices: Items[int]) -> Iterator[tuple[Content, float]]:
        for index in indices:
            yield visible_channels(self.directory / self.names[index]), float("nan")


def find_sequences(source: Path, form: str, wanted: Collection[str]) -> list[Sequence]:
    """Finds the sequences of a copy and opens them; of videos, all frames are located.

    Args:
        source: The directory that holds `videos` or `images`, or one of these two.
        form: `videos`, `images`, or empty: images if there are some.
        wanted: Sequences `SET/VIDEO` or whole sets `SET`; empty: all.

    Returns:
        In natural order, at least one.

    Raises:
        RouteError: There is none, or one is damaged or empty.
        ConfigError: One that is wanted is not there.
    """
    found: dict[str, Path] = {}
    for kind in (form,) if form else ("images", "videos"):
        found = _in_sets(source / kind if (source / kind).is_dir() else source, videos=kind == "videos")
        if found:
            break
    if not found:
        raise RouteError(
            f"{readable(source)} holds neither videos/setNN/Visible_VNNN.seq nor images/setNN/VNNN; give the directory "
            "that holds videos or images"
        )
    for name in wanted:
        if not any(name in (key, key.partition("/")[0]) for key in found):
            raise ConfigError(f"sequences={name!r} is not there; there are: {', '.join(found)}")
    chosen = [key for key in found if not wanted or key in wanted or key.partition("/")[0] in wanted]
    return [_open(key, found[key]) for key in chosen]


def visible_channels(path: Path) -> Content:
    """Returns an image file as it is, or the first three channels of a TIFF with four, whatever it calls them.

    Raises:
        ImageError: A TIFF is missing, broken, or too large.
    """
    if path.suffix.lower() not in {".tif", ".tiff"}:
        return path
    try:
        with TiffImageFile(io.BytesIO(read_image_bytes(path))) as image:
            if len(image.getbands()) != 4:
                return path
            if image.width * image.height > MAX_PIXELS:
                raise ImageError(
                    f"{readable(path)} has {image.width}×{image.height} pixels, more than the limit of "
                    f"{MAX_PIXELS}; export the frame smaller"
                )
            pixels = np.asarray(image)
    except BROKEN_IMAGE_ERRORS as error:
        raise ImageError(f"{readable(path)} is truncated or broken ({error}); copy or export it again") from error
    return np.ascontiguousarray(pixels[:, :, :3], np.uint8)


def _in_sets(root: Path, *, videos: bool) -> dict[str, Path]:
    """Returns the video or directory of images of each sequence, by its key, in natural order."""
    found: dict[str, Path] = {}
    for directory in _children(root):
        if not _SET.fullmatch(directory.name) or not directory.is_dir():
            continue
        for path in _children(directory):
            match = _VIDEO.fullmatch(path.name)
            if match is None or (path.suffix.lower() == ".seq") != videos or path.is_dir() == videos:
                continue
            key = f"{directory.name}/{match[1].upper()}"
            if key in found:
                raise RouteError(f"{readable(path)} and {readable(found[key])} are the same sequence; keep one of them")
            found[key] = path
    return found


def _open(key: str, path: Path) -> Sequence:
    name, _, video = key.partition("/")
    if path.is_dir():
        return _open_images(name, video, path)
    return _Video(name, video, open_seq(path))


def _open_images(name: str, video: str, path: Path) -> _Images:
    directory = path / _VISIBLE if (path / _VISIBLE).is_dir() else path
    names = [
        file.name
        for file in _children(directory)
        if file.suffix.lower() in IMAGE_ENDINGS and not file.name.startswith(".")
    ]
    if not names:
        raise RouteError(f"{readable(directory)} holds no image; extract the frames, or leave the sequence out")
    stems = [file.rpartition(".")[0] for file in names]
    if len(set(stems)) < len(stems):
        twice = next(stem for stem in stems if stems.count(stem) > 1)
        raise RouteError(f"{readable(directory)} holds two images of the frame {twice!r}; keep one of them")
    ending = {file.rpartition(".")[0]: file for file in names}
    return _Images(name, video, directory, tuple(ending[stem] for stem in natural_sorted(stems)))


def _children(directory: Path) -> list[Path]:
    try:
        return sorted(directory.iterdir(), key=lambda path: natural_key(path.name))
    except OSError as error:
        raise RouteError(f"cannot list {readable(directory)}: {error.strerror or error}; check the path") from error
