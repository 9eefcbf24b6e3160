"""The sequences of KAIST's data sets on disk: `.seq` videos or directories of extracted images."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL.TiffImagePlugin import TiffImageFile

from everplace.errors import ConfigError, ImageError, RouteError
from everplace.files import readable
from everplace.git_lfs import refuse_pointer
from everplace.images.decoding import BROKEN_IMAGE_ERRORS, MAX_PIXELS, read_image_bytes
from everplace.images.frame_names import choose_frames
from everplace.importing.containers.file_trees import TreePath, by_stem
from everplace.importing.containers.seq import open_seq
from everplace.importing.foreign_route import Content
from everplace.route.natural_order import natural_sorted
from everplace.warning_source import warnings_of

__all__ = ["KaistSequence", "find_sequences", "visible_channels"]

_SET = re.compile(r"set[0-9]+", re.IGNORECASE)
_VIDEO = re.compile(r"(?:visible_)?(V[0-9]+)(?:\.seq)?", re.IGNORECASE)
_VISIBLE = "visible"


@dataclass(frozen=True)
class KaistSequence:
    """One drive.

    Attributes:
        key: Its set and its number there, such as set00/V000.
        frames: The names of its frames, such as I00000, in the order of travel.
        read: Reads the frames of given numbers one by one, each with its time (NaN: not known).
        seconds: Reads when each frame was taken; None if nobody knows.
        notes: Sentences that the user should read.
    """

    key: str
    frames: Sequence[str] = field(repr=False)
    read: Callable[[Sequence[int]], Iterator[tuple[Content, float]]] = field(repr=False)
    seconds: Callable[[], NDArray[np.float64] | None] = field(repr=False)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Returns the number of frames."""
        return len(self.frames)


def find_sequences(source: Path, form: str, wanted: Collection[str]) -> list[KaistSequence]:
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
    found: dict[str, TreePath] = {}
    top = TreePath(source)
    for kind in (form,) if form else ("images", "videos"):
        found = _in_sets(top / kind if (top / kind).is_dir() else top, videos=kind == "videos")
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
        refuse_pointer(path, ImageError)
        with warnings_of(readable(path)), TiffImageFile(io.BytesIO(read_image_bytes(path))) as image:
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


def _in_sets(root: TreePath, *, videos: bool) -> dict[str, TreePath]:
    """Returns the video or directory of images of each sequence, by its key, in natural order."""
    found: dict[str, TreePath] = {}
    for name in filter(_SET.fullmatch, root.children().directories):
        inside = (root / name).children()
        for video in inside.files if videos else inside.directories:
            match = _VIDEO.fullmatch(video)
            if match is None or video.lower().endswith(".seq") != videos:
                continue
            key, path = f"{name}/{match[1].upper()}", root / name / video
            if key in found:
                raise RouteError(f"{readable(path)} and {readable(found[key])} are the same sequence; keep one of them")
            found[key] = path
    return found


def _open(key: str, path: TreePath) -> KaistSequence:
    return _open_images(key, path) if path.is_dir() else _open_video(key, path.source)


def _open_video(key: str, path: Path) -> KaistSequence:
    file = open_seq(path)
    notes: tuple[str, ...] = ()
    if file.missing:
        notes = (
            f"{readable(path)} is damaged or was cut off: {file.missing} of its {len(file) + file.missing} frames are "
            f"lost, the first {len(file)} were kept.",
        )
    return KaistSequence(
        key,
        [f"I{number:05d}" for number in range(len(file))],
        lambda indices: ((frame.content, frame.seconds) for frame in file.frames(indices)),
        lambda: np.array(file.seconds()),
        notes,
    )


def _open_images(key: str, path: TreePath) -> KaistSequence:
    directory = path / _VISIBLE if (path / _VISIBLE).is_dir() else path
    names = by_stem(directory, choose_frames(directory, directory.children().files))
    if not names:
        raise RouteError(f"{readable(directory)} holds no image; extract the frames, or leave the sequence out")
    stems = natural_sorted(names)
    return KaistSequence(
        key,
        stems,
        lambda indices: ((visible_channels(directory.source / names[stems[index]]), float("nan")) for index in indices),
        lambda: None,
    )
