"""A later drive matched with a map without labels, surely enough that the matches may teach the descriptor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors
from everplace.match.similarity import similarity
from everplace.match.standardise import standardise
from everplace.sequences.route_filter import filter_windows

__all__ = ["SurePairs", "sure_pairs", "sure_pairs_of_scores"]

_SEQUENCE = 10
_SURE = 2.0
"""Log-odds from which a match is believed."""
_RUN = 10
"""Frames in a row that must be believed and go on along the map: a foreign drive has none."""
_STEP = 3
"""Places by which a match may move on from one frame to the next within such a run."""


@dataclass(frozen=True, eq=False)
class SurePairs:
    """The frames of a drive whose place on the map is sure.

    Attributes:
        frames: (K,) positions in the drive, increasing.
        places: (K,) positions in the map.
        log_odds: (K,) how sure each is.
        of: Frames that the drive has.
    """

    frames: NDArray[np.int64]
    places: NDArray[np.int64]
    log_odds: NDArray[np.float32]
    of: int

    @property
    def share(self) -> float:
        """Share of the drive's frames that are sure, in [0, 1]."""
        return len(self.frames) / max(self.of, 1)


def sure_pairs(map_drive: Descriptors, drive: Descriptors) -> SurePairs:
    """Finds the frames of a drive whose place is sure, by the sequence filter over 10 frames.

    Each side is centred by its own mean. A match counts if its log-odds are above 2 and it belongs to a run of at least
    10 such matches that goes on along the map, in either direction.

    Args:
        map_drive: N descriptors, in the order of travel.
        drive: M descriptors of the same method.

    Raises:
        DescriptorsError: The two are of different methods or settings.
    """
    return sure_pairs_of_scores(similarity(standardise(drive, "centre"), standardise(map_drive, "centre")))


def sure_pairs_of_scores(S: NDArray[np.float32]) -> SurePairs:
    """Finds what `sure_pairs` finds, from scores.

    Args:
        S: M×N, frames of the drive against places of the map, both in the order of travel.
    """
    odds = filter_windows(S, _SEQUENCE)
    places = odds.argmax(axis=1)
    best = odds[np.arange(len(odds)), places]
    kept = _in_runs(best > _SURE, places)
    frames = np.flatnonzero(kept)
    return SurePairs(frames, places[frames], best[frames], len(S))


def _in_runs(sure: NDArray[np.bool_], places: NDArray[np.int64]) -> NDArray[np.bool_]:
    """M bool: sure, and part of a run of at least 10 that moves by at most 3 places a frame."""
    linked = sure[1:] & sure[:-1] & (np.abs(np.diff(places)) <= _STEP)
    run = np.concatenate([[0], np.cumsum(~linked)])  # a number for each run
    length = np.bincount(run, sure)
    kept: NDArray[np.bool_] = sure & (length[run] >= _RUN)
    return kept
