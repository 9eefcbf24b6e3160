"""What there is to show of a map, as the JSON of `GET /map`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.mapping.route_map import Map

__all__ = ["MOST_BINS", "binned_most", "map_summary", "places_per_bin"]

MOST_BINS = 512
"""Of the places along a route: more than a screen shows."""
_MOST_ROWS = 200
"""Of the table of precisions."""


def places_per_bin(places: int) -> int:
    """How many places, in the order of travel, are put together so that there are at most `MOST_BINS` bins."""
    return max(1, -(-places // MOST_BINS))


def binned_most(values: NDArray[np.floating[Any]]) -> list[float]:
    """The largest value of each bin of (P,) values."""
    starts = np.arange(0, len(values), places_per_bin(len(values)))
    most: list[float] = np.maximum.reduceat(values, starts).astype(float).tolist()
    return most


def map_summary(map_: Map, places: NDArray[np.int64], *, decodes: bool) -> dict[str, Any]:
    """All of it.

    Args:
        map_: The map.
        places: (P,) its places in the order of travel.
        decodes: Whether its method can show a frame in another condition.
    """
    table = map_.frames("stem", "place", "x", "y")
    of_drive = np.array(table["drive"].to_pylist())
    order_of = np.full(int(places.max(initial=0)) + 1, -1, np.int64)
    order_of[places] = np.arange(len(places))
    of_frames = np.asarray(table["place"])
    orders = np.where(of_frames >= 0, order_of[of_frames], -1)
    bins = orders // places_per_bin(len(places))
    known = map_.info()
    return {
        **known,
        "provisional": map_.calibration.provisional,
        "places_per_bin": places_per_bin(len(places)),
        "table": _table(map_, of_drive, bins, places_per_bin(len(places))),
        "poses": _poses(np.stack([np.asarray(table["x"]), np.asarray(table["y"])], axis=1), bins),
        **_frames(map_, of_drive, table["stem"].to_pylist(), orders),
        "place_order": places.tolist(),
        "learned": _learned(map_, of_drive, of_frames),
        "decodes": decodes,
        "precision": _precision(map_),
    }


def _table(map_: Map, of_drive: NDArray[np.str_], bins: NDArray[np.int64], per_bin: int) -> dict[str, Any]:
    """How many frames show each bin under each condition: its zeros are the map's holes."""
    condition_of = {drive["name"]: drive["condition"] for drive in map_.document["drives"]}
    cells = np.zeros((int(bins.max(initial=-1)) + 1, len(map_.conditions)), np.int64)
    for name, condition in condition_of.items():
        rows = bins[of_drive == name]
        np.add.at(cells, (rows[rows >= 0], map_.conditions.index(condition)), 1)
    return {
        "conditions": list(map_.conditions),
        "drives": [{"name": name, "condition": condition} for name, condition in condition_of.items()],
        "cells": cells.tolist(),
        "places_per_bin": per_bin,
    }


def _poses(poses: NDArray[np.float64], bins: NDArray[np.int64]) -> list[list[float] | None] | None:
    """Mean x, y of the frames of each bin, or nothing where no frame has a pose."""
    known = (bins >= 0) & ~np.isnan(poses).any(axis=1)
    if not known.any():
        return None
    count = int(bins.max()) + 1
    frames = np.bincount(bins[known], minlength=count)
    sums = np.stack([np.bincount(bins[known], poses[known, axis], minlength=count) for axis in (0, 1)], axis=1)
    return [None if not n else (total / n).tolist() for n, total in zip(frames.tolist(), sums, strict=True)]


def _frames(map_: Map, of_drive: NDArray[np.str_], stems: list[str], orders: NDArray[np.int64]) -> dict[str, Any]:
    """Of each drive's frames, in order, the ids, the names, and where their places come in the order of travel."""
    rows = {name: np.flatnonzero(of_drive == name).tolist() for name in map_.drives}
    known: list[int | None] = [None if order < 0 else order for order in orders.tolist()]
    return {
        "frames": rows,
        "stems": {name: [stems[row] for row in some] for name, some in rows.items()},
        "order": {name: [known[row] for row in some] for name, some in rows.items()},
    }


def _learned(map_: Map, of_drive: NDArray[np.str_], places: NDArray[np.int64]) -> dict[str, Any]:
    """What each drive brought, oldest first, and what the descriptor was learnt from."""
    seen: set[int] = set()
    drives = []
    for drive in map_.document["drives"]:
        placed = places[of_drive == drive["name"]]
        placed = placed[placed >= 0]
        new = set(placed.tolist()) - seen
        seen |= new
        drives.append(
            {
                **{key: drive[key] for key in ("name", "condition", "frames", "sure", "how", "learns", "agreement")},
                "placed": len(placed),
                "new_places": len(new),
            }
        )
    return {"drives": drives, **map_.document["learnt"]}


def _precision(map_: Map) -> list[dict[str, float]] | None:
    """At falling thresholds of the probability, which share of the held-out answers is right, and what is found.

    Recall is among the frames that are on the map: where it hides a place, nothing can be found.
    """
    held_out = map_.held_out_answers
    probability, right = held_out.probability, held_out.right
    if map_.calibration.provisional or not len(probability):
        return None
    order = np.argsort(-probability, kind="stable")
    found, on_map = np.cumsum(right[order]), max(int(held_out.on_map.sum()), 1)
    ends = np.append(np.flatnonzero(np.diff(probability[order])), len(order) - 1)  # equal ones are accepted at once
    if len(ends) > _MOST_ROWS:
        ends = ends[np.linspace(0, len(ends) - 1, _MOST_ROWS).round().astype(np.int64)]
    return [
        {
            "threshold": float(probability[order][end]),
            "precision": float(found[end] / (end + 1)),
            "recall": float(found[end] / on_map),
        }
        for end in ends.tolist()
    ]
