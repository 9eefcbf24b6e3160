"""A service that the tests of the room share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.serve.running_service import RunningService, running


@pytest.fixture(scope="session")
def service(unchanged_three_map: Path) -> Iterator[RunningService]:
    """Of the road's map of three drives; nobody changes the map."""
    with running(unchanged_three_map) as served:
        yield served


@pytest.fixture(scope="session")
def winter(unchanged_rendered_route: Path) -> list[Path]:
    """Images of the winter drive, in order."""
    return sorted((unchanged_rendered_route / "winter").glob("*.png"))
