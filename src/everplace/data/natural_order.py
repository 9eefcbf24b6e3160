"""The order of stems: digit runs count as numbers, so `9 < 10`."""

from __future__ import annotations

import re
from collections.abc import Iterable

__all__ = ["natural_key", "natural_sorted"]

_DIGITS = re.compile(r"([0-9]+)")
_ZEROS = re.compile("0+")
_ONE_DIGIT = str.maketrans("123456789", "0" * 9)


def natural_key(stem: str) -> tuple[tuple[str | int, ...], str]:
    """Returns a key that sorts stems naturally and totally.

    Args:
        stem: A file name without its ending.

    Returns:
        The stem cut into text and numbers, then the stem itself, so that `01` and `1`, which are equal as
        numbers, still have one order everywhere (`01` first).
    """
    parts = _DIGITS.split(stem)
    return tuple(int(part) if odd % 2 else part for odd, part in enumerate(parts)), stem


def natural_sorted(stems: Iterable[str]) -> list[str]:
    """Returns the stems sorted by `natural_key`; in a fraction of the time where all are built alike."""
    ordered = sorted(stems)
    shapes = {stem.translate(_ONE_DIGIT) for stem in ordered}
    if len(shapes) <= 1:
        return ordered
    structures = {_ZEROS.sub("0", shape) for shape in shapes}
    prefix, _, suffix = min(structures).partition("0")
    if len(structures) == 1 and "0" not in suffix:
        # One number in the same surroundings. Sorting is stable, so equal numbers stay in the order of the
        # text.
        start, end = len(prefix), -len(suffix) or None
        ordered.sort(key=lambda stem: int(stem[start:end]))
    else:
        ordered.sort(key=natural_key)
    return ordered
