"""Numbers in stems, and which of them are left out."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

__all__ = ["Gap", "find_gaps"]

_LAST_NUMBER = re.compile(r"(.*?)([0-9]{1,18})([^0-9]*)", re.DOTALL)


class Gap(NamedTuple):
    """Numbers that are left out between two frames.

    Attributes:
        after: The stem before the gap.
        before: The stem behind it.
        missing: How many frames would fit between them at the usual step.
    """

    after: str
    before: str
    missing: int


def find_gaps(stems: Sequence[str]) -> tuple[Gap, ...] | None:
    """Finds where numbers are left out.

    What counts is the last number in each stem, and the step by which it usually grows (by 10 where every tenth frame
    was kept).

    Args:
        stems: In natural order.

    Returns:
        The gaps in order; None where the stems are not numbered: they differ in more than a number, or no step is
        taken more than half of the time (as with time stamps).
    """
    numbers: list[int] = []
    around: tuple[str, str] | None = None
    for stem in stems:
        match = _LAST_NUMBER.fullmatch(stem)
        if match is None or around not in (None, (match[1], match[3])):
            return None
        around = match[1], match[3]
        numbers.append(int(match[2]))
    steps = [second - first for first, second in itertools.pairwise(numbers)]
    if not steps:
        return ()
    usual, times = Counter(steps).most_common(1)[0]
    if usual < 1 or 2 * times <= len(steps):
        return None
    return tuple(
        Gap(stems[index], stems[index + 1], -(-step // usual) - 1) for index, step in enumerate(steps) if step > usual
    )
