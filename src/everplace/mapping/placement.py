"""Where the frames of a new drive belong on a map: by their names, their poses, or by what they show."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from everplace.errors import MapError
from everplace.mapping.self_teaching import SurePairs

__all__ = ["Align", "Placement", "agreement", "pairs_by_name", "pairs_by_pose", "placed"]

Align = Literal["auto", "names", "poses", "images"]

_AGREES = 0.9
"""Share of the image search's sure matches that names must agree with to be believed."""
_NEAR = 1
_RADIUS = 10.0
_GAP = 3
"""Places a frame by which the matches around unsure frames may lie apart for these to count as lying between them."""
_DETOUR = 10
"""Unsure frames in a row from which they may be a detour, and have to show that they are not."""
_CHANCE = 1e-3
"""Probability that frames of elsewhere are taken for frames of the road between, if they were independent."""


@dataclass(frozen=True, eq=False)
class Placement:
    """Where the frames of a drive lie on the map.

    Attributes:
        how: "names", "poses" or "images".
        places: (M,) the place of each frame; -1: somewhere between the places of its neighbours, which is not sure.
        positions: (M,) where along the map, in the order of travel; NaN where the place is -1.
        sure: (M,) whether the frame's place is one that the map had.
        between: (M,) the map's place that a frame of -1 is most likely next to; -1 elsewhere.
        agreement: Share of the sure matches of the image search that the names agree with; None: nobody looked.
        seen: What the image search found, with columns of the map's places; None: nobody looked.
    """

    how: str
    places: NDArray[np.int64]
    positions: NDArray[np.float64]
    sure: NDArray[np.bool_]
    between: NDArray[np.int64]
    agreement: float | None = None
    seen: SurePairs | None = None

    @classmethod
    def first(cls, frames: int) -> Placement:
        """Of a map's first drive, whose frames are its places."""
        places = np.arange(frames)
        return cls("first", places, places.astype(float), np.zeros(frames, np.bool_), np.full(frames, -1))

    @property
    def new(self) -> int:
        """How many places the drive adds to the map."""
        return int(((self.places >= 0) & ~self.sure).sum())


def pairs_by_name(names: Sequence[str], known: Sequence[str]) -> SurePairs:
    """Pairs frames with the map's places of the same name.

    Args:
        names: Of the M frames.
        known: Name of the frame of each of the map's P places.
    """
    place = {name: column for column, name in enumerate(known)}
    columns = np.array([place.get(name, -1) for name in names], np.int64)
    return _pairs(columns)


def pairs_by_pose(poses: NDArray[np.float64], known: NDArray[np.float64]) -> SurePairs:
    """Pairs frames with the nearest of the map's places, within 10 m.

    Args:
        poses: M×3.
        known: P×3.

    Raises:
        MapError: One side has no poses.
    """
    from scipy.spatial import KDTree

    if np.isnan(poses).all() or np.isnan(known).all():
        raise MapError("`align` poses needs poses of the map and of the drive; align by images instead")
    there = np.flatnonzero(~np.isnan(known).any(axis=1))
    here = np.flatnonzero(~np.isnan(poses).any(axis=1))
    distance, nearest = KDTree(known[there, :2]).query(poses[here, :2])
    columns = np.full(len(poses), -1, np.int64)
    near = np.asarray(distance) <= _RADIUS
    columns[here[near]] = there[np.asarray(nearest)[near]]
    return _pairs(columns)


def agreement(named: SurePairs, seen: SurePairs) -> float | None:
    """Share of the sure matches by images that names agree with, give or take a place; None where there are none."""
    by_name = np.full(named.of, -(10**9), np.int64)
    by_name[named.frames] = named.places
    if not (len(seen.frames) and len(named.frames)):
        return None
    return float((np.abs(by_name[seen.frames] - seen.places) <= _NEAR).mean())


def believed(share: float | None) -> bool:
    """Whether names that agree so well with the images are to be believed."""
    return share is not None and share >= _AGREES


def placed(
    pairs: SurePairs,
    places: NDArray[np.int64],
    positions: NDArray[np.float64],
    how: str,
    agreed: float | None = None,
    scores: NDArray[np.float32] | None = None,
) -> Placement:
    """Places all frames of a drive by those that are sure.

    A frame between two sure ones that lie near each other on the map is somewhere between them, and stays without a
    place; others are new places, behind the last one of the map. Where 10 or more in a row are not sure, they are
    only taken to lie between if more of them than by chance look like that stretch: else they are a detour.

    Args:
        pairs: The sure frames, with columns of the map.
        places: (P,) the places of the map's columns.
        positions: (P,) where they lie along the map.
        how: What found the pairs.
        agreed: See `Placement.agreement`.
        scores: M×P, how much each frame looks like each place; None: no frames are taken for a detour.
    """
    count = pairs.of
    columns = np.full(count, -1, np.int64)
    columns[pairs.frames] = pairs.places
    sure = columns >= 0
    found, at, between = np.full(count, -1, np.int64), np.full(count, np.nan), np.full(count, -1, np.int64)
    found[sure], at[sure] = places[columns[sure]], positions[columns[sure]]
    known = np.flatnonzero(sure)
    for first, second in itertools.pairwise(known.tolist()):
        gap = int(columns[second] - columns[first])
        inside = np.arange(first + 1, second)
        if len(inside) and abs(gap) <= _GAP * (second - first):
            line = columns[first] + np.round(gap * (inside - first) / (second - first)).astype(np.int64)
            if scores is None or len(inside) < _DETOUR or _shows(scores[inside], line):
                between[inside] = places[line]
    fresh = np.flatnonzero(~sure & (between < 0))
    found[fresh] = int(places.max(initial=-1)) + 1 + np.arange(len(fresh))
    at[fresh] = float(positions.max(initial=-1.0)) + 1 + np.arange(len(fresh))
    return Placement(how, found, at, sure, between, agreed)


def _shows(scores: NDArray[np.float32], line: NDArray[np.int64]) -> bool:
    """Whether more frames look most like their place on a line, give or take a few, than would by chance.

    Args:
        scores: K×P, frames against places.
        line: (K,) columns.
    """
    from scipy.stats import binom

    relative = scores - scores.mean(axis=0)  # places that all of the frames look like say nothing
    right = int((np.abs(relative.argmax(axis=1) - line) <= _GAP).sum())
    chance = min((2 * _GAP + 1) / scores.shape[1], 1.0)
    return bool(binom.sf(right - 1, len(line), chance) <= _CHANCE)


def _pairs(columns: NDArray[np.int64]) -> SurePairs:
    frames = np.flatnonzero(columns >= 0)
    return SurePairs(frames, columns[frames], np.full(len(frames), np.inf, np.float32), len(columns))
