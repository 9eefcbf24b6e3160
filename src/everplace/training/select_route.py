"""What of a route a method is fitted on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from everplace.errors import RouteError
from everplace.files import readable
from everplace.progress import Progress, quiet
from everplace.route.route import Route
from everplace.route.selection import Selection, parse_frames, select

if TYPE_CHECKING:
    from everplace.training.config import FitConfig

__all__ = ["require_places", "select_route"]


def select_route(route: Route, config: FitConfig, progress: Progress = quiet) -> Route:
    """The traverses and places that a configuration trains on.

    Raises:
        RouteError: CP-VAE was asked for and the traverses share no place, or nothing is left.
    """
    chosen = route.choose(config.conditions) if config.conditions else route
    require_places(chosen, config.model)
    frames = parse_frames(config.frames) if config.frames else None
    return select(chosen, Selection(frames, config.drop_dark, config.drop_stationary), progress)


def require_places(chosen: Route, model: str) -> None:
    """Makes sure that the traverses have places in common, if the model learns from these.

    Raises:
        RouteError: CP-VAE was asked for and the traverses share no place.
    """
    if model == "cp-vae" and not chosen.aligned:
        raise RouteError(
            f"the traverses {', '.join(readable(t.name) for t in chosen.traverses)} of {readable(chosen.root)} "
            f"{chosen.why_not_aligned}, and cp-vae learns from the same places in several conditions; give the frames "
            "of a place the same name in each traverse, or find them with `everplace data align`"
        )
