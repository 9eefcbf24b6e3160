"""The probability that a query shows a place that the database does not hold, where the method knows it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors
from everplace.errors import DescriptorsError
from everplace.fabmap.place_posterior import PlacePosterior

__all__ = ["new_place_probability", "new_place_summary"]


def new_place_probability(query: Descriptors, database: Descriptors) -> NDArray[np.float32]:
    """Probability that a query shows a place that is not in the database, for FAB-MAP's descriptors.

    It shares the 1 with the places: over the database, exp(similarity) sums to what is left.

    Args:
        query: M descriptors.
        database: N descriptors of the same run.

    Returns:
        (M,) in [0, 1].

    Raises:
        DescriptorsError: The descriptors are not FAB-MAP's.
    """
    if {query.metric, database.metric} != {"place-posterior"}:
        raise DescriptorsError(
            f"descriptors of {query.known_as} and {database.known_as} are no words of FAB-MAP; describe both with "
            "one run of fabmap"
        )
    return np.exp(PlacePosterior(query.values, database.values).log_new_place())


def new_place_summary(query: Descriptors, database: Descriptors) -> dict[str, float] | None:
    """Mean of `new_place_probability`, and in how many queries it is above one half; None for other methods."""
    if query.metric != "place-posterior":
        return None
    probability = new_place_probability(query, database)
    return {"mean_probability": float(probability.mean()), "above_half": int((probability > 0.5).sum())}
