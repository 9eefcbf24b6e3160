"""The last frames of a drive on a map, taken together."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from everplace.sequences.belief import Belief
from everplace.sequences.route_model import RouteModel

__all__ = ["MAP_MODEL", "SEQUENCE", "window_posterior"]

SEQUENCE = 10
"""Frames that an answer rests on, unless somebody asks for another number."""

MAP_MODEL = RouteModel(leave=0.02)
"""What is assumed of a drive on a map. It leaves the map more often than in a comparison; chosen on rendered worlds."""


def window_posterior(
    ratios: Iterable[NDArray[np.float64]], places: int, model: RouteModel = MAP_MODEL
) -> tuple[NDArray[np.float64], float]:
    """Where the last of some frames was taken, given all of them and nothing before.

    Args:
        ratios: (P,) of each frame, of `everplace.mapping.calibration.likelihood_ratios_of`.
        places: P.
        model: What is assumed of the drive.

    Returns:
        (P,) probability of every place, and that of being off the map; together they sum to 1.
    """
    belief = Belief.start(model, 1, places)
    for number, frame in enumerate(ratios):
        if number:
            belief.move(model)
        belief.see(frame)
    return belief.places[0], float(belief.off[0])
