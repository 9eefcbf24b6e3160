"""Whether the map of today answers a drive better than an earlier version of it."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from everplace.mapping.described_drive import DescribedDrive, describe_drive
from everplace.mapping.drive_on_map import placed_on
from everplace.mapping.drive_source import open_drive
from everplace.mapping.localizer import Localizer
from everplace.mapping.map_columns import as_matrix
from everplace.mapping.place_scores import PlaceFrames
from everplace.mapping.placement import pairs_by_pose
from everplace.mapping.route_map import Map
from everplace.progress import Progress, quiet

__all__ = ["ComparedVersions", "VersionScores", "compare_versions"]

_REACH = 1
_SURE = 0.9
_EVERYTHING = 1 << 40


@dataclass(frozen=True, slots=True)
class VersionScores:
    """How a version answers a drive.

    Attributes:
        version: Its number.
        drives: What it holds.
        recall: Share of the frames with a known place that it finds, give or take a place; None: no place is known.
        probability: Mean probability of its answers.
        sure: Share of the frames that it answers with a probability of 0.9 or more.
        taught: Whether the drive is one that it learnt from; it then answers better than it would a new one.
    """

    version: int
    drives: tuple[str, ...]
    recall: float | None
    probability: float
    sure: float
    taught: bool


@dataclass(frozen=True, slots=True)
class ComparedVersions:
    """Two versions of a map and a drive.

    Attributes:
        drive: The drive.
        frames: How many it has.
        known: How many of their places are known: by the map, by poses, or by names that the images agree with.
        versions: The earlier version, and the newest.
    """

    drive: str
    frames: int
    known: int
    versions: tuple[VersionScores, ...]


def compare_versions(
    address: str | os.PathLike[str], version: int, drive: str, progress: Progress = quiet
) -> ComparedVersions:
    """Has two versions of a map answer a drive, frame by frame with the sequence filter.

    Args:
        address: Of the map.
        version: The earlier version; the other one is the newest.
        drive: A drive of the newest version, whose frames are left out of the search, or a directory, video or bag.
        progress: Told of the frames.

    Raises:
        MapError: There is no such map or version.
        RouteError: There is no such drive.
    """
    earlier, newest = Map.open(address, version), Map.open(address)
    name = drive
    if drive in newest.drives:
        table = newest.frames("features", "looks", "place", "sure")
        here = np.array(table["drive"].to_pylist()) == drive
        features, looks = as_matrix(table["features"])[here], as_matrix(table["looks"])[here]
        known = np.asarray(table["sure"])[here] | (drive == newest.drives[0])
        true = np.where(known, np.asarray(table["place"])[here], -1)
    else:
        source = open_drive(drive, fixes=bool(newest.origin), origin=newest.origin)
        name = source.name
        described = describe_drive(source, newest.describer(), progress, in_other_light=False)
        features, looks = described.features, described.looks
        true = _known_places(newest, described)
    scored = tuple(_answered(one, name, features, looks, true, progress) for one in (earlier, newest))
    return ComparedVersions(name, len(features), int((true >= 0).sum()), scored)


def _known_places(newest: Map, described: DescribedDrive) -> NDArray[np.int64]:
    """(M,) the true place of each frame of a new drive; -1: not known."""
    table = newest.frames("place", "position", "x", "y", "heading")
    order = PlaceFrames(np.asarray(table["place"]), np.asarray(table["position"]))
    poses = np.stack([np.asarray(table[column]) for column in ("x", "y", "heading")], axis=1)[order.first]
    true = np.full(len(described), -1, np.int64)
    if not (np.isnan(poses).all() or np.isnan(described.poses).all()):
        pairs = pairs_by_pose(described.poses, poses)
        true[pairs.frames] = order.places[pairs.places]
        return true
    placement = placed_on(newest, described, "auto")
    return np.where(placement.sure, placement.places, -1) if placement.how == "names" else true


def _answered(
    opened: Map,
    name: str,
    features: NDArray[np.floating],
    looks: NDArray[np.float32],
    true: NDArray[np.int64],
    progress: Progress,
) -> VersionScores:
    localizer = Localizer(opened)
    column = {place: index for index, place in enumerate(localizer.places.tolist())}
    frames = progress(zip(features, looks, strict=True), f"version {opened.version}", len(features))
    answers = [localizer.locate_described(one, look, excluded=(name, 0, _EVERYTHING)) for one, look in frames]
    found = [
        place in column and abs(column[answer.place] - column[place]) <= _REACH
        for answer, place in zip(answers, true.tolist(), strict=True)
        if place >= 0
    ]
    probabilities = np.array([answer.probability for answer in answers])
    return VersionScores(
        version=opened.version,
        drives=opened.drives,
        recall=float(np.mean(found)) if found else None,
        probability=float(probabilities.mean()),
        sure=float((probabilities >= _SURE).mean()),
        taught=any(one["name"] == name and one["learns"] for one in opened.document["drives"]),
    )
