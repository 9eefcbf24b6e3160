"""A later drive matched with a map without labels, surely enough that the matches may teach the descriptor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from everplace.describe.files.descriptors import Descriptors
from everplace.match.similarity import similarity
from everplace.match.standardise import standardise
from everplace.sequences.route_path import smooth_odds

__all__ = ["RUN", "SURE", "FrameMatches", "SurePairs", "sure_pairs", "sure_pairs_of_scores"]

SURE = 2.0
"""Log-odds from which a match is believed."""
_CERTAIN = 1 - 1e-6
RUN = 10
"""Frames in a row that must be believed and go on along the map: a foreign drive has none."""
_ALIKE = 0.8
"""Cosine from which two frames of the map show one view, which it then saw twice."""
_STEP = 3
"""Places by which a match may move on from one frame to the next within such a run."""


@dataclass(frozen=True, eq=False)
class FrameMatches:
    """What every frame of a drive was matched with, sure or not.

    Attributes:
        places: (M,) the best position in the map.
        log_odds: (M,) how sure it is.
    """

    places: NDArray[np.int64]
    log_odds: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SurePairs:
    """The frames of a drive whose place on the map is sure.

    Attributes:
        frames: (K,) positions in the drive, increasing.
        places: (K,) positions in the map.
        log_odds: (K,) how sure each is.
        of: Frames that the drive has.
        matches: Of all frames; None: names or poses told the pairs, and nobody looked.
    """

    frames: NDArray[np.int64]
    places: NDArray[np.int64]
    log_odds: NDArray[np.float32]
    of: int
    matches: FrameMatches | None = None

    @property
    def share(self) -> float:
        """Share of the drive's frames that are sure, in [0, 1]."""
        return len(self.frames) / max(self.of, 1)


def sure_pairs(map_drive: Descriptors, drive: Descriptors) -> SurePairs:
    """Finds the frames of a drive whose place is sure, by the route model, looking back from the end of the drive.

    Each side is centred by its own mean. A match counts if its log-odds are above 2 and it belongs to a run of at least
    10 such matches that goes on along the map, in either direction. Where the map saw the place several times, its
    log-odds are those of being at any of these visits.

    Args:
        map_drive: N descriptors, in the order of travel.
        drive: M descriptors of the same method.

    Raises:
        DescriptorsError: The two are of different methods or settings.
    """
    centred = standardise(map_drive, "centre")
    return sure_pairs_of_scores(similarity(standardise(drive, "centre"), centred), centred.values)


def sure_pairs_of_scores(S: NDArray[np.float32], views: NDArray[np.float32]) -> SurePairs:
    """Finds what `sure_pairs` finds, from scores.

    Args:
        S: M×N, frames of the drive against places of the map, both in the order of travel.
        views: N×D, the descriptors of the map's places, centred.
    """
    odds = smooth_odds(S)
    places, best = _over_visits(odds, views)
    kept = _in_runs(best > SURE, places)
    frames = np.flatnonzero(kept)
    return SurePairs(frames, places[frames], best[frames], len(S), FrameMatches(places, best))


def _over_visits(
    odds: NDArray[np.float32], views: NDArray[np.float32]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """M best places, and the log-odds of showing what they show, at whichever visit.

    Of several visits to a place the one counts that goes on from the frame before. Frames of the map that look alike
    within a run are one visit.

    Args:
        odds: M×N.
        views: N×D, centred, of the map.
    """
    places = odds.argmax(axis=1)
    best: NDArray[np.float32] = odds[np.arange(len(odds)), places]
    length = np.linalg.norm(views, axis=1)
    visits: dict[int, list[NDArray[np.int64]]] = {}
    for frame, place in enumerate(places.tolist()):
        if place not in visits:
            alike = np.flatnonzero(views @ views[place] >= _ALIKE * length * length[place])
            visits[place] = np.split(alike, np.flatnonzero(np.diff(alike) > RUN) + 1)
        if len(visits[place]) > 1:
            shown = np.array([visit[odds[frame, visit].argmax()] for visit in visits[place]])
            worth = float(expit(odds[frame, shown].astype(np.float64)).sum())
            best[frame] = logit(min(worth, _CERTAIN))
            near = np.abs(shown - places[frame - 1]) if frame else np.array([_STEP + 1])
            if near.min() <= _STEP:
                places[frame] = shown[near.argmin()]
    return places, best


def _in_runs(sure: NDArray[np.bool_], places: NDArray[np.int64]) -> NDArray[np.bool_]:
    """M bool: sure, and part of a run of at least 10 that moves by at most 3 places a frame."""
    linked = sure[1:] & sure[:-1] & (np.abs(np.diff(places)) <= _STEP)
    run = np.concatenate([[0], np.cumsum(~linked)])  # a number for each run
    length = np.bincount(run, sure)
    kept: NDArray[np.bool_] = sure & (length[run] >= RUN)
    return kept
