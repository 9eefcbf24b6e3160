"""Ground truth: which database frames show the place of a query frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from everplace.data.natural_order import natural_sorted
from everplace.data.traverse import Traverse
from everplace.errors import ConfigError, RouteError

__all__ = ["truth_by_pose", "truth_by_position"]


def truth_by_position(query: Traverse, database: Traverse, tolerance: int) -> NDArray[np.bool_]:
    """Tells the same places by stem, give or take some places.

    The distance of two frames counts places along the natural order of all stems that either traverse has,
    not the digits in the stems: where a filter removed places, the ones around the gap are neighbours.

    Args:
        query: M frames.
        database: N frames.
        tolerance: Places by which a match may be off; 0: the same stem only.

    Returns:
        M×N bool.

    Raises:
        ConfigError: The tolerance is negative.
        RouteError: The traverses share no stem.
    """
    if tolerance < 0:
        raise ConfigError(f"tolerance {tolerance} is negative; give 0 or a number of frames")
    if frozenset(query.stems).isdisjoint(database.stems):
        raise RouteError(
            f"the traverses {query.name!r} and {database.name!r} share no stem, so nobody knows which frames "
            "show the same place; name frames of the same place alike, or add poses and give a radius"
        )
    # Further than all places is all of them; NumPy's integers end before Python's do.
    tolerance = min(tolerance, len(query) + len(database))
    place = {stem: rank for rank, stem in enumerate(natural_sorted({*query.stems, *database.stems}))}
    columns = np.array([place[stem] for stem in database.stems])
    order = np.argsort(columns)
    rows = np.array([place[stem] for stem in query.stems])
    first = np.searchsorted(columns[order], rows - tolerance, side="left")
    end = np.searchsorted(columns[order], rows + tolerance, side="right")
    truth = np.zeros((len(query), len(database)), dtype=np.bool_)
    for row in range(len(query)):
        truth[row, order[first[row] : end[row]]] = True
    return truth


def truth_by_pose(query: Traverse, database: Traverse, radius: float) -> NDArray[np.bool_]:
    """Tells the same places by distance; headings are not compared.

    Args:
        query: M frames with poses.
        database: N frames with poses.
        radius: Metres up to which two frames show the same place, included.

    Returns:
        M×N bool.

    Raises:
        ConfigError: The radius is not a positive number.
        RouteError: One of the traverses has no poses.
    """
    from scipy.spatial import KDTree

    if not (np.isfinite(radius) and radius > 0):
        raise ConfigError(f"radius {radius} is not a positive number of metres; give one")
    neighbours = KDTree(_positions(database)).query_ball_point(_positions(query), radius)
    truth = np.zeros((len(query), len(database)), dtype=np.bool_)
    for row, columns in enumerate(neighbours):
        truth[row, columns] = True
    return truth


def _positions(traverse: Traverse) -> NDArray[np.float64]:
    """Returns N×2 metres."""
    if traverse.poses is None:
        raise RouteError(
            f"the traverse {traverse.name!r} has no poses; put a poses.csv with the columns stem,x,y,heading "
            "into its directory or name one in route.toml, or give a tolerance in frames"
        )
    return traverse.poses[:, :2]
