"""What one drive taught a map: which of its frames were matched with which places, how surely, and how rightly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from everplace.mapping.self_teaching import FrameMatches, SurePairs

__all__ = ["TaughtDrive", "places_by_name"]

_NEAR = 1
_ELSEWHERE = -10


@dataclass(frozen=True, eq=False)
class TaughtDrive:
    """What one drive taught.

    Attributes:
        name: The drive.
        stems: Of its M frames.
        map_stems: Of the map's N places.
        pairs: Its sure frames with their places on the map.
        true: (M,) the place of each frame, far below 0 where the map has none; None: nobody knows.
    """

    name: str
    stems: Sequence[str]
    map_stems: Sequence[str]
    pairs: SurePairs
    true: NDArray[np.int64] | None = None

    @property
    def right(self) -> float | None:
        """Share of the pairs within one place of the true one; None: nobody knows, or there is no pair to judge."""
        if self.true is None or not len(self.pairs.frames) or not (self.true[self.pairs.frames] >= 0).any():
            return None
        return float((np.abs(self.true[self.pairs.frames] - self.pairs.places) <= _NEAR).mean())

    @property
    def matches(self) -> FrameMatches:
        """What every frame was matched with; of a drive that was matched by its images."""
        assert self.pairs.matches is not None
        return self.pairs.matches

    @property
    def sure(self) -> NDArray[np.bool_]:
        """(M,) whether the frame taught."""
        taught = np.zeros(self.pairs.of, np.bool_)
        taught[self.pairs.frames] = True
        return taught

    @property
    def correct(self) -> NDArray[np.bool_] | None:
        """(M,) whether each frame's match, sure or not, is within one place of the true one; None: nobody knows."""
        return None if self.true is None else np.abs(self.true - self.matches.places) <= _NEAR

    def summary(self) -> dict[str, Any]:
        """What `--json` prints."""
        return {
            "name": self.name,
            "frames": self.pairs.of,
            "pairs": len(self.pairs.frames),
            "share": round(self.pairs.share, 4),
            "right": self.right,
        }

    def rows(self) -> Iterator[dict[str, Any]]:
        """For every frame: its stem, the place's, the log-odds, the probability, whether it taught and is right."""
        sure, correct = self.sure, self.correct
        for frame, (place, odds) in enumerate(zip(self.matches.places, self.matches.log_odds, strict=True)):
            yield {
                "frame": self.stems[frame],
                "place": self.map_stems[place],
                "log_odds": round(float(odds), 3),
                "probability": round(float(expit(float(odds))), 6),
                "sure": bool(sure[frame]),
                "right": None if correct is None else bool(correct[frame]),
            }


def places_by_name(stems: Sequence[str], map_stems: Sequence[str]) -> NDArray[np.int64] | None:
    """(M,) the place whose frame has the same name, far below 0 where there is none; None: no name is the map's."""
    place = {stem: index for index, stem in enumerate(map_stems)}
    found = np.array([place.get(stem, _ELSEWHERE) for stem in stems], np.int64)
    return found if (found >= 0).any() else None
