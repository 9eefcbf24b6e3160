"""The pictures of retrieval, made from frames: the similarity matrix and a gallery of matches."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from everplace.experiments.captions import UNKNOWN, match_note, pair_words, right_words, score_words
from everplace.images.decoding import ImageSpec, decode_image
from everplace.plots.canvas import new_axes, new_figure
from everplace.plots.match_gallery import Match, draw_matches
from everplace.plots.similarity_matrix import draw_similarity
from everplace.route.natural_order import natural_sorted
from everplace.route.selection import spread
from everplace.scoring.retrieval import Pair, Retrieval

__all__ = ["match_figure", "matrix_figure", "score_of", "title_of"]

_PICTURE = ImageSpec()


def match_figure(result: Retrieval, label: str, *, count: int = 8) -> Figure:
    """A gallery of right and wrong matches, half of each where there are enough, spread over the route.

    Where nobody knows what is right, the best matches of queries that are spread over the route.

    Args:
        result: What was found.
        label: What the title calls the method.
        count: Matches at most.
    """
    best = result.similarity.argmax(axis=1)
    if result.truth is None:
        groups = [np.arange(len(best)), np.arange(0)]
    else:
        right = result.truth[np.arange(len(best)), best]
        groups = [np.flatnonzero(right), np.flatnonzero(~right)]
    half = count // 2
    wanted = [max(half, count - len(groups[1])), max(half, count - len(groups[0]))]
    chosen = [group[spread(len(group), n)] for group, n in zip(groups, wanted, strict=True) if len(group)]
    matches = [_match(result, int(query), int(best[query])) for group in chosen for query in group]
    figure = new_figure(10)
    draw_matches(figure, matches[:count], title=title_of(result, label), note=match_note(result.rule, score_of(result)))
    return figure


def matrix_figure(result: Retrieval, label: str) -> Figure:
    """The similarity matrix with the best matches and, where it is known, the truth.

    Args:
        result: What was found.
        label: What the title calls the method.
    """
    figure, axes = new_axes(6.4, 5.6)
    query, database = result.query, result.database
    draw_similarity(
        axes, result.similarity, result.truth, query=f"query {query.name}", database=f"database {database.name}",
        query_names=query.stems, database_names=database.stems, score=score_of(result), title=title_of(result, label),
        note=UNKNOWN if result.rule is None else f"right: {right_words(result.rule)}", mark_best=True,
    )  # fmt: skip
    return figure


def title_of(result: Retrieval, label: str) -> str:
    """What was asked of the method that is called `label`."""
    return f"{label}: {pair_words(result.query.name, result.database.name)}"


def score_of(result: Retrieval) -> str:
    """What the number of a match is."""
    return score_words(result.describer.metric, result.matching)


def _match(result: Retrieval, query: int, proposed: int) -> Match:
    pair, truth = result.pair, result.truth
    true = None if truth is None else _true_frame(pair, query, np.flatnonzero(truth[query]))
    return Match(
        query=decode_image(pair.query.paths[query], _PICTURE),
        proposed=decode_image(pair.database.paths[proposed], _PICTURE),
        true=None if true is None else decode_image(pair.database.paths[true], _PICTURE),
        score=float(result.similarity[query, proposed]),
        right=None if truth is None else bool(truth[query, proposed]),
        query_name=f"{pair.query.name}/{pair.query.stems[query]}",
        proposed_name=f"{pair.database.name}/{pair.database.stems[proposed]}",
        true_name="" if true is None else f"{pair.database.name}/{pair.database.stems[true]}",
    )


def _true_frame(pair: Pair, query: int, true: NDArray[np.intp]) -> int | None:
    """Of the database frames that are right, the query's very place, else the nearest one that can be told.

    Nearest by pose, or along the route where stems tell the place. Where neither does, it is the middle one.
    """
    if not len(true):
        return None
    stem, stems = pair.query.stems[query], pair.database.stems
    same = next((int(index) for index in true if stems[index] == stem), None)
    if same is not None:
        return same
    if pair.query.poses is not None and pair.database.poses is not None:
        distance = np.linalg.norm(pair.database.poses[true, :2] - pair.query.poses[query, :2], axis=1)
        return int(true[distance.argmin()])
    if frozenset(stems).isdisjoint(pair.query.stems):
        return int(true[len(true) // 2])
    order = {name: rank for rank, name in enumerate(natural_sorted({*stems, *pair.query.stems}))}
    return min(map(int, true), key=lambda index: abs(order[stems[index]] - order[stem]))
