"""A new drive on a map: which places its frames show, by whatever is asked for, and what its images say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from everplace.errors import MapError
from everplace.images.decoding import ImageSpec, decode_encoded
from everplace.mapping.described_drive import DescribedDrive
from everplace.mapping.map_version import MapVersion
from everplace.mapping.place_scores import PlaceFrames
from everplace.mapping.placement import Align, Placement, agreement, believed, pairs_by_name, pairs_by_pose, placed
from everplace.mapping.self_teaching import sure_pairs_of_scores
from everplace.mapping.taught_drive import TaughtDrive, places_by_name
from everplace.mapping.teaching_report import ShownDrive
from everplace.match.similarity import directions

__all__ = ["placed_on", "shown_drive"]


def placed_on(version: MapVersion, described: DescribedDrive, align: Align) -> Placement:
    """Where the frames of a drive lie on a map.

    Args:
        version: Of the map.
        described: The drive, by the map's method.
        align: What tells the places; "auto": names where the images agree with them, else images.

    Raises:
        MapError: Names or poses are asked for that the drive and the map do not share.
    """
    table = version.frames("stem", "place", "position", "x", "y", "heading")
    places, positions = np.asarray(table["place"]), np.asarray(table["position"])
    order = PlaceFrames(places, positions)
    if align == "poses":
        known = np.stack([np.asarray(table[name]) for name in ("x", "y", "heading")], axis=1)[order.first]
        return placed(pairs_by_pose(described.poses, known), order.places, order.positions, "poses")
    stems = table["stem"].to_pylist()
    named = pairs_by_name(described.stems, [stems[row] for row in order.first.tolist()])
    if align == "names":
        if not len(named.frames):
            raise MapError("`align` names: no frame of the drive has the name of one of the map; align by images")
        return placed(named, order.places, order.positions, "names")
    scores, vectors = _scores(version, described, order, table["drive"].to_pylist())
    seen = sure_pairs_of_scores(scores, vectors)
    share = agreement(named, seen)
    by_names = align == "auto" and believed(share)
    pairs, how = (named, "names") if by_names else (seen, "images")
    return replace(placed(pairs, order.places, order.positions, how, share, scores), seen=seen)


def shown_drive(version: MapVersion, name: str, described: DescribedDrive, placement: Placement) -> ShownDrive:
    """What the images of a drive say, with its pictures and those of the map."""
    table = version.frames("stem", "place", "position", "thumbnail")
    first = PlaceFrames(np.asarray(table["place"]), np.asarray(table["position"])).first
    there = table.take(first)
    stems = there["stem"].to_pylist()
    assert placement.seen is not None
    true = places_by_name(described.stems, stems) if placement.how == "names" else None
    return ShownDrive(
        TaughtDrive(name, described.stems, stems, placement.seen, true),
        lambda frame: decode_encoded(described.stems[frame], described.thumbnails[frame], ImageSpec()),
        lambda place: decode_encoded(stems[place], there["thumbnail"][place].as_py(), ImageSpec()),
    )


def _scores(
    version: MapVersion, described: DescribedDrive, order: PlaceFrames, drives: list[str]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """M×P scores, and P×D descriptors; every drive centred by its own mean, as a whole drive is at hand."""
    there = version.descriptors()
    names = np.array(drives)
    for name in version.drives:
        there[names == name] -= there[names == name].mean(axis=0)
    here = version.projection.apply(described.features)
    here -= here.mean(axis=0)
    return order.fuse(directions(here) @ directions(there[order.rows]).T), there[order.first]
