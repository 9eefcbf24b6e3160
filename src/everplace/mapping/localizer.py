"""Answers where a frame was taken on a map, with a probability, and under which condition."""

from __future__ import annotations

import copy
import os
from collections import deque
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.describe.runs.adapted import AdaptedDescriber
from everplace.errors import MapError
from everplace.images.decoding import convert_image
from everplace.mapping.calibration import likelihood_ratios_of, place_posterior
from everplace.mapping.described_drive import how_it_looks
from everplace.mapping.frame_window import MAP_MODEL, SEQUENCE, window_posterior
from everplace.mapping.place_scores import PlaceFrames
from everplace.mapping.reliability import threshold_for
from everplace.mapping.route_map import Map
from everplace.match.similarity import directions
from everplace.route.traverse import Pose
from everplace.sequences.route_model import RouteModel

__all__ = ["Localizer", "MapAnswer", "Observation", "PlaceMatch"]

_REACH = 1


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
    """

    id: int
    drive: str
    condition: str
    database_frame: str
    place: int
    score: float
    probability: float


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


class Localizer:
    """Answers frame by frame from one version of a map."""

    def __init__(
        self, map_: Map | str | os.PathLike[str], *, sequence: int = SEQUENCE, model: RouteModel | None = None
    ) -> None:
        """Reads what it needs of the map.

        Args:
            map_: The map, or its address.
            sequence: Frames that an answer rests on, the last ones (the sequence filter); 1: each frame alone.
            model: What is assumed of the drive; None: the defaults.

        Raises:
            MapError: The map is missing, damaged, or made with what is not here.
        """
        opened = map_ if isinstance(map_, Map) else Map.open(map_)
        self.map = opened
        table = opened.frames("stem", "place", "position", "x", "y", "heading", "number")
        places = np.asarray(table["place"])
        self._order = PlaceFrames(places, np.asarray(table["position"]))
        rows = self._order.rows
        self._vectors = directions(opened.descriptors()[rows])
        stems, drives = table["stem"].to_pylist(), np.array(table["drive"].to_pylist())
        self._stems = [stems[row] for row in rows.tolist()]
        self._drives = drives[rows]
        self._poses = np.stack([np.asarray(table[name]) for name in ("x", "y", "heading")], axis=1)[rows]
        self._adapted = AdaptedDescriber(opened.describer(), opened.projection, {})
        self._calibration = opened.calibration
        self._conditions = opened.condition_model
        self._model = MAP_MODEL if model is None else model
        self._seen: deque[NDArray[np.float64]] = deque(maxlen=sequence)
        self._numbers = np.asarray(table["number"])[rows]
        self._condition_of = {drive["name"]: drive["condition"] for drive in opened.document["drives"]}

    def another(self, sequence: int) -> Localizer:
        """A localizer of another drive, which shares with this one all that stays the same from frame to frame.

        Several may answer at once, in threads of their own.

        Args:
            sequence: As for a new one.
        """
        other = copy.copy(self)
        other._seen = deque(maxlen=sequence)
        return other

    @property
    def places(self) -> NDArray[np.int64]:
        """(P,) the map's places, in the order of travel."""
        return self._order.places

    @property
    def provisional(self) -> bool:
        """Whether its probabilities come from elsewhere, as the map knows one drive only."""
        return self._calibration.provisional

    def threshold(self, precision: float | None) -> float:
        """The least probability of a match by which a share `precision` of the matches is right; None: 0.

        It is that of drives of the map itself, looked for while they were held out; of a map of one drive, which has
        none, the precision itself.

        Raises:
            MapError: The held-out answers never were so precise.
        """
        if precision is None or self.provisional:
            return precision or 0.0
        least, _ = threshold_for(precision, *self.map.held_out_answers)
        if not np.isfinite(least):
            raise MapError(
                f"answers of this map are never so sure that {precision:.1%} are right; give a lower `precision`"
            )
        return float(least)

    def state(self) -> NDArray[np.float64]:
        """L×P: what it knows of the drive so far, to go on with `restore` in another process."""
        return np.array(list(self._seen)).reshape(-1, len(self._order))

    def restore(self, state: NDArray[np.float64]) -> None:
        """Goes on where `state` was taken, on the same version of the map.

        Raises:
            MapError: It is of another map, or of another version.
        """
        if state.ndim != 2 or state.shape[1] != len(self._order):
            raise MapError("this state is of another map, or of another version of it; begin anew")
        self._seen.clear()
        self._seen.extend(np.asarray(state, np.float64))

    def locate(
        self, image: NDArray[np.uint8], time: float | None = None, *, excluded: tuple[str, int, int] | None = None
    ) -> MapAnswer:
        """Answers one frame.

        Args:
            image: H×W, H×W×1 or H×W×3 (RGB) uint8, of any size.
            time: Seconds; handed on.
            excluded: (drive, k, n): frames of that drive of the map that are nearer than n to its k-th do not match,
                so that a drive that is on the map shows where it comes back.

        Raises:
            ImageError: The array is no image.
        """
        return self.observe(image, time, excluded=excluded).answer

    def observe(
        self,
        image: NDArray[np.uint8],
        time: float | None = None,
        *,
        matches: int = 0,
        excluded: tuple[str, int, int] | None = None,
    ) -> Observation:
        """Answers one frame as `locate` does, and says what the answer rests on.

        Args:
            image: As for `locate`.
            time: Seconds; handed on.
            matches: How many places to name.
            excluded: As for `locate`.

        Raises:
            ImageError: The array is no image.
        """
        base = self._adapted.base
        features = base.describe_batch(convert_image(image, base.image)[None])[0]
        return self._observe(features, how_it_looks(np.asarray(image)), time, matches, excluded)

    def locate_described(
        self,
        features: NDArray[np.floating],
        looks: NDArray[np.float32],
        time: float | None = None,
        *,
        excluded: tuple[str, int, int] | None = None,
    ) -> MapAnswer:
        """Answers one frame by what `everplace.mapping.described_drive.describe_drive` says of it.

        Args:
            features: (F,) of the map's method.
            looks: (S,) of `everplace.mapping.image_statistics.how_it_looks`.
            time: Seconds; handed on.
            excluded: As for `locate`.
        """
        return self._observe(features, looks, time, 0, excluded).answer

    def _observe(
        self,
        features: NDArray[np.floating],
        looks: NDArray[np.float32],
        time: float | None,
        matches: int,
        excluded: tuple[str, int, int] | None,
    ) -> Observation:
        vector = directions(self._adapted.project(features[None].astype(np.float32, copy=False)))
        frames = vector @ self._vectors.T
        if excluded is not None:
            drive, number, distance = excluded
            frames[0, (self._drives == drive) & (np.abs(self._numbers - number) < distance)] = -np.inf
        scores = self._order.fuse(frames)
        scores[np.isneginf(scores)] = np.nan
        self._seen.append(likelihood_ratios_of(scores[0], self._calibration))
        posterior, off = self._posterior(scores[0])
        posterior = np.where(np.isnan(scores[0]), 0, posterior)  # though frames before lead there
        worth = self._model.worth(posterior[None])[0]
        column = int(worth.argmax())
        found = self._match(frames[0], posterior, column)
        pose = self._poses[self._best_frame(frames[0], column)]
        answer = MapAnswer(
            place=found.place,
            drive=found.drive,
            database_frame=found.database_frame,
            score=found.score,
            probability=found.probability,
            off_map=min(max(off, 0.0), 1.0),
            condition=self._conditions.posterior(looks),
            unseen_condition=self._conditions.unseen(looks),
            pose=None if np.isnan(pose).any() else Pose(*pose.tolist()),
            provisional=self._calibration.provisional,
            time=time,
        )
        similarity = np.where(np.isnan(scores[0]), np.float32(-1), scores[0])
        columns = np.argsort(-worth, kind="stable")[:matches].tolist() if matches else []
        named = tuple(self._match(frames[0], posterior, column) for column in columns)
        return Observation(answer, posterior, similarity, named)

    def _match(self, scores: NDArray[np.float32], posterior: NDArray[np.float64], column: int) -> PlaceMatch:
        """What there is to say of a place."""
        best = self._best_frame(scores, column)
        near = float(posterior[max(column - _REACH, 0) : column + _REACH + 1].sum())
        drive = str(self._drives[best])
        return PlaceMatch(
            id=int(self._order.rows[best]),
            drive=drive,
            condition=self._condition_of[drive],
            database_frame=self._stems[best],
            place=int(self._order.places[column]),
            score=max(float(scores[best]), -1.0),
            probability=min(max(near, 0.0), 1.0),
        )

    def _posterior(self, scores: NDArray[np.float32]) -> tuple[NDArray[np.float64], float]:
        """Probability of every place, and of none."""
        if self._seen.maxlen == 1:
            found, away = place_posterior(scores, self._calibration)
            return np.asarray(found), float(away)
        return window_posterior(self._seen, len(self._order), self._model)

    def _best_frame(self, scores: NDArray[np.float32], column: int) -> int:
        starts = self._order.starts
        end = starts[column + 1] if column + 1 < len(starts) else len(scores)
        return int(starts[column] + scores[starts[column] : end].argmax())
