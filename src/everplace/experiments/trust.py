"""How far scores can be trusted: where their truth came from, and whether the method knew the places before."""

from __future__ import annotations

from functools import lru_cache

from everplace.describe.describer import Describer
from everplace.route.fingerprint import image_digests
from everplace.route.route import Route
from everplace.scoring.retrieval import MatchRule

__all__ = ["circular_sentence", "seen_places", "seen_sentence", "truth_source"]


def truth_source(route: Route, rule: MatchRule | None) -> str | None:
    """Where the knowledge of which frames show the same place comes from: a part of a sentence.

    Args:
        route: The tested route.
        rule: When a match is right, fully resolved; None where nobody knows, as the result then is.
    """
    if rule is None:
        return None
    own = route.truth_origin
    if rule.pairs is not None:
        return own or f"the pairs of {rule.pairs}"
    if rule.radius is not None:
        return (own if route.radius is not None else None) or "the poses of the drives"
    return (own if route.matched_by_stem else None) or "equal names of frames"


def circular_sentence(label: str, describer: Describer, route: Route, rule: MatchRule | None) -> str:
    """Warns where the method that is tested made the truth it is tested by; empty where it did not.

    Args:
        label: What the method is called.
        describer: The method.
        route: The tested route.
        rule: When a match is right, fully resolved.
    """
    if rule is None or rule.tolerance is None or not route.aligned_by or not _akin(describer, route.aligned_by):
        return ""
    return (
        f"The drives were aligned by {route.aligned_by}, and {label} looks at images as that did: its scores say how "
        "well it agrees with the alignment, not how well it recognises. Test it by poses (`radius`) or by pairs set by "
        "hand."
    )


def _akin(describer: Describer, aligned_by: str) -> bool:
    """Whether two methods have a part of one kind: hog, hog16 and the recipe best all read oriented gradients."""
    reads_gradients = "oriented gradients" in str(describer.settings().get("remedies", ""))
    kinds = [_kinds(describer.method) | ({"hog"} if reads_gradients else set()), _kinds(aligned_by)]
    return not kinds[0].isdisjoint(kinds[1])


def _kinds(method: str) -> set[str]:
    """The methods that are joined in one, without the number of a variant; addresses (hub:, onnx:) are whole."""
    return {one if ":" in one else one.rstrip("0123456789") for one in method.removeprefix("adapted ").split("+")}


def seen_places(describer: Describer, route: Route) -> int:
    """How many of a route's places a method was trained on or chosen by: the scores are no test of these.

    Images tell them by their content, whatever they are called. A run that did not record it is judged by names.

    Raises:
        ImageError: An image cannot be read.
    """
    if not describer.seen_images:
        stems = {stem for traverse in route.traverses for stem in traverse.stems}
        return len(stems & describer.seen_stems)
    return len({stem for stem, digest in _images(route) if digest in describer.seen_images})


@lru_cache(maxsize=1)
def _images(route: Route) -> list[tuple[str, str]]:
    """The stem of every frame, with what tells its content; read once for all methods."""
    return [
        (stem, digest)
        for traverse in route.traverses
        for stem, digest in zip(traverse.stems, image_digests(traverse), strict=True)
    ]


def seen_sentence(label: str, describer: Describer, count: int) -> str:
    """Says that the scores of a method are no test of `count` places."""
    if describer.seen_images:
        return (
            f"{count} of the tested places were among those that {label} was trained on or chosen by, as the images "
            "tell: its scores say how well it remembers them, not how well it recognises."
        )
    return (
        f"{count} of the tested places carry the names of places that {label} was trained on or chosen by: if it is "
        "the same route, its scores say how well it remembers them, not how well it recognises."
    )
