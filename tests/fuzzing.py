"""Tests that feed a parser whatever comes: few examples each day, `EVERPLACE_FUZZ=10000 pytest -m fuzz` for more."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

__all__ = ["DAMAGE", "Damage", "fuzzed"]

_Test = TypeVar("_Test", bound=Callable[..., Any])


def fuzzed(examples: int) -> Callable[[_Test], _Test]:
    """Marks a property of a parser as `fuzz`.

    Args:
        examples: How many it tries, unless $EVERPLACE_FUZZ says another number.
    """
    chosen = int(os.environ.get("EVERPLACE_FUZZ") or examples)
    bounds = settings(
        max_examples=chosen,
        deadline=None,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
    )

    def mark(test: _Test) -> _Test:
        marked: _Test = pytest.mark.fuzz(bounds(test))
        return marked

    return mark


class Damage(NamedTuple):
    """What happens to a file.

    Attributes:
        changes: Places, as shares of its length, and the bytes that are written there.
        end: Twice the share of it that is left; from 0.5 on all.
    """

    changes: list[tuple[float, bytes]]
    end: float

    def of(self, whole: bytes) -> bytes:
        """Returns the damaged file."""
        data = bytearray(whole)
        for place, value in self.changes:
            start = int(place * len(data))
            data[start : start + len(value)] = value
        return bytes(data[: int(len(data) * min(1.0, 2 * self.end))])


DAMAGE = st.builds(
    Damage, st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=1, max_size=8)), max_size=4), st.floats(0, 1)
)
"""Any damage."""
