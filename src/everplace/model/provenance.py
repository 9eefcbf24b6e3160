"""`about`: what the files of a trained model say of its making.

A mapping that JSON can hold: recipe, remedies, seed, epoch and the like as plain values, the stems of the frames, and
what tells their images by content.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["HELD_OUT_STEMS", "SEEN_IMAGES", "TRAINED_STEMS", "images_seen", "plain_values", "stems_seen"]

TRAINED_STEMS, HELD_OUT_STEMS = "trained_stems", "held_out_stems"
"""Where the stems of the frames in the gradient are listed, and of those that chose the epoch."""

SEEN_IMAGES = "seen_images"
"""Where the images of the places that were trained on, or that chose the epoch, are listed by their content, as
`everplace.route.fingerprint.image_digests` tells it."""


def plain_values(about: Mapping[str, Any]) -> dict[str, str | int | float | bool]:
    """What is said in one value each: how the model was trained and chosen."""
    return {key: value for key, value in about.items() if isinstance(value, str | int | float | bool)}


def stems_seen(about: Mapping[str, Any]) -> frozenset[str]:
    """The stems that were trained on, or that chose the epoch; empty where that was not recorded."""
    lists = [about.get(key) for key in (TRAINED_STEMS, HELD_OUT_STEMS)]
    return frozenset(stem for some in lists if isinstance(some, list | tuple) for stem in some if isinstance(stem, str))


def images_seen(about: Mapping[str, Any]) -> frozenset[str]:
    """The images that were trained on, or that chose the epoch; empty where that was not recorded."""
    listed = about.get(SEEN_IMAGES)
    return frozenset(one for one in listed if isinstance(one, str)) if isinstance(listed, list | tuple) else frozenset()
