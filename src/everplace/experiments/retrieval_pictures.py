"""The pictures of retrieval, made from frames: the similarity matrix and a gallery of right and wrong matches."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from everplace.images.decoding import ImageSpec, decode_image
from everplace.plots.canvas import new_axes, new_figure
from everplace.plots.gallery import Match, draw_matches
from everplace.plots.matrix import draw_similarity
from everplace.route.natural_order import natural_sorted
from everplace.route.selection import spread
from everplace.scoring.retrieval import Pair, Retrieval

__all__ = ["match_figure", "matrix_figure"]

_PICTURE = ImageSpec()


def match_figure(pair: Pair, result: Retrieval, *, count: int = 8, title: str = "", note: str = "") -> Figure:
    """A gallery of right and wrong matches, half of each where there are enough, spread over the route.

    Args:
        pair: The traverses.
        result: Of this pair.
        count: Matches at most.
        title: Written above.
        note: Written below the title; see `everplace.experiments.captions.match_note`.
    """
    best = result.similarity.argmax(axis=1)
    right = result.truth[np.arange(len(best)), best]
    groups = [np.flatnonzero(right), np.flatnonzero(~right)]
    half = count // 2
    wanted = [max(half, count - len(groups[1])), max(half, count - len(groups[0]))]
    chosen = [group[spread(len(group), n)] for group, n in zip(groups, wanted, strict=True) if len(group)]
    matches = [_match(pair, result, int(query), int(best[query])) for group in chosen for query in group]
    figure = new_figure(10)
    draw_matches(figure, matches[:count], title=title, note=note)
    return figure


def matrix_figure(
    pair: Pair, result: Retrieval, *, title: str = "", note: str = "", score: str = "similarity"
) -> Figure:
    """The similarity matrix with the truth and the best matches.

    Args:
        pair: The traverses.
        result: Of this pair.
        title: Written above.
        note: Written below the title.
        score: What the numbers are; see `everplace.experiments.captions.score_words`.
    """
    figure, axes = new_axes(6.4, 5.6)
    draw_similarity(
        axes, result.similarity, result.truth, query=f"query {pair.query.name}",
        database=f"database {pair.database.name}", query_names=pair.query.stems, database_names=pair.database.stems,
        score=score, title=title, note=note,
    )  # fmt: skip
    return figure


def _match(pair: Pair, result: Retrieval, query: int, proposed: int) -> Match:
    true = _true_frame(pair, query, np.flatnonzero(result.truth[query]))
    return Match(
        query=decode_image(pair.query.paths[query], _PICTURE),
        proposed=decode_image(pair.database.paths[proposed], _PICTURE),
        true=None if true is None else decode_image(pair.database.paths[true], _PICTURE),
        score=float(result.similarity[query, proposed]),
        right=bool(result.truth[query, proposed]),
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
