"""Pictures decoded from the place of one frame and the condition of another: Figures 6 to 9, and translation strips."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from everplace.audit.leakage import encode_frames
from everplace.describe.registry import kind_of_run
from everplace.errors import CheckpointError, RouteError
from everplace.files import readable
from everplace.images.decoding import ImageSpec, decode_images
from everplace.model.checkpoint import Checkpoint, load_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.inference import inference
from everplace.model.model_config import LABELLED_KINDS
from everplace.model.pixels import to_pixels
from everplace.plots.canvas import new_figure
from everplace.plots.image_grids import Translation, draw_constant_grid, draw_swap_grid, draw_translations
from everplace.route.route import Route
from everplace.route.selection import spread
from everplace.route.traverse import Traverse

__all__ = ["constant_figure", "decode_latents", "load_divided", "swap_figure", "translation_figure"]

_TITLED = 5.6
"""Inches that a title with the name of a run needs."""

_AVERAGED = 256
"""Frames that a mean z_c is taken over: more move it by less than anybody can see."""


def load_divided(run: str) -> Checkpoint:
    """Reads the model of a run directory whose latent has a z_p and a z_c.

    Raises:
        CheckpointError: There is no usable checkpoint, or its model has one undivided latent, or none at all.
    """
    kind = kind_of_run(Path(run))
    if kind and kind not in LABELLED_KINDS:
        raise CheckpointError(
            f"{readable(run)} is a run of {kind}, which has no z_p and z_c to put together anew; "
            "give the run of a c-vae or a cp-vae"
        )
    return load_checkpoint(run)


def swap_figure(model: ConditionVAE, route: Route, place: int | None = None, *, label: str) -> Figure:
    """Figures 6 and 7: {z_p of frame a, z_c of frame b}, for one place seen in all conditions.

    Args:
        model: A trained C-VAE or CP-VAE.
        route: Aligned traverses.
        place: Position of the place; the middle one by default.
        label: The model's name, written before the title.

    Raises:
        RouteError: The traverses share no place, or there is no such place.
        ImageError: A frame cannot be decoded.
    """
    places = _places(route)
    position = places // 2 if place is None else place
    if not 0 <= position < places:
        raise RouteError(
            f"there is no place {position}, the traverses share {places}; choose one from 0 to {places - 1}"
        )
    frames = _frames(model, route, [position])[:, 0]
    latents = encode_frames(model, frames)
    rows = [
        list(decode_latents(model, np.broadcast_to(z_p, (len(frames), len(z_p))), latents.z_c)) for z_p in latents.z_p
    ]
    labels = [traverse.name for traverse in route.traverses]
    figure = new_figure(max(_TITLED, 1.6 + 1.5 * len(labels)))
    draw_swap_grid(
        figure, rows, list(frames), list(frames), place_labels=labels, condition_labels=labels,
        title=f"{label}: place {route.traverses[0].stems[position]} with z_p and z_c swapped",
    )  # fmt: skip
    return figure


def constant_figure(model: ConditionVAE, route: Route, *, count: int = 4, label: str) -> Figure:
    """Figures 8 and 9: condition-invariant images, {z_p of each frame, one constant z_c}.

    The constant is the mean z_c of the first traverse's frames.

    Args:
        model: A trained C-VAE or CP-VAE.
        route: Aligned traverses.
        count: Places to show.
        label: The model's name, written before the title.

    Raises:
        RouteError: The traverses share no place.
        ImageError: A frame cannot be decoded.
    """
    positions = spread(_places(route), count)
    frames = _frames(model, route, positions)
    flat = np.concatenate(list(frames))
    latents = encode_frames(model, flat)
    constant = _mean_z_c(model, route.traverses[:1])
    decoded = decode_latents(model, latents.z_p, np.broadcast_to(constant, (len(flat), len(constant))))
    labels = [f"{traverse.name} {traverse.stems[p]}" for traverse in route.traverses for p in positions]
    figure = new_figure(10)
    draw_constant_grid(
        figure, list(flat), list(decoded), labels=labels, columns=len(positions),
        title=f"{label}: z_p of each, mean z_c of {route.traverses[0].name}",
    )  # fmt: skip
    return figure


def translation_figure(
    model: ConditionVAE, route: Route, *, count: int = 3, source: str | None = None, label: str
) -> Figure:
    """One frame in every condition, {z_p of the frame, mean z_c of the condition}, above the true frames of these.

    Args:
        model: A trained C-VAE or CP-VAE.
        route: Aligned traverses. The frames of a condition with several traverses are those of the first, or of the
            source; its mean z_c is that of all of them.
        count: Places to show.
        source: Traverse, or condition with one traverse, whose frames are translated; the first traverse by default.
        label: The model's name, written before the title.

    Raises:
        RouteError: The traverses share no place, or there is no such traverse.
        ImageError: A frame cannot be decoded.
    """
    shown = route.traverses[0] if source is None else route[source]
    positions = spread(_places(route), count)
    conditions = route.conditions
    first = {traverse.condition: traverse for traverse in reversed(route.traverses)} | {shown.condition: shown}
    true = np.stack([_decoded(model, first[condition], positions) for condition in conditions])
    frames = true[conditions.index(shown.condition)]
    z_p = encode_frames(model, frames).z_p
    means = {
        condition: _mean_z_c(model, tuple(one for one in route.traverses if one.condition == condition))
        for condition in conditions
    }
    drawn = [decode_latents(model, z_p, np.broadcast_to(mean, (len(z_p), len(mean)))) for mean in means.values()]
    translations = [
        Translation(frames[place], [images[place] for images in drawn], list(true[:, place]), f"{shown.name} {stem}")
        for place, stem in enumerate(shown.take(positions).stems)
    ]
    figure = new_figure(2.4 + 1.5 * len(conditions))
    draw_translations(
        figure, translations, conditions=conditions,
        title=f"{label}: {shown.name} translated: z_p, mean z_c of each",
    )  # fmt: skip
    return figure


def _places(route: Route) -> int:
    """The number of places, once it is known that row i of every traverse is the same one."""
    first, *others = (traverse.stems for traverse in route.traverses)
    if not route.aligned or any(stems != first for stems in others):
        names = ", ".join(traverse.name for traverse in route.traverses)
        raise RouteError(
            f"the traverses {names} {route.why_not_aligned}, so there is no place to show in several conditions; "
            "choose others"
        )
    return len(first)


def _mean_z_c(model: ConditionVAE, traverses: tuple[Traverse, ...]) -> NDArray[np.float32]:
    """The mean z_c of traverses of one condition, over frames that are spread over each."""
    parts = [_decoded(model, one, spread(len(one), _AVERAGED // len(traverses) or 1)) for one in traverses]
    mean: NDArray[np.float32] = np.concatenate([encode_frames(model, part).z_c for part in parts]).mean(axis=0)
    return mean


def _frames(model: ConditionVAE, route: Route, positions: list[int]) -> NDArray[np.uint8]:
    """Traverses × positions × H×W×C, as the model sees them."""
    return np.stack([_decoded(model, traverse, positions) for traverse in route.traverses])


def _decoded(model: ConditionVAE, traverse: Traverse, positions: list[int]) -> NDArray[np.uint8]:
    """Positions × H×W×C, as the model sees them."""
    config = model.config
    spec = ImageSpec((config.height, config.width), grey=config.channels == 1)
    return np.stack(list(decode_images(traverse.take(positions).paths, spec)))


def decode_latents(model: ConditionVAE, z_p: NDArray[np.float32], z_c: NDArray[np.float32]) -> NDArray[np.uint8]:
    """N×H×W×C: the images that a model decodes from z_p and z_c, a row of each an image."""
    device = model.log_sigma.device
    with inference():
        z = model.split.join(torch.from_numpy(np.array(z_p)), torch.from_numpy(np.array(z_c)))
        return to_pixels(model.decoder(z.to(device)))
