"""Tests that feed a parser whatever comes: few examples each day, `EVERPLACE_FUZZ=10000 pytest -m fuzz` for more."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar

import pytest
from hypothesis import HealthCheck, settings

__all__ = ["fuzzed"]

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
