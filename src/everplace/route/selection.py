"""Which places of a route take part: shared stems, then the filters, then a slice.

The filters are the ones that published figures on Nordland rest on: dark places (tunnels) and places that
look like the last one kept (stops) are left out, in all traverses at once.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.images.decoding import ImageSpec
from everplace.progress import Progress, quiet
from everplace.route.pack import pack
from everplace.route.route import Route
from everplace.route.traverse import Traverse

__all__ = [
    "FILTER_IMAGE",
    "Selection",
    "dark_places",
    "parse_frames",
    "select",
    "select_maps",
    "spread",
    "stationary_places",
]

FILTER_IMAGE = ImageSpec(size=(32, 64), grey=True)
"""What the filters look at: 64×32 pixels (width × height), grey."""

_DARK_BELOW = 25.0
_STATIONARY_ABOVE = 0.95
_BLOCK = 512
_FRAMES = re.compile(r"([0-9]*):([0-9]*)")


@dataclass(frozen=True)
class Selection:
    """Which places take part.

    Attributes:
        frames: Positions in the list of places that the filters leave; None: all.
        drop_dark: Leave out places that are dark in any traverse.
        drop_stationary: Leave out places that look like the last one kept in every traverse.
    """

    frames: slice | None = None
    drop_dark: bool = False
    drop_stationary: bool = False


def parse_frames(text: str, option: str = "`frames`") -> slice:
    """Reads `A:B`; either side may be left out.

    Args:
        text: What was given.
        option: What it was given by, for the messages.

    Raises:
        ConfigError: It is anything else, a number is negative, or A is not below B.
    """
    match = _FRAMES.fullmatch(text.strip())
    if match is None:
        raise ConfigError(f"{option} {text!r} is not A:B with two positions from 0 on, like 0:1600, 1620: or :500")
    try:
        start, stop = (int(side) if side else None for side in match.groups())
    except ValueError as error:  # Python reads numbers of up to some thousand digits
        raise ConfigError(
            f"{option} holds a number of thousands of digits ({len(text)} characters in all); give positions of frames"
        ) from error
    if stop is not None and (start or 0) >= stop:
        raise ConfigError(f"{option} {text!r} holds no place; the first position must be below the second")
    return slice(start, stop)


def select(route: Route, selection: Selection, progress: Progress = quiet, *, only_shared: bool = True) -> Route:
    """Restricts a route to the places that take part.

    Traverses that share stems are restricted to the shared ones first, and filters and slice act on places.
    If no stem is shared, filters and slice act on each traverse alone.

    Args:
        route: The chosen traverses.
        selection: Which places take part.
        progress: Told of the decoding that a filter needs.
        only_shared: If False, frames that not all traverses have take part too, where there are some: filters
            and slice then act on each traverse alone.

    Returns:
        The same traverses with fewer frames.

    Raises:
        RouteError: Nothing is left.
        ImageError: A filter needs a frame that cannot be decoded.
        StorageError: The cache of packed images cannot be written to.
    """
    shared = route.shared_stems()
    if shared and (only_shared or all(len(traverse) == len(shared) for traverse in route.traverses)):
        return _restrict(route.at(shared), selection, progress)
    alone = [_restrict(replace(route, traverses=(traverse,)), selection, progress) for traverse in route.traverses]
    return replace(route, traverses=tuple(part.traverses[0] for part in alone))


def select_maps(route: Route, selection: Selection, progress: Progress = quiet) -> Route:
    """Restricts a route as `select` does, but a traverse with all places of a shorter one and twice as many keeps more.

    Such a traverse is the map in which the shorter one looks for its places (Nordland's 2,760 queries against 27,592
    frames). Shared places are chosen as ever. A map also keeps its own frames that lie between the first chosen place
    and the next place that is not chosen; a slice at either end keeps everything beyond that end, too. The filters
    judge these frames by the map alone. So slices that share no place share no frame.

    Args:
        route: The chosen traverses.
        selection: Which places take part.
        progress: Told of the decoding that a filter needs.

    Returns:
        The same traverses with fewer frames; `select` of the route, unless the stems of its traverses are nested.

    Raises:
        RouteError: Nothing is left.
        ImageError: A filter needs a frame that cannot be decoded.
        StorageError: The cache of packed images cannot be written to.
    """
    shared = route.shared_stems()
    if not _are_nested(route):
        return select(route, selection, progress)
    left = _filtered(route.at(shared), selection, progress)
    chosen = _sliced(route, left, selection)
    after = left[np.searchsorted(left, chosen[-1], side="right") :]
    # Where the first chosen place is the first of all, what a map has before it belongs to it.
    begin = None if chosen[0] == left[0] else shared[chosen[0]]
    end = shared[after[0]] if len(after) else None
    common, places = frozenset(shared), frozenset(shared[index] for index in chosen)

    def restricted(traverse: Traverse) -> Traverse:
        if len(traverse) == len(shared):
            return traverse.take(chosen)
        alone = _filtered(replace(route, traverses=(traverse,)), selection, progress)
        kept = frozenset(alone.tolist())
        stretch = range(
            0 if begin is None else traverse.stems.index(begin),
            len(traverse) if end is None else traverse.stems.index(end),
        )
        stems = traverse.stems
        return traverse.take(
            [index for index in stretch if (stems[index] in places if stems[index] in common else index in kept)]
        )

    return replace(route, traverses=tuple(map(restricted, route.traverses)))


def spread(total: int, count: int) -> list[int]:
    """At most `count` positions, evenly spread over `total`."""
    return [int(position) for position in np.unique(np.linspace(0, total - 1, min(count, total)).round())]


def dark_places(pixels: Sequence[NDArray[np.uint8]], below: float = _DARK_BELOW) -> NDArray[np.bool_]:
    """Finds the places whose mean grey value is low in any traverse.

    Args:
        pixels: For each traverse N×H×W or N×H×W×1, the same N places.
        below: Grey value, 0 to 255; what is exactly as bright is not dark.

    Returns:
        N bool, True = dark.
    """
    dark = np.zeros(len(pixels[0]), dtype=np.bool_)
    for frames in pixels:
        for start in range(0, len(frames), _BLOCK):
            block = frames[start : start + _BLOCK]
            dark[start : start + _BLOCK] |= block.reshape(len(block), -1).mean(axis=1) < below
    return dark


def stationary_places(
    pixels: Sequence[NDArray[np.uint8]],
    candidates: NDArray[np.bool_] | None = None,
    above: float = _STATIONARY_ABOVE,
) -> NDArray[np.bool_]:
    """Finds the places that look like the last place kept, in every traverse.

    Args:
        pixels: For each traverse N×H×W or N×H×W×1, the same N places in order.
        candidates: N bool, the places that an earlier filter left; the others are passed over. None: all.
        above: Pearson correlation of grey values from which, exclusive, a place looks like another. A flat
            picture has no correlation and looks like nothing.

    Returns:
        N bool, True = stationary (never where `candidates` is False).
    """
    places = np.arange(len(pixels[0])) if candidates is None else np.flatnonzero(candidates)
    stationary = np.zeros(len(pixels[0]), dtype=np.bool_)
    last: NDArray[np.float64] | None = None
    for start in range(0, len(places), _BLOCK):
        block = places[start : start + _BLOCK]
        standardised = np.stack([_standardise(frames[block]) for frames in pixels], axis=1)
        for place, views in zip(block, standardised, strict=True):
            if last is not None and bool((np.einsum("tp,tp->t", views, last) > above).all()):
                stationary[place] = True
            else:
                last = views
    return stationary


def _standardise(frames: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Gives each frame mean 0 and length 1: dot products are Pearson correlations. Flat frames become 0."""
    values = frames.reshape(len(frames), -1).astype(np.float64)
    values -= values.mean(axis=1, keepdims=True)
    length = np.linalg.norm(values, axis=1, keepdims=True)
    standardised: NDArray[np.float64] = np.divide(values, length, out=np.zeros_like(values), where=length > 0)
    return standardised


def _are_nested(route: Route) -> bool:
    """Says whether each traverse, by length, has all stems of those before, and the longest is a map.

    A map has at least twice the frames. A drive that lacks a few has gaps, and what is missing there takes no part.
    """
    by_length = sorted(route.traverses, key=len)
    if not route.stems_are_places or len(by_length[-1]) < 2 * len(by_length[0]):
        return False
    sets = [frozenset(traverse.stems) for traverse in by_length]
    return all(fewer <= more for fewer, more in pairwise(sets))


def _restrict(route: Route, selection: Selection, progress: Progress) -> Route:
    """Applies filters and slice to traverses that have the same stems."""
    chosen = _sliced(route, _filtered(route, selection, progress), selection)
    return replace(route, traverses=tuple(traverse.take(chosen) for traverse in route.traverses))


def _filtered(route: Route, selection: Selection, progress: Progress) -> NDArray[np.int64]:
    """Returns the positions that the filters leave of traverses that have the same stems."""
    total = len(route.traverses[0])
    kept = np.ones(total, dtype=np.bool_)
    if selection.drop_dark or selection.drop_stationary:
        pixels = [pack(traverse, FILTER_IMAGE, progress=progress).pixels for traverse in route.traverses]
        if selection.drop_dark:
            kept &= ~dark_places(pixels)
        if selection.drop_stationary:
            kept &= ~stationary_places(pixels, kept)
    places = np.flatnonzero(kept)
    if not len(places):
        raise RouteError(f"all {total} places of {readable(route.root)} are dark; leave out `drop_dark=True`")
    return places


def _sliced(route: Route, places: NDArray[np.int64], selection: Selection) -> NDArray[np.int64]:
    """Applies the slice to positions that the filters leave."""
    chosen = places if selection.frames is None else places[selection.frames]
    if not len(chosen):
        raise RouteError(
            f"`frames` begins at position {selection.frames.start if selection.frames else 0}, but "
            f"{readable(route.root)} has only {len(places)} places left; begin lower"
        )
    stop = None if selection.frames is None else selection.frames.stop
    if stop is not None and stop > len(places):
        warnings.warn(
            f"`frames` ends at {stop}, but {readable(route.root)} has only {len(places)} places, so {len(chosen)} "
            "take part",
            stacklevel=3,
        )
    return chosen
