"""A version of a map as a row, and rows that are none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from everplace.errors import MapError
from everplace.mapping.map_state import FORMAT, MapState

STATE = MapState.new(3, {"method": "hog16", "drives": []}, {"weight": np.eye(3)[:, ::-1], "bias": np.arange(4.0)}, 5, 7)


def test_a_row_brings_the_state_back() -> None:
    again = MapState.from_row(STATE.to_row(), "map")
    assert again.document == {"method": "hog16", "drives": [], "format": FORMAT}
    for name in ("version", "created", "frames_version", "descriptors_version"):
        assert getattr(again, name) == getattr(STATE, name)
    assert again.arrays.keys() == {"weight", "bias"}
    for name, array in STATE.arrays.items():
        np.testing.assert_array_equal(again.arrays[name], array)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"document": '{"format": 2}'}, "has format 2, but this version of everplace reads format 1"),
        ({"document": "{}"}, "has format None"),
        ({"document": "{"}, "is damaged"),
        ({"document": "[]"}, "is damaged"),
        ({"arrays": b"no tensors"}, "is damaged"),
    ],
)
def test_a_row_of_another_kind_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(MapError, match=f"the map my-map {message}"):
        MapState.from_row({**STATE.to_row(), **change}, "my-map")
