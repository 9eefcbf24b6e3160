"""Aligns the drives of a route, so that the same stem means the same place in all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from everplace.alignment.drive_path import Thinned, find_path, thin, thinning
from everplace.alignment.judgement import JudgedPath, judge_path
from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Descriptors
from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.importing.positions.hand_pairs import read_pairs
from everplace.importing.positions.shared_places import (
    Assignment,
    align_all_by_pairs,
    align_all_by_position,
    align_drives,
    sparsest,
)
from everplace.match.standardise import standardisable, standardise
from everplace.plots.alignment_path import draw_path
from everplace.plots.canvas import new_figure
from everplace.progress import Progress, quiet
from everplace.route.route import Route

__all__ = [
    "Alignment",
    "align_by_images",
    "align_by_pairs",
    "align_by_poses",
    "alignment_figure",
    "judge",
]

_RADIUS = 10.0


@dataclass(frozen=True, eq=False)
class Alignment:
    """The places that all drives of a route have.

    Attributes:
        route: The route as it was.
        reference: The traverse that the others were aligned with.
        how: What it was done by, for a person.
        frames: For each traverse the positions of the P places in it, increasing.
        paths: For each traverse but the reference the path through its similarity, where it was looked at; its
            pairs are those of `frames`.
        method: The method on whose descriptors the drives were aligned; empty: not by their images.
    """

    route: Route
    reference: str
    how: str
    frames: Mapping[str, NDArray[np.int64]]
    paths: Mapping[str, JudgedPath]
    method: str = ""

    @property
    def places(self) -> int:
        """P."""
        return len(self.frames[self.reference])

    @property
    def left_out(self) -> dict[str, int]:
        """How many frames of each traverse have no partner in all others."""
        return {traverse.name: len(traverse) - self.places for traverse in self.route.traverses}

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each traverse whose path is unsure somewhere."""
        return tuple(_warning(self.reference, name, path) for name, path in self.paths.items() if path.unsure.any())


def align_by_poses(route: Route, reference: str | None = None, radius: float | None = None) -> Alignment:
    """Aligns drives by where their frames were taken.

    Args:
        route: Traverses with poses in one plane.
        reference: Name of a traverse; None: the one with the fewest frames.
        radius: Metres up to which two frames show the same place; None: the route's, else 10.

    Raises:
        RouteError: A traverse has no poses, or the drives share no place.
        ConfigError: The radius is not a positive number.
    """
    chosen = _reference(route, reference)
    metres = radius if radius is not None else route.radius or _RADIUS
    positions: dict[str, NDArray[np.float64]] = {}
    for traverse in route.traverses:
        if traverse.poses is None:
            raise RouteError(
                f"the traverse {traverse.name!r} has no poses; put a poses.csv with the columns stem,x,y,heading into "
                "its directory, or align `by=pairs` or `by=images`"
            )
        positions[traverse.name] = traverse.poses[:, :2]
    frames = align_all_by_position(positions, chosen, metres)
    return _checked(Alignment(route, chosen, f"poses within {metres:g} m", frames, {}), "give a larger `radius`")


def align_by_pairs(route: Route, pairs: Path, reference: str | None = None) -> Alignment:
    """Aligns drives by pairs set by hand, linearly between them.

    Args:
        route: The traverses.
        pairs: See `everplace.importing.positions.hand_pairs`.
        reference: Name of a traverse; None: the one with the fewest frames, or of two traverses whose pairs are
            called stem_a and stem_b the first.

    Raises:
        RouteError: The file is wrong, or the drives share no place.
    """
    chosen = _reference(route, reference)
    drives = {traverse.name: traverse.stems for traverse in route.traverses}
    frames = align_all_by_pairs(_counts(route), chosen, read_pairs(pairs, chosen, drives))
    return _checked(Alignment(route, chosen, f"pairs of {readable(pairs)}", frames, {}), "add pairs that overlap")


def align_by_images(
    route: Route, describer: Describer, reference: str | None = None, progress: Progress = quiet
) -> Alignment:
    """Aligns drives by what they show: the best path through the similarity of their descriptors.

    Args:
        route: The traverses.
        describer: The method that describes the frames; its descriptors are centred.
        reference: Name of a traverse; None: the one with the fewest frames.
        progress: Told of the describing.

    Raises:
        ConfigError: The method's descriptors cannot be centred.
        RouteError: Two drives look nowhere alike.
    """
    chosen = _reference(route, reference)
    _require_centrable(describer)

    def described(name: str) -> Descriptors:
        return standardise(describer.describe(route[name], progress=progress), "centre")

    # Of each other drive only some frames stay in memory once its path is found.
    whole = described(chosen)
    seen = {chosen: thin(whole)}

    def align(name: str, places: NDArray[np.int64]) -> Assignment:
        other = described(name)
        seen[name] = thin(other)
        some = [whole.names[place] for place in places.tolist()]
        return find_path(whole.of(some), other) if some else (places, places)

    frames = align_drives(_counts(route), chosen, align)
    how = f"the images' {describer.method} descriptors"
    return _judged(
        _checked(Alignment(route, chosen, how, frames, {}, describer.method), "align `by=poses` or `by=pairs`"), seen
    )


def judge(alignment: Alignment, describer: Describer, progress: Progress = quiet) -> Alignment:
    """Looks at an alignment, however it was found, in the similarity of the drives' images.

    Raises:
        ConfigError: The method's descriptors cannot be centred.
    """
    _require_centrable(describer)
    seen = {}
    for traverse in alignment.route.traverses:
        stride = thinning(len(traverse))
        described = describer.describe(traverse[::stride], progress=progress)
        seen[traverse.name] = Thinned(standardise(described, "centre"), stride)
    return _judged(alignment, seen)


def alignment_figure(alignment: Alignment) -> Figure:
    """Draws for each drive its similarity to the reference and the path that was found, unsure stretches marked.

    Args:
        alignment: With `paths`, of `align_by_images` or `judge`.
    """
    figure = new_figure(6.4, 5.6 * len(alignment.paths))
    cells = figure.subplots(len(alignment.paths), 1, squeeze=False)[:, 0]
    for axes, (name, path) in zip(cells, alignment.paths.items(), strict=True):
        draw_path(
            axes, path.S, path.pairs, path.unsure, path.strides, first=alignment.reference, second=name,
            title=f"{alignment.reference} and {name}, aligned by {alignment.how}",
        )  # fmt: skip
    return figure


def _require_centrable(describer: Describer) -> None:
    if not standardisable(describer.metric):
        raise ConfigError(
            f"`method` {describer.method} gives words, which cannot be centred; choose hog or the run of a network"
        )


def _judged(alignment: Alignment, seen: Mapping[str, Thinned]) -> Alignment:
    """Adds the paths through the similarity of the reference and each other drive."""
    reference = alignment.reference
    paths = {
        name: judge_path(seen[reference], seen[name], (alignment.frames[reference], frames))
        for name, frames in alignment.frames.items()
        if name != reference
    }
    return replace(alignment, paths=paths)


def _counts(route: Route) -> dict[str, int]:
    return {traverse.name: len(traverse) for traverse in route.traverses}


def _reference(route: Route, name: str | None) -> str:
    if len(route.traverses) < 2:
        raise RouteError(f"{readable(route.root)} has one traverse only; put the drives to align into one route")
    return sparsest(_counts(route)) if name is None else route[name].name


def _checked(alignment: Alignment, remedy: str) -> Alignment:
    if not alignment.places:
        names = ", ".join(alignment.frames)
        raise RouteError(f"the drives {names} share no place by {alignment.how}; {remedy}")
    return alignment


def _warning(reference: str, name: str, path: JudgedPath) -> str:
    remedy = "look at it with `picture` FILE.png, or set pairs by hand"
    if path.by_chance:
        return f"the path of {name} along {reference} is hardly better than chance, so do not trust it: {remedy}"
    first = int(np.argmax(path.unsure))
    return (
        f"the path of {name} along {reference} is unsure at {int(path.unsure.sum())} of {len(path.unsure)} places, "
        f"first at place {first} (it looks alike elsewhere, or one drive stood still): {remedy}"
    )
