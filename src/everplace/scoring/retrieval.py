"""From a route, two traverses and a method to scores: select, describe, compare, and score against the truth."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Descriptors
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, NotAlignedError, RouteError
from everplace.files import readable
from everplace.match.matching import Matching, compare_descriptors
from everplace.match.new_place import new_place_summary
from everplace.match.standardise import require_standardisable
from everplace.progress import Progress, quiet
from everplace.route.route import Route
from everplace.route.selection import Selection, select, select_maps
from everplace.route.traverse import Traverse
from everplace.route.truth import require_shared_stems, truth_by_pose, truth_by_position
from everplace.scoring.precision_table import AtPrecision, precision_table
from everplace.scoring.scores import PrecisionRecall, Scores, evaluate, precision_recall

__all__ = [
    "MatchRule",
    "Pair",
    "Retrieval",
    "choose_pair",
    "pair_of",
    "retrieve",
    "retrieve_pair",
    "rule_of",
    "true_matches",
]


def retrieve(
    route: Route,
    query: str,
    database: str,
    method: str | os.PathLike[str] | Describer,
    *,
    tolerance: int | None = None,
    radius: float | None = None,
    selection: Selection | None = None,
    matching: Matching | None = None,
    query_frames: slice | None = None,
    progress: Progress = quiet,
) -> Retrieval:
    """Looks for the frames of one traverse among those of another, and scores what is found.

    Of traverses that are not aligned nobody knows what is right: their matches are found, and not scored.

    Args:
        route: Such as `everplace.open_route` gives.
        query: Traverse or condition that asks.
        database: Traverse or condition that is the map.
        method: A run directory, the name of a method, or what `everplace.load` gives.
        tolerance: Places along the route by which a match may be off. Without it and `radius` the route says what is
            right: its tolerance, radius or file of pairs, else ±1 place.
        radius: Metres by which a match may be off, where poses are known.
        selection: Which places take part; None: all.
        matching: How descriptors are compared; None: as they are, frame by frame.
        query_frames: Places that ask, by position as in `selection.frames`; the map keeps all. None: all ask.
        progress: Told of downloads and of the describing.

    Raises:
        RouteError: A traverse does not exist, nothing is left of the route, or it lacks what is to tell the truth.
        MethodError: The method does not exist or cannot run here.
        CheckpointError: The run directory is damaged.
        ConfigError: Both a tolerance and a radius are given, or the descriptors cannot be standardised.
        ImageError: A frame cannot be decoded.
    """
    matching = matching or Matching()
    describer = _opened(method, matching, progress)
    selection = selection or Selection()
    pair = choose_pair(route, query, database, selection, progress)
    if query_frames is not None:
        pair = replace(pair, query=_asking(pair.query, query_frames, selection))
    return retrieve_pair(pair, describer, MatchRule(tolerance, radius), matching, progress=progress)


def retrieve_pair(
    pair: Pair,
    describer: Describer,
    truth: MatchRule,
    matching: Matching,
    *,
    described: Mapping[str, Descriptors] | None = None,
    progress: Progress = quiet,
) -> Retrieval:
    """Does what `retrieve` does with a pair that is chosen and a method that is open.

    Args:
        pair: The traverses.
        describer: The method.
        truth: When a match is right; what it leaves open comes from the route.
        matching: How descriptors are compared.
        described: Descriptors by traverse name that were made before, of at least the pair's frames; None: describe.
        progress: Told of the describing.
    """
    why_unscored, true, rule = "", None, None
    try:
        true, rule = true_matches(pair, truth)
    except NotAlignedError as error:
        if not pair.route.matched_by_stem:  # another truth is there, instead of which one by stems was asked for
            raise
        why_unscored = str(error)
    if described is None:
        traverses = {traverse.name: traverse for traverse in (pair.query, pair.database)}
        described = {name: describer.describe(one, progress=progress) for name, one in traverses.items()}
    query = described[pair.query.name].of(pair.query.stems)
    database = described[pair.database.name].of(pair.database.stems)
    frame_by_frame = None
    if true is not None and matching.sequence > 1:
        frame_by_frame = evaluate(compare_descriptors(query, database, replace(matching, sequence=1)), true)
    S = compare_descriptors(query, database, matching)
    return Retrieval(
        pair=pair,
        describer=describer,
        matching=matching,
        rule=rule,
        similarity=S,
        truth=true,
        scores=None if true is None else evaluate(S, true),
        curve=None if true is None else precision_recall(S, true),
        new_place=new_place_summary(query, database),
        why_unscored=why_unscored,
        frame_by_frame=frame_by_frame,
    )


def _asking(query: Traverse, frames: slice, selection: Selection) -> Traverse:
    """The frames of the query at these positions of the list of places, of which `selection.frames` is a part."""
    first = 0 if selection.frames is None else selection.frames.start or 0
    asking = query[max((frames.start or 0) - first, 0) : None if frames.stop is None else max(frames.stop - first, 0)]
    if not len(asking):
        raise RouteError(
            f"`query_frames` leaves no frame of {readable(query.name)}, which has the places {first} to "
            f"{first + len(query) - 1}; choose among these"
        )
    return asking


def _opened(method: str | os.PathLike[str] | Describer, matching: Matching, progress: Progress) -> Describer:
    describer = method if isinstance(method, Describer) else open_describer(method, progress=progress)
    if matching.standardise is not None:
        require_standardisable(describer.method, describer.metric)
    return describer


@dataclass(frozen=True)
class MatchRule:
    """When two frames show the same place.

    Attributes:
        tolerance: Places along the route by which a match may be off; None: `radius` or `pairs` counts.
        radius: Metres by which a match may be off, where poses are known.
        pairs: The file of the route that lists what belongs together; never given by a user.
    """

    tolerance: int | None = None
    radius: float | None = None
    pairs: str | None = None

    def metrics(self) -> dict[str, str | int | float | None]:
        """What metrics.json says of it."""
        return {"tolerance": self.tolerance, "radius": self.radius, "truth": self.pairs}

    def __str__(self) -> str:
        if self.pairs is not None:
            return f"pairs of {self.pairs}"
        return f"±{self.tolerance} frames" if self.radius is None else f"within {self.radius:g} m"


@dataclass(frozen=True, eq=False)
class Pair:
    """A query traverse against a database traverse.

    Attributes:
        route: The route after selection, with both.
        query: The frames that ask.
        database: The whole map.
    """

    route: Route
    query: Traverse
    database: Traverse

    @property
    def tested(self) -> Route:
        """The route of the places that ask: what a method may not know from before."""
        if not self.route.matched_by_stem:
            return self.route
        asked = frozenset(self.query.stems)
        traverses = []
        for traverse in self.route.traverses:
            kept = [index for index, stem in enumerate(traverse.stems) if stem in asked]
            traverses.append(self.query if traverse.name == self.query.name else traverse.take(kept))
        return replace(self.route, traverses=tuple(traverses))

    @property
    def warning(self) -> str:
        """What must be said where both sides are the same frames, so that the scores mean nothing; else empty."""
        if self.query.paths != self.database.paths:
            return ""
        return (
            f"query and database are both {readable(self.query.name)!r}, so every frame finds itself and the scores "
            "say nothing; give two traverses with `query` and `database`"
        )


@dataclass(frozen=True, eq=False)
class Retrieval:
    """What came out for one method and one pair.

    Attributes:
        pair: The traverses and their route, after selection.
        describer: The method.
        matching: How descriptors were compared.
        rule: When a match is right, fully resolved; None where the traverses are not aligned, as are truth, scores and
            curve.
        similarity: M×N, rows = queries.
        truth: M×N, true where `rule` says that both frames show the same place.
        scores: See `everplace.scoring.scores`.
        curve: The best-match precision-recall curve.
        new_place: Where the method knows the probability that a query shows a place that is not in the database: its
            mean over the queries (`mean_probability`), and how many queries have one above one half (`above_half`).
        why_unscored: What keeps the matches from being scored, and the remedy; empty where they are.
        frame_by_frame: The scores without sequences, where sequences are matched.
    """

    pair: Pair
    describer: Describer
    matching: Matching
    rule: MatchRule | None
    similarity: NDArray[np.floating[Any]]
    truth: NDArray[np.bool_] | None
    scores: Scores | None
    curve: PrecisionRecall | None
    new_place: dict[str, float] | None = None
    why_unscored: str = ""
    frame_by_frame: Scores | None = None

    @cached_property
    def precision_table(self) -> dict[str, AtPrecision] | None:
        """Threshold and recall at some precisions; None where the matches are not scored."""
        return None if self.truth is None else precision_table(self.similarity, self.truth)

    @property
    def query(self) -> Traverse:
        """The M frames that ask."""
        return self.pair.query

    @property
    def database(self) -> Traverse:
        """The N frames of the map."""
        return self.pair.database


def choose_pair(route: Route, query: str, database: str, selection: Selection, progress: Progress = quiet) -> Pair:
    """Restricts a route to two conditions and to the places that take part.

    Where the route tells the same places by poses or by a file of pairs, a frame needs no partner of the same
    stem to take part. Where stems tell them and one traverse has all places of the other and twice as many, it keeps
    the others too (see `select_maps`): the pair's database is the whole map, and only the places of both ask.

    Raises:
        RouteError: A condition does not exist, or nothing is left.
    """
    names = [route[query].name, route[database].name]
    both = route.only(list(dict.fromkeys(names)))
    if route.matched_by_stem:
        chosen = select_maps(both, selection, progress)
    else:
        chosen = select(both, selection, progress, only_shared=False)
    return pair_of(chosen, *names)


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
    return Pair(route, asking, map_)


def true_matches(pair: Pair, truth: MatchRule) -> tuple[NDArray[np.bool_], MatchRule]:
    """The truth of a pair, and what told it, as `rule_of` says.

    Frames are counted along all frames of the two traverses of the route, also those that do not ask.

    Raises:
        ConfigError: Both a tolerance and a radius are given.
        RouteError: Poses are missing for a radius, or the file of pairs is wrong.
        NotAlignedError: Stems are to tell the truth, but are no places, or none is shared.
    """
    rule, route = rule_of(pair, truth), pair.route
    if rule.radius is not None:
        return truth_by_pose(pair.query, pair.database, rule.radius), rule
    if rule.tolerance is None:
        assert route.truth is not None
        return route.truth.matches(pair.query, pair.database), rule
    places = route[pair.query.name].stems
    return truth_by_position(pair.query, pair.database, rule.tolerance, places), rule


def rule_of(pair: Pair, truth: MatchRule) -> MatchRule:
    """What tells the truth of a pair, if names show that it can; what is left open comes from route.toml, else ±1.

    Raises:
        ConfigError: Both a tolerance and a radius are given.
        NotAlignedError: Stems are to tell the truth, but are no places, or none is shared.
    """
    route = pair.route
    if truth.tolerance is not None and truth.radius is not None:
        raise ConfigError("`tolerance` and `radius` are two truths; give one of them")
    if truth.tolerance is not None and truth.tolerance < 0:  # a mistake, whatever the traverses are
        raise ConfigError(f"tolerance {truth.tolerance} is negative; give 0 or a number of frames")
    if truth.tolerance is None and truth.radius is None:
        if route.truth is not None:
            return MatchRule(pairs=route.truth.path.name)
        tolerance = route.tolerance if route.radius is None else None
        truth = MatchRule(1 if tolerance is None and route.radius is None else tolerance, route.radius)
    if truth.radius is not None:
        return truth
    if not route.stems_are_places and pair.query.name != pair.database.name:
        raise NotAlignedError(
            f"the traverses {pair.query.name!r} and {pair.database.name!r} {route.why_not_aligned}, so nobody knows "
            "which frames show the same place; add poses and give `radius`, or find them with `everplace data align`"
        )
    require_shared_stems(pair.query, pair.database)
    return truth
