"""One method on one ordered pair of conditions: descriptors, similarity, truth and scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from everplace.describe.costs import time_describer
from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Descriptors
from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.match.best_matches import compared
from everplace.match.new_place import new_place_summary
from everplace.match.similarity import similarity
from everplace.match.standardise import Standardisation
from everplace.progress import Progress, quiet
from everplace.route.route import Route
from everplace.route.selection import Selection, select, select_maps
from everplace.route.traverse import Traverse
from everplace.route.truth import truth_by_pose, truth_by_position
from everplace.scoring.scores import PrecisionRecall, Scores, evaluate, precision_recall
from everplace.sequences.sequence_search import SequenceMethod, search_sequences

__all__ = [
    "Matching",
    "Pair",
    "Retrieval",
    "Truth",
    "choose_pair",
    "of_itself_sentence",
    "pair_of",
    "retrieve",
    "true_matches",
]


@dataclass(frozen=True)
class Truth:
    """When two frames show the same place.

    Attributes:
        tolerance: Places along the route by which a match may be off; None: `radius` or `pairs` counts.
        radius: Metres by which a match may be off, where poses are known.
        pairs: The file of the route that lists what belongs together; never given by a user.
    """

    tolerance: int | None = None
    radius: float | None = None
    pairs: str | None = None

    def __str__(self) -> str:
        if self.pairs is not None:
            return f"pairs of {self.pairs}"
        return f"±{self.tolerance} frames" if self.radius is None else f"within {self.radius:g} m"


@dataclass(frozen=True)
class Matching:
    """Options of the match; each is named wherever a result of it is.

    Attributes:
        standardise: Subtract each traverse's mean descriptor (`centre`), also divide by its spread (`full`).
        sequence: Number of last frames that score each place; 1: frame by frame.
        sequence_method: How, see `everplace.sequences.sequence_search`.
    """

    standardise: Standardisation | None = None
    sequence: int = 1
    sequence_method: SequenceMethod = "filter"

    def metrics(self) -> dict[str, str | int | None]:
        """What metrics.json says of the match."""
        return {
            "standardise": self.standardise,
            "sequence": self.sequence,
            "sequence_method": self.sequence_method if self.sequence > 1 else None,
        }

    def __str__(self) -> str:
        parts = [f"standardised ({self.standardise})"] if self.standardise else []
        if self.sequence > 1:
            counted = ", stops not counted" if self.sequence_method == "filter" else ""
            parts.append(f"sequences of {self.sequence} ({self.sequence_method}{counted})")
        return ", ".join(parts) or "plain"


@dataclass(frozen=True)
class Pair:
    """A query traverse against a database traverse, after selection."""

    query: Traverse
    database: Traverse

    @property
    def of_itself(self) -> bool:
        """Whether both sides are the same frames, each of which then finds itself."""
        return self.query.paths == self.database.paths


def of_itself_sentence(pair: Pair) -> str:
    """Says that the scores of a pair of one traverse mean nothing."""
    return (
        f"query and database are both {readable(pair.query.name)!r}, so every frame finds itself and the scores say "
        "nothing; give two traverses with --query and --database"
    )


@dataclass(frozen=True, eq=False)
class Retrieval:
    """What came out for one method and one pair.

    Attributes:
        method: The method's name.
        similarity: M×N, rows = queries.
        truth: M×N.
        scores: See `everplace.scoring.scores`.
        curve: The best-match precision-recall curve.
        dimension: Numbers in a descriptor.
        ms_per_image: Description alone, model loading and decoding not counted.
        new_place: Where the method knows the probability that a query shows a place that is not in the database: its
            mean over the queries (`mean_probability`), and how many queries have one above one half (`above_half`).
    """

    method: str
    similarity: NDArray[np.float32]
    truth: NDArray[np.bool_]
    scores: Scores
    curve: PrecisionRecall
    dimension: int
    ms_per_image: float
    new_place: dict[str, float] | None = None


def choose_pair(
    route: Route, query: str, database: str, selection: Selection, progress: Progress = quiet
) -> tuple[Route, Pair]:
    """Restricts a route to two conditions and to the places that take part.

    Where the route tells the same places by poses or by a file of pairs, a frame needs no partner of the same
    stem to take part. Where stems tell them and one traverse has all places of the other and twice as many, it keeps
    the others too (see `select_maps`): the pair's database is the whole map, and only the places of both ask.

    Returns:
        The route of these two traverses (one, if both are the same), and the pair.

    Raises:
        RouteError: A condition does not exist, or nothing is left.
    """
    names = [route[query].name, route[database].name]
    both = route.only(list(dict.fromkeys(names)))
    if route.matched_by_stem:
        chosen = select_maps(both, selection, progress)
    else:
        chosen = select(both, selection, progress, only_shared=False)
    return chosen, pair_of(chosen, *names)


def pair_of(route: Route, query: str, database: str) -> Pair:
    """The ordered pair of two traverses of a selected route: the query's frames that ask, and the whole database.

    Where stems tell the places, only a frame asks whose place the database has.

    Args:
        route: A route as `choose_pair` and `select_tested` give it.
        query: Name of a traverse.
        database: Name of a traverse; it may be the same.
    """
    asking, map_ = route[query], route[database]
    if route.matched_by_stem and route.stems_are_places and len(asking) > len(map_):
        known = frozenset(map_.stems)
        asked = [index for index, stem in enumerate(asking.stems) if stem in known]
        asking = asking.take(asked) if asked else asking
    return Pair(asking, map_)


def true_matches(route: Route, pair: Pair, truth: Truth) -> tuple[NDArray[np.bool_], Truth]:
    """The truth of a pair; what `truth` leaves open comes from route.toml, else ±1 frame.

    Frames are counted along all frames of the two traverses of the route, also those that do not ask.

    Raises:
        ConfigError: Both a tolerance and a radius are given.
        RouteError: Poses are missing for a radius, the file of pairs is wrong, or stems that are no places are to tell
            the truth.
    """
    if truth.tolerance is not None and truth.radius is not None:
        raise ConfigError("--tolerance and --radius are two truths; give one of them")
    if truth.tolerance is None and truth.radius is None:
        if route.truth is not None:
            return route.truth.matches(pair.query, pair.database), Truth(pairs=route.truth.path.name)
        tolerance = route.tolerance if route.radius is None else None
        truth = Truth(1 if tolerance is None and route.radius is None else tolerance, route.radius)
    if truth.radius is not None:
        return truth_by_pose(pair.query, pair.database, truth.radius), truth
    assert truth.tolerance is not None
    if not route.stems_are_places and pair.query.name != pair.database.name:
        raise RouteError(
            f"the traverses {pair.query.name!r} and {pair.database.name!r} {route.why_not_aligned}, so nobody knows "
            "which frames show the same place; add poses and give --radius, or find them with `everplace data align`"
        )
    places = route[pair.query.name].stems
    return truth_by_position(pair.query, pair.database, truth.tolerance, places), truth


def retrieve(
    describer: Describer,
    pair: Pair,
    truth: NDArray[np.bool_],
    matching: Matching,
    *,
    described: dict[str, Descriptors] | None = None,
    ms_per_image: float | None = None,
    progress: Progress = quiet,
) -> Retrieval:
    """Describes both traverses, matches them and scores the result.

    Args:
        describer: The method.
        pair: The traverses.
        truth: M×N.
        matching: Options of the match.
        described: Descriptors by traverse name that were made before, of at least the pair's frames; new ones are
            added.
        ms_per_image: What was measured before; None: measure.
        progress: Told of the describing.
    """
    described = {} if described is None else described
    for traverse in (pair.query, pair.database):
        if traverse.name not in described:
            described[traverse.name] = describer.describe(traverse, progress=progress)
    query = described[pair.query.name].of(pair.query.stems)
    database = described[pair.database.name].of(pair.database.stems)
    S = similarity(*compared(query, database, matching.standardise))
    if matching.sequence > 1:
        S = search_sequences(S, matching.sequence, matching.sequence_method)
    return Retrieval(
        method=describer.method,
        similarity=S,
        truth=truth,
        scores=evaluate(S, truth),
        curve=precision_recall(S, truth),
        dimension=describer.dimension,
        ms_per_image=time_describer(describer, pair.query.paths) if ms_per_image is None else ms_per_image,
        new_place=new_place_summary(query, database),
    )
