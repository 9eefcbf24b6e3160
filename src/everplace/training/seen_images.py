"""Which images a run has seen, told by their content, so that a later test on them is noticed under any name."""

from __future__ import annotations

import contextlib
from collections.abc import Collection

from everplace.errors import ImageError
from everplace.progress import Progress, quiet
from everplace.route.fingerprint import image_digests
from everplace.route.route import Route
from everplace.route.traverse import Traverse

__all__ = ["seen_images"]


def seen_images(route: Route, chosen: Route, stems: Collection[str], progress: Progress = quiet) -> list[str]:
    """Tells the images of the places that a run is trained on or chosen by.

    A place is seen in all conditions, also in those that the run is not trained on: their frames are listed too.

    Args:
        route: The whole route.
        chosen: The traverses that the run is trained on.
        stems: Of the places.
        progress: Told of the files read.

    Returns:
        What `image_digests` says of each image, each once, sorted.

    Raises:
        ImageError: An image of a chosen traverse cannot be read.
    """
    named = set(stems)
    trained = {traverse.name for traverse in chosen.traverses}
    seen: set[str] = set()
    for traverse in route.traverses:
        part = traverse.take([index for index, stem in enumerate(traverse.stems) if stem in named])
        if traverse.name in trained:
            seen.update(image_digests(part, progress))
        elif route.stems_are_places:
            seen.update(_readable(part, progress))
    return sorted(seen)


def _readable(traverse: Traverse, progress: Progress) -> list[str]:
    """The digests of a traverse that is not trained on; nothing where it cannot be read, nor then be tested."""
    with contextlib.suppress(ImageError):
        return image_digests(traverse, progress)
    return []
