"""The order of stems: digit runs count as numbers, so `9 < 10`, and a stem that is a decimal number is one."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from decimal import Decimal
from operator import methodcaller

__all__ = ["natural_key", "natural_sorted"]

_DIGITS = re.compile(r"([0-9]+)")
# Seconds, as cameras and TUM's tools name files; trailing zeros get lost on the way.
_DECIMAL = re.compile(r"([0-9]+)\.([0-9]+)")
_LAST_TEXT = re.compile(r"[^0-9]*\Z")
_ONE_DIGIT = str.maketrans("123456789", "0" * 9)


def natural_key(stem: str) -> tuple[tuple[str | int | Decimal, ...], str]:
    """Returns a key that sorts stems naturally and totally.

    Args:
        stem: A file name without its ending.

    Returns:
        The stem cut into text and numbers, then the stem itself, so that `01` and `1`, which are equal as
        numbers, still have one order everywhere (`01` first). Of a stem that is wholly a decimal number the digits
        behind the point count as its fraction: `7.125 < 7.25 < 7.5`.
    """
    decimal = _DECIMAL.fullmatch(stem)
    if decimal is not None:
        return ("", int(decimal[1]), ".", Decimal(f"0.{decimal[2]}"), ""), stem
    parts = _DIGITS.split(stem)
    return tuple(int(part) if odd % 2 else part for odd, part in enumerate(parts)), stem


def natural_sorted(stems: Iterable[str]) -> list[str]:
    """Returns the stems sorted by `natural_key`; in a fraction of the time where all are built alike."""
    ordered = sorted(stems)
    if _sort_by_one_number(ordered):
        return ordered
    # Where all numbers have the same length everywhere, the order of the text is the natural one.
    if len({stem.translate(_ONE_DIGIT) for stem in ordered}) > 1:
        ordered.sort(key=natural_key)
    return ordered


def _sort_by_one_number(ordered: list[str]) -> bool:
    """Sorts stems, which are in the order of their text, by the only number in which they differ.

    Returns:
        Whether they are `<the same><number><the same, no digit>`; otherwise they are left as they are.
    """
    if not ordered:
        return True
    # What the first and the last in the order of the text begin with, all begin with.
    prefix = os.path.commonprefix([ordered[0], ordered[-1]]).rstrip("0123456789")  # noqa: RUF071 - no paths
    suffix = _LAST_TEXT.findall(ordered[0])[0]
    start, end = len(prefix), -len(suffix) or None
    numbers = [stem[start:end] for stem in ordered]
    digits = "".join(numbers)
    if not (all(numbers) and digits.isascii() and digits.isdecimal()):
        return False
    if not all(map(methodcaller("endswith", suffix), ordered)):
        return False
    # Of decimal numbers that differ only behind the point, the order of the text is that of the numbers.
    if len(set(map(len, ordered))) == 1 or _DECIMAL.fullmatch(ordered[0]):
        return True
    # What begins with a zero comes first in the order of the text.
    if not numbers[1].startswith("0") and (numbers[0] == "0" or not numbers[0].startswith("0")):
        ordered.sort(key=len)
    else:
        ordered.sort(key=lambda stem: int(stem[start:end]))
    return True
