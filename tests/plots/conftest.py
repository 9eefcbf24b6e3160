from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray


@dataclass
class PlainCurve:
    """A precision-recall curve that comes from nowhere."""

    recall: NDArray[Any]
    precision: NDArray[Any]
    threshold: NDArray[Any]


class MakeCurve:
    def __call__(self, recall: Sequence[float], precision: Sequence[float]) -> PlainCurve:
        return PlainCurve(np.array(recall), np.array(precision), np.linspace(0.9, 0.1, len(recall)))


@pytest.fixture
def make_curve() -> MakeCurve:
    return MakeCurve()
