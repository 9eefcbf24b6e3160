"""Answers where a frame was taken on a map, with a probability, and under which condition."""

from __future__ import annotations

import copy
import os
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from everplace.describe.runs.adapted import AdaptedDescriber
from everplace.errors import MapError
from everplace.images.decoding import convert_image
from everplace.mapping import place_search
from everplace.mapping.calibration import place_posterior
from everplace.mapping.described_drive import how_it_looks
from everplace.mapping.frame_graph import FrameGraph
from everplace.mapping.frame_window import MAP_MODEL, SEQUENCE, FrameWindow, state_width
from everplace.mapping.image_statistics import shows_nothing
from everplace.mapping.map_answer import MapAnswer, Observation, PlaceMatch
from everplace.mapping.place_scores import PlaceFrames
from everplace.mapping.place_search import PlaceSearch
from everplace.mapping.reliability import threshold_for
from everplace.mapping.route_map import Map
from everplace.match.similarity import directions
from everplace.progress import Progress, quiet, shown
from everplace.route.traverse import Pose
from everplace.sequences.route_model import RouteModel

__all__ = ["Localizer"]

_REACH = 1


class Localizer:
    """Answers frame by frame from one version of a map."""

    def __init__(
        self,
        map_: Map | str | os.PathLike[str],
        *,
        sequence: int = SEQUENCE,
        model: RouteModel | None = None,
        progress: Progress = quiet,
    ) -> None:
        """Reads what it needs of the map.

        Args:
            map_: The map, or its address.
            sequence: Frames that an answer rests on, the last ones (the sequence filter); those that show one view
                again, as of a robot that stands, count as one; 1: each frame alone.
            model: What is assumed of the drive; None: the defaults.
            progress: Told of a search graph that is built (`everplace.mapping.place_search`).

        Raises:
            MapError: The map is missing, damaged, or made with what is not here.
        """
        opened = map_ if isinstance(map_, Map) else Map.open(map_)
        self.map = opened
        table = opened.frames("stem", "place", "position", "x", "y", "heading", "number")
        places = np.asarray(table["place"])
        self._order = PlaceFrames(places, np.asarray(table["position"]))
        rows = self._order.rows
        vectors = directions(opened.descriptors()[rows])
        self._search = PlaceSearch(vectors, self._order, _graph_of(opened, vectors, progress))
        stems, drives = table["stem"].to_pylist(), np.array(table["drive"].to_pylist())
        self._stems = [stems[row] for row in rows.tolist()]
        self._drives = drives[rows]
        self._poses = np.stack([np.asarray(table[name]) for name in ("x", "y", "heading")], axis=1)[rows]
        self._adapted = AdaptedDescriber(opened.describer(), opened.projection, {})
        self._calibration = opened.calibration
        self._conditions = opened.condition_model
        self._model = MAP_MODEL if model is None else model
        self._window = self._begun(sequence)
        self._numbers = np.asarray(table["number"])[rows]
        self._condition_of = {drive["name"]: drive["condition"] for drive in opened.document["drives"]}

    def another(self, sequence: int) -> Localizer:
        """A localizer of another drive, which shares with this one all that stays the same from frame to frame.

        Several may answer at once, in threads of their own.

        Args:
            sequence: As for a new one.
        """
        other = copy.copy(self)
        other._window = self._begun(sequence)
        return other

    def _begun(self, sequence: int) -> FrameWindow | None:
        return FrameWindow(sequence, self._calibration, self._model) if sequence > 1 else None

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
        held_out = self.map.held_out_answers
        least, _ = threshold_for(precision, held_out.probability, held_out.right)
        if not np.isfinite(least):
            raise MapError(
                f"answers of this map are never so sure that {precision:.1%} are right; give a lower `precision`"
            )
        return float(least)

    def state(self) -> NDArray[np.float64]:
        """L×(7P + 3): what it knows of the drive so far, to go on with `restore` in another process."""
        views = [] if self._window is None else self._window.state()
        return np.array(views).reshape(-1, state_width(len(self._order)))

    def restore(self, state: NDArray[np.float64]) -> None:
        """Goes on where `state` was taken, on the same version of the map.

        Raises:
            MapError: It is of another map or of another version, or damaged.
        """
        if state.ndim != 2 or state.shape[1] != state_width(len(self._order)) or state.dtype != np.float64:
            raise MapError("this state is of another map, or of another version of it; begin anew")
        if self._window is not None:
            self._window.restore(state)

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
        vector = directions(self._adapted.project(features[None].astype(np.float32, copy=False)))[0]
        left_out = None
        if excluded is not None:
            drive, number, distance = excluded
            left_out = (self._drives == drive) & (np.abs(self._numbers - number) < distance)
        found = self._search.scores(vector, left_out)
        if shows_nothing(looks):  # equal scores say nothing of the place
            found = replace(found, places=np.where(np.isnan(found.places), found.places, np.float32(0)))
        posterior, off = self._posterior(found.places)
        posterior = np.where(np.isnan(found.places), 0, posterior)  # though frames before lead there

        def match(column: int) -> PlaceMatch:
            best, score = self._search.best_frame(vector, found, column, left_out)
            near = float(posterior[max(column - _REACH, 0) : column + _REACH + 1].sum())
            drive = str(self._drives[best])
            pose = self._poses[best]
            return PlaceMatch(
                id=int(self._order.rows[best]),
                drive=drive,
                condition=self._condition_of[drive],
                database_frame=self._stems[best],
                place=int(self._order.places[column]),
                score=max(score, -1.0),
                probability=min(max(near, 0.0), 1.0),
                pose=None if np.isnan(pose).any() else Pose(*pose.tolist()),
            )

        worth = self._model.worth(posterior[None])[0]
        best = match(int(worth.argmax()))
        answer = MapAnswer(
            place=best.place,
            drive=best.drive,
            database_frame=best.database_frame,
            score=best.score,
            probability=best.probability,
            off_map=min(max(off, 0.0), 1.0),
            condition=self._conditions.posterior(looks),
            unseen_condition=self._conditions.unseen(looks),
            pose=best.pose,
            provisional=self._calibration.provisional,
            time=time,
        )
        similarity = np.where(np.isnan(found.places), np.float32(-1), found.places)
        columns = np.argsort(-worth, kind="stable")[:matches].tolist() if matches else []
        return Observation(answer, posterior, similarity, tuple(match(column) for column in columns))

    def _posterior(self, scores: NDArray[np.float32]) -> tuple[NDArray[np.float64], float]:
        """Probability of every place, and of none."""
        if self._window is not None:
            return self._window.add(scores)
        found, away = place_posterior(scores, self._calibration)
        return np.asarray(found), float(away)


def _graph_of(opened: Map, vectors: NDArray[np.float32], progress: Progress) -> FrameGraph | None:
    """The graph that is searched; None: the search is exact.

    A map of few frames needs none, and an earlier version is asked too seldom for one to be built.
    """
    if len(vectors) < place_search.EXACT_BELOW or not opened.is_newest():
        return None
    return shown(
        progress,
        f"preparing the search among {len(vectors):,} frames",
        lambda: FrameGraph.kept(vectors, opened.graph_directories),
    )
