"""What one drive knows of a route, as sums: how its places differ, and how one place differs from itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from everplace.adaptation.moments import Moments

__all__ = ["DriveStatistics", "half_differences"]


@dataclass(frozen=True, eq=False)
class DriveStatistics:
    """Sums over one drive, or over several: those of a map are those of its drives added up.

    Attributes:
        places: Of the frames' features; one weight a place.
        light: Of what other light changes in them (`half_differences`).
        pairs: Of what differs between two drives at one place (`half_differences`).
    """

    places: Moments
    light: Moments
    pairs: Moments

    @classmethod
    def none(cls, features: int) -> DriveStatistics:
        """Those of no drive."""
        return cls(*(Moments.none(features) for _ in range(3)))

    def __add__(self, other: DriveStatistics) -> DriveStatistics:
        """Those of both."""
        return DriveStatistics(self.places + other.places, self.light + other.light, self.pairs + other.pairs)


def half_differences(first: NDArray[np.float32], second: NDArray[np.float32]) -> NDArray[np.float32]:
    """Differences of two views of one place over √2, so that their second moment is the covariance within places.

    Args:
        first: K×F.
        second: K×F, row for row the same places.
    """
    return (first - second) * np.float32(np.sqrt(0.5))
