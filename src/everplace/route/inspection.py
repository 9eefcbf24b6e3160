"""Looking at every file of a route: what is broken, doubled, dark, standing or left out.

Every image is read and decoded once. Its 64×32 grey picture, which the filters of `selection` judge, goes to a file
without a name in the cache directory, so memory does not grow with the route beyond some bytes a frame.
"""

from __future__ import annotations

import hashlib
import tempfile
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ImageError, StorageError
from everplace.files import cache_directory, readable
from everplace.images.decoding import decode_encoded, read_image_bytes
from everplace.images.formats import image_size
from everplace.images.sixteen_bits import SixteenBits
from everplace.progress import Progress, quiet
from everplace.route.natural_order import natural_sorted
from everplace.route.numbering import Gap, find_gaps
from everplace.route.route import Route
from everplace.route.selection import FILTER_IMAGE, dark_places, stationary_places
from everplace.route.traverse import Traverse
from everplace.threads import map_ahead

__all__ = ["Inspection", "Stretch", "TraverseInspection", "inspect_route"]

_BLOCK = 512
_DIGEST_BYTES = 16
_ALIKE_BELOW = 1.0
_HEIGHT, _WIDTH = FILTER_IMAGE.size or (32, 64)


class Stretch(NamedTuple):
    """Places in a row.

    Attributes:
        first: Stem of the first.
        last: Stem of the last.
        places: How many.
    """

    first: str
    last: str
    places: int


@dataclass(frozen=True)
class TraverseInspection:
    """What one traverse holds.

    Attributes:
        traverse: The traverse.
        bytes: Size of its readable files together.
        sizes: How many pictures have each (H, W).
        unreadable: Why a frame cannot be decoded, by stem; the message names the file.
        dark: N bool, whether a frame's mean grey value is below that of `selection.dark_places`.
        stationary: N bool, whether it looks like the last kept frame of this traverse (`selection.stationary_places`).
        alike: N bool, whether it is almost the picture of the frame before, though another file: their grey values at
            64×32 differ by less than 1 of 255 on average. Dark frames are not counted.
        gaps: Numbers that are left out; None: the frames are not numbered.
        missing: Stems that another traverse has and this one lacks, in natural order.
    """

    traverse: Traverse
    bytes: int
    sizes: Mapping[tuple[int, int], int]
    unreadable: Mapping[str, str]
    dark: NDArray[np.bool_]
    stationary: NDArray[np.bool_]
    alike: NDArray[np.bool_]
    gaps: tuple[Gap, ...] | None
    missing: tuple[str, ...]


@dataclass(frozen=True)
class Inspection:
    """What a route holds.

    Attributes:
        traverses: In the route's order.
        places: The P stems that all traverses share, in natural order.
        broken: P bool, whether some traverse's frame of the place is unreadable.
        dark: P bool, what `--drop-dark` leaves out, broken places apart.
        stationary: P bool, what `--drop-stationary` leaves out of those that are neither dark nor broken.
        duplicates: Frames whose files are the same byte for byte, as `traverse/stem`, a group a row.
    """

    traverses: tuple[TraverseInspection, ...]
    places: tuple[str, ...]
    broken: NDArray[np.bool_]
    dark: NDArray[np.bool_]
    stationary: NDArray[np.bool_]
    duplicates: tuple[tuple[str, ...], ...]

    @property
    def kept(self) -> tuple[str, ...]:
        """The places that both filters leave and that can be read."""
        kept = ~(self.broken | self.dark | self.stationary)
        return tuple(self.places[index] for index in np.flatnonzero(kept))

    @property
    def tunnels(self) -> tuple[Stretch, ...]:
        """Where dark places follow each other."""
        return _stretches(self.places, self.dark)

    @property
    def stops(self) -> tuple[Stretch, ...]:
        """Where stationary places follow each other."""
        return _stretches(self.places, self.stationary)


def inspect_route(route: Route, progress: Progress = quiet) -> Inspection:
    """Looks at every file of a route; a warning counts 16-bit frames that use a small part of their range.

    Args:
        route: The traverses; frames that cannot be decoded are noted, not raised.
        progress: Told of the frames.

    Returns:
        What was found.

    Raises:
        StorageError: The small pictures cannot be kept in the cache directory meanwhile.
    """
    looks = [_look_at_all(traverse, progress) for traverse in route.traverses]
    everything = natural_sorted(frozenset().union(*(traverse.stems for traverse in route.traverses)))
    wanted = everything if route.stems_are_places else []
    places = route.shared_stems()
    rows = [_positions(traverse, places) for traverse in route.traverses]
    broken = np.logical_or.reduce([look.broken[row] for look, row in zip(looks, rows, strict=True)])
    dark = np.logical_or.reduce([look.dark[row] for look, row in zip(looks, rows, strict=True)])
    small = [_take(look.small, row) for look, row in zip(looks, rows, strict=True)]
    candidates = ~(broken | dark)
    return Inspection(
        traverses=tuple(
            _summary(traverse, look, wanted) for traverse, look in zip(route.traverses, looks, strict=True)
        ),
        places=places,
        broken=broken,
        dark=dark & ~broken,
        stationary=stationary_places(small, candidates),
        duplicates=_duplicates(route.traverses, looks),
    )


class _Look(NamedTuple):
    """One file."""

    digest: bytes
    bytes: int
    size: tuple[int, int]
    pixels: NDArray[np.uint8]
    problem: str
    scale: SixteenBits


@dataclass(frozen=True)
class _Looks:
    """All files of a traverse: N×16 digests, N×32×64 small pictures on disk, and what else is known of them."""

    digests: NDArray[np.uint8]
    small: NDArray[np.uint8]
    broken: NDArray[np.bool_]
    dark: NDArray[np.bool_]
    bytes: int
    sizes: Mapping[tuple[int, int], int]
    problems: Mapping[str, str]


def _look_at(path: Path) -> _Look:
    scale = SixteenBits()
    try:
        data = read_image_bytes(path)
        pixels = decode_encoded(readable(path), data, FILTER_IMAGE, scale)
    except ImageError as error:
        nothing = np.zeros((_HEIGHT, _WIDTH, 1), dtype=np.uint8)
        return _Look(bytes(_DIGEST_BYTES), 0, (0, 0), nothing, str(error), scale)
    digest = hashlib.sha256(data).digest()[:_DIGEST_BYTES]
    return _Look(digest, len(data), image_size(readable(path), data), pixels, "", scale)


def _look_at_all(traverse: Traverse, progress: Progress) -> _Looks:
    N = len(traverse)
    digests = np.zeros((N, _DIGEST_BYTES), dtype=np.uint8)
    broken = np.zeros(N, dtype=np.bool_)
    sizes: Counter[tuple[int, int]] = Counter()
    problems: dict[str, str] = {}
    total = 0
    scale = SixteenBits()

    def pictures() -> Iterator[NDArray[np.uint8]]:
        nonlocal total
        looks = map_ahead(_look_at, (frame.path for frame in traverse))
        for index, look in enumerate(progress(looks, f"looking at {traverse.name}", N)):
            digests[index] = np.frombuffer(look.digest, dtype=np.uint8)
            total += look.bytes
            scale.add(look.scale)
            if look.problem:
                broken[index] = True
                problems[traverse.stems[index]] = look.problem
            else:
                sizes[look.size] += 1
            yield look.pixels

    small = _on_disk(pictures(), N)
    for note in scale.notes(readable(traverse.name)):
        warnings.warn(note, stacklevel=1)
    return _Looks(digests, small, broken, dark_places([small]) & ~broken, total, sizes, problems)


def _on_disk(pictures: Iterable[NDArray[np.uint8]], count: int) -> NDArray[np.uint8]:
    """Maps pictures from a file that has no name, so that the system removes it with its last user."""
    if not count:
        return np.zeros((0, _HEIGHT, _WIDTH), dtype=np.uint8)
    directory = cache_directory("inspected")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory) as file:
            for picture in pictures:
                file.write(np.ascontiguousarray(picture).data)
            file.flush()
            return np.memmap(file, dtype=np.uint8, mode="r", shape=(count, _HEIGHT, _WIDTH))
    except OSError as error:
        raise StorageError(
            f"cannot keep small pictures in {readable(directory)}: {error.strerror or error}; free space, or choose "
            "another place with EVERPLACE_CACHE"
        ) from error


def _take(small: NDArray[np.uint8], rows: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Returns the pictures of these rows, on disk as well."""
    if np.array_equal(rows, np.arange(len(small))):
        return small
    return _on_disk((small[rows[start : start + _BLOCK]] for start in range(0, len(rows), _BLOCK)), len(rows))


def _positions(traverse: Traverse, stems: Sequence[str]) -> NDArray[np.int64]:
    where = {stem: position for position, stem in enumerate(traverse.stems)}
    return np.array([where[stem] for stem in stems], dtype=np.int64)


def _summary(traverse: Traverse, look: _Looks, everything: Sequence[str]) -> TraverseInspection:
    seen = ~(look.broken | look.dark)
    own = frozenset(traverse.stems)
    return TraverseInspection(
        traverse=traverse,
        bytes=look.bytes,
        sizes=look.sizes,
        unreadable=look.problems,
        dark=look.dark,
        stationary=stationary_places([look.small], seen),
        alike=_alike(look) & seen,
        gaps=find_gaps(traverse.stems),
        missing=tuple(stem for stem in everything if stem not in own),
    )


def _alike(look: _Looks) -> NDArray[np.bool_]:
    """Says of each frame whether it is almost the picture of the readable one before, and not the same file."""
    alike = np.zeros(len(look.small), dtype=np.bool_)
    for start in range(1, len(alike), _BLOCK):
        block = look.small[start - 1 : start + _BLOCK].astype(np.int16)
        differs = np.abs(np.diff(block, axis=0)).reshape(len(block) - 1, -1).mean(axis=1)
        alike[start : start + _BLOCK] = differs < _ALIKE_BELOW
    alike[1:] &= (look.digests[1:] != look.digests[:-1]).any(axis=1) & ~look.broken[:-1]
    return alike


def _duplicates(traverses: Sequence[Traverse], looks: Sequence[_Looks]) -> tuple[tuple[str, ...], ...]:
    """Groups the readable frames whose files are the same."""
    halves = np.concatenate([look.digests for look in looks]).view(np.uint64)
    readable_ones = np.flatnonzero(~np.concatenate([look.broken for look in looks]))
    order = readable_ones[np.lexsort((halves[readable_ones, 1], halves[readable_ones, 0]))]
    same = (halves[order[1:]] == halves[order[:-1]]).all(axis=1)
    starts = np.cumsum([0, *(len(traverse) for traverse in traverses)])

    def name(index: int) -> str:
        number = int(np.searchsorted(starts, index, side="right")) - 1
        return f"{traverses[number].name}/{traverses[number].stems[index - int(starts[number])]}"

    groups = np.split(order, np.flatnonzero(~same) + 1)
    found = sorted(sorted(group.tolist()) for group in groups if len(group) > 1)
    return tuple(tuple(map(name, group)) for group in found)


def _stretches(places: Sequence[str], flags: NDArray[np.bool_]) -> tuple[Stretch, ...]:
    """Returns the runs of places that are flagged."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return tuple(Stretch(places[first], places[end - 1], int(end - first)) for first, end in edges.reshape(-1, 2))
