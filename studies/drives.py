"""The second drives of the study of sequence searches: as recorded, with its real stops, and resampled."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.choices import Standardisation
from everplace.describe.files.descriptors import Descriptors
from everplace.match.matching import Matching, compare_descriptors
from everplace.route.route import Route
from everplace.route.selection import Selection, parse_frames
from everplace.route.traverse import Traverse
from everplace.route.truth import truth_by_position
from everplace.scoring.retrieval import choose_pair
from studies.resample import resample_drive


@dataclass(frozen=True)
class Recorded:
    """The second drive as it was recorded.

    Attributes:
        query: Descriptors of its M frames.
        place: M: the place of the map that each shows, ascending.
        moving: The first frame of every place.
    """

    query: Descriptors
    place: NDArray[np.int64]

    @property
    def moving(self) -> NDArray[np.int64]:
        return np.flatnonzero(np.diff(self.place, prepend=-1))


@dataclass(frozen=True, eq=False)
class DrivePair:
    """A second drive of nordland64 and the map it is on: winter against summer.

    Attributes:
        whole: The second drive, with the frames in which the train stands.
        place: The place of the map that each of its frames shows, ascending.
        database: The map.
        truth: Places × places: what counts as right.
    """

    whole: Traverse
    place: NDArray[np.int64]
    database: Traverse
    truth: NDArray[np.bool_]


TOLERANCE = 1


def choose_drives(route: Route, frames: str) -> DrivePair:
    """Chooses places as `--frames` does, dark and stationary ones dropped."""
    pair = choose_pair(route, "winter", "summer", Selection(parse_frames(frames), drop_dark=True, drop_stationary=True))
    lit = choose_pair(route, "winter", "summer", Selection(drop_dark=True))
    whole, place = with_stops(lit.query, pair.query)
    return DrivePair(whole, place, pair.database, truth_by_position(pair.query, pair.database, TOLERANCE))


@dataclass(frozen=True)
class Drive:
    """A second drive and the map it is on.

    Attributes:
        what: In the words of the table.
        options: Of `resample_drive`; None: the drive as recorded.
        stands: Whether the recorded frames in which the train stands are among them; else they are left out.
        hole: Share of the places, in the middle, that the map lacks.
        blank: Whether one and the same frame stands in for all frames of some stretches of 5 to 40.
    """

    what: str
    options: dict[str, Any] | None = None
    stands: bool = False
    hole: float = 0.0
    blank: bool = False


AS_RECORDED = Drive("as recorded")
RESAMPLED = Drive("speeds 0.7 to 1.4, stops", {})
DRIVES = (
    AS_RECORDED,
    Drive("as recorded, standing too", stands=True),
    RESAMPLED,
    Drive("and stretches in reverse", {"reverse": 0.02}),
    Drive("and 4 kidnappings", {"reverse": 0.02, "jumps": 4}),
    Drive("and a fifth off the map", {"reverse": 0.02, "jumps": 4}, hole=0.2),
    Drive("at the map's pace, one image for 5 to 40 frames", {"speeds": (1.0, 1.0), "stop": 0.0}, blank=True),
)


def with_stops(drive: Traverse, moving: Traverse) -> tuple[Traverse, NDArray[np.int64]]:
    """The drive from the first to the last of the frames in which the train moves, and which of these each shows."""
    first, last = (drive.stems.index(stem) for stem in (moving.stems[0], moving.stems[-1]))
    whole, moves = drive[first : last + 1], frozenset(moving.stems)
    return whole, np.cumsum([stem in moves for stem in whole.stems]) - 1


def similarities(
    recorded: Recorded,
    database: Descriptors,
    truth: NDArray[np.bool_],
    how: Standardisation | None,
    drive: Drive,
    seeds: int,
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.int64]]]:
    """Similarity and truth of one drive after the other, and the place that each of its frames shows."""
    count = len(database)
    gap = round(count * drive.hole)
    mapped = np.delete(np.arange(count), slice((count - gap) // 2, (count + gap) // 2))
    for seed in range(seeds if drive.options is not None else 1):
        frames = np.arange(len(recorded.place)) if drive.stands else recorded.moving
        if drive.options is not None:
            frames = frames[resample_drive(len(frames), seed, **drive.options)]
        shown = recorded.place[frames]
        seen = one_image(frames, seed) if drive.blank else frames
        S = compare_descriptors(_rows(recorded.query, seen), _rows(database, mapped), Matching(how))
        yield S, truth[np.ix_(shown, mapped)], shown


def one_image(frames: NDArray[np.int64], seed: int) -> NDArray[np.int64]:
    """The same frames, but for stretches of 5 to 40 that all show one frame of the drive; 20 to 60 lie between."""
    rng = np.random.default_rng(seed)
    seen, begin = frames.copy(), int(rng.integers(20, 61))
    while begin < len(seen):
        end = begin + int(rng.integers(5, 41))
        seen[begin:end] = rng.choice(frames)
        begin = end + int(rng.integers(20, 61))
    return seen


def _rows(descriptors: Descriptors, rows: NDArray[np.int64]) -> Descriptors:
    names = tuple(f"{position}: {descriptors.names[row]}" for position, row in enumerate(rows))
    return replace(descriptors, values=descriptors.values[rows], names=names, image_names=None)
