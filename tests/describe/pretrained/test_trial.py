"""The first look at a foreign network, where it fails."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.describe.pretrained.trial import measured_dimension
from everplace.errors import ConfigError, MethodError
from everplace.images.decoding import ImageSpec


class Failing(Describer):
    """Raises an error."""

    method = "failing"
    image = ImageSpec((6, 10))

    def __init__(self, error: Exception) -> None:
        self.error = error

    def settings(self) -> Settings:
        return {}

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        raise self.error


@pytest.mark.parametrize(
    ("error", "reason"), [(ValueError("bad shape\nat line 3"), "bad shape"), (AssertionError(), "AssertionError")]
)
def test_a_network_that_fails_is_named_with_the_first_line_of_its_reason(error: Exception, reason: str) -> None:
    with pytest.raises(MethodError) as caught:
        measured_dimension(Failing(error), "the net", "try another size")
    assert str(caught.value) == f"the net fails on an image of 6×10: {reason}; try another size"


@pytest.mark.parametrize("kind", [MemoryError, type("OutOfMemoryError", (RuntimeError,), {}), ConfigError])
def test_what_is_no_fault_of_the_network_stays_as_it_is(kind: type[Exception]) -> None:
    with pytest.raises(kind, match="own words"):
        measured_dimension(Failing(kind("own words")), "the net", "try another size")
