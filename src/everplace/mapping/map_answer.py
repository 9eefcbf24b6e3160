"""What a localizer answers: where a frame was taken, and what that rests on."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.route.traverse import Pose

__all__ = ["MapAnswer", "Observation", "PlaceMatch"]


@dataclass(frozen=True, slots=True)
class MapAnswer:
    """Where a frame was taken.

    Attributes:
        place: The best place.
        drive: The drive whose frame of that place is most like the query.
        database_frame: That frame's name; also where `off_map` is high.
        score: Cosine between the two, in [-1, 1]; -1 too where every frame of the map is left out.
        probability: That the frame shows the place, or a neighbour of it, in [0, 1].
        off_map: Probability that it shows no place of the map, in [0, 1].
        condition: Probability of each condition that the map knows.
        unseen_condition: Whether it looks like none of them.
        pose: Where the frame of the map was taken, if that is known.
        provisional: Whether the probabilities come from elsewhere, as the map knows one drive only.
        time: As it was given.
    """

    place: int
    drive: str
    database_frame: str
    score: float
    probability: float
    off_map: float
    condition: dict[str, float]
    unseen_condition: bool
    pose: Pose | None
    provisional: bool
    time: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of `everplace localize --json-lines`, without the frame's own name."""
        return {**asdict(self), "pose": None if self.pose is None else list(self.pose)}


@dataclass(frozen=True, slots=True)
class PlaceMatch:
    """A place that a frame may show.

    Attributes:
        id: Row of the frame below, in the order of `Map.frames`.
        drive: The drive whose frame of the place is most like the query.
        condition: Of that drive.
        database_frame: That frame's name.
        place: The place.
        score: Cosine between the two, in [-1, 1].
        probability: That the query shows the place, or a neighbour of it, in [0, 1].
        pose: Where the frame of the map was taken, if that is known.
    """

    id: int
    drive: str
    condition: str
    database_frame: str
    place: int
    score: float
    probability: float
    pose: Pose | None


@dataclass(frozen=True, eq=False)
class Observation:
    """An answer, and what it rests on.

    Attributes:
        answer: Where the frame was taken.
        belief: (P,) probability of each place of `Localizer.places`, in [0, 1]; what is missing to 1 is "off the map".
        similarity: (P,) cosine with the best frame of each, in [-1, 1]; -1 too where every frame is left out.
        matches: The places that are worth most as an answer, best first: the first is that of the answer.
    """

    answer: MapAnswer
    belief: NDArray[np.float64]
    similarity: NDArray[np.float32]
    matches: tuple[PlaceMatch, ...]
