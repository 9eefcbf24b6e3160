"""The pictures of a study, made from frames and models: galleries of matches, swap grids, constant grids."""

from __future__ import annotations

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from everplace.data.images import ImageSpec, decode_image, decode_images
from everplace.data.route import Route
from everplace.data.selection import spread
from everplace.errors import RouteError
from everplace.evaluate.audit import encode_frames
from everplace.experiments.retrieval import Pair, Retrieval
from everplace.model.architecture import ConditionVAE
from everplace.model.images import to_pixels
from everplace.plots.canvas import new_axes, new_figure
from everplace.plots.gallery import Match, draw_matches
from everplace.plots.grid import draw_constant_grid, draw_swap_grid
from everplace.plots.matrix import draw_similarity

__all__ = ["constant_figure", "match_figure", "matrix_figure", "swap_figure"]

_PICTURE = ImageSpec()


def match_figure(pair: Pair, result: Retrieval, *, count: int = 8, title: str = "") -> Figure:
    """A gallery of right and wrong matches, half of each where there are enough, spread over the route."""
    best = result.similarity.argmax(axis=1)
    right = result.truth[np.arange(len(best)), best]
    groups = [np.flatnonzero(right), np.flatnonzero(~right)]
    half = count // 2
    wanted = [max(half, count - len(groups[1])), max(half, count - len(groups[0]))]
    chosen = [group[spread(len(group), n)] for group, n in zip(groups, wanted, strict=True) if len(group)]
    matches = [_match(pair, result, int(query), int(best[query])) for group in chosen for query in group]
    figure = new_figure(10)
    draw_matches(figure, matches[:count], title=title)
    return figure


def matrix_figure(pair: Pair, result: Retrieval, *, title: str = "") -> Figure:
    """The similarity matrix with the truth and the best matches."""
    figure, axes = new_axes(6.4, 5.6)
    draw_similarity(
        axes, result.similarity, result.truth, query=pair.query.name, database=pair.database.name, title=title
    )
    return figure


def swap_figure(model: ConditionVAE, route: Route, place: int | None = None) -> Figure:
    """Figures 6 and 7: {z_p of frame a, z_c of frame b}, for one place seen in all conditions.

    Args:
        model: A trained model.
        route: Aligned traverses.
        place: Position of the place; the middle one by default.

    Raises:
        RouteError: The traverses share no place, or there is no such place.
    """
    position = len(route.traverses[0]) // 2 if place is None else place
    if not route.aligned:
        raise _not_aligned(route)
    if not 0 <= position < len(route.traverses[0]):
        raise RouteError(
            f"there is no place {position} that all traverses share; choose one below the number of places"
        )
    frames = _frames(model, route, [position])[:, 0]
    latents = encode_frames(model, frames)
    rows = [list(_decode(model, np.broadcast_to(z_p, (len(frames), len(z_p))), latents.z_c)) for z_p in latents.z_p]
    labels = [traverse.name for traverse in route.traverses]
    figure = new_figure(1.6 + 1.5 * len(labels))
    draw_swap_grid(
        figure, rows, list(frames), list(frames), place_labels=labels, condition_labels=labels,
        title="rows: z_p of this frame, columns: z_c of this frame",
    )  # fmt: skip
    return figure


def constant_figure(model: ConditionVAE, route: Route, *, count: int = 4) -> Figure:
    """Figures 8 and 9: condition-invariant images, {z_p of each frame, one constant z_c}.

    The constant is the mean z_c of the first traverse's chosen frames.
    """
    if not route.aligned:
        raise _not_aligned(route)
    positions = spread(len(route.traverses[0]), count)
    frames = _frames(model, route, positions)
    flat = np.concatenate(list(frames))
    latents = encode_frames(model, flat)
    constant = latents.z_c[: len(positions)].mean(axis=0)
    decoded = _decode(model, latents.z_p, np.broadcast_to(constant, (len(flat), len(constant))))
    labels = [f"{traverse.name} {traverse.stems[p]}" for traverse in route.traverses for p in positions]
    figure = new_figure(10)
    draw_constant_grid(
        figure, list(flat), list(decoded), labels=labels, columns=len(positions),
        title=f"z_p of each frame with one constant z_c (the mean of {route.traverses[0].name})",
    )  # fmt: skip
    return figure


def _not_aligned(route: Route) -> RouteError:
    return RouteError(
        f"the traverses {', '.join(traverse.name for traverse in route.traverses)} {route.why_not_aligned}, so there "
        "is no place to show in several conditions; choose others"
    )


def _match(pair: Pair, result: Retrieval, query: int, proposed: int) -> Match:
    true = np.flatnonzero(result.truth[query])
    nearest = int(true[len(true) // 2]) if len(true) else None
    return Match(
        query=decode_image(pair.query.paths[query], _PICTURE),
        proposed=decode_image(pair.database.paths[proposed], _PICTURE),
        true=None if nearest is None else decode_image(pair.database.paths[nearest], _PICTURE),
        score=float(result.similarity[query, proposed]),
        right=bool(result.truth[query, proposed]),
        query_name=f"{pair.query.name}/{pair.query.stems[query]}",
        proposed_name=f"{pair.database.name}/{pair.database.stems[proposed]}",
        true_name="" if nearest is None else f"{pair.database.name}/{pair.database.stems[nearest]}",
    )


def _frames(model: ConditionVAE, route: Route, positions: list[int]) -> NDArray[np.uint8]:
    """Traverses × positions × H×W×C, as the model sees them."""
    config = model.config
    spec = ImageSpec((config.height, config.width), grey=config.channels == 1)
    return np.stack([np.stack(list(decode_images(t.take(positions).paths, spec))) for t in route.traverses])


def _decode(model: ConditionVAE, z_p: NDArray[np.float32], z_c: NDArray[np.float32]) -> NDArray[np.uint8]:
    device = model.log_sigma.device
    with torch.inference_mode():
        z = model.split.join(torch.from_numpy(np.array(z_p)), torch.from_numpy(np.array(z_c)))
        return to_pixels(model.decoder(z.to(device)))
