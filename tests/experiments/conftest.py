"""A comparison that several tests read, or copy to go on with it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.experiments.comparing import OPTIONS, compare


@pytest.fixture(scope="session")
def finished(unchanged_tiny_route: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny route in `tiny` and its finished comparison, made with `OPTIONS`, in `c`; not to be written to."""
    base = tmp_path_factory.mktemp("finished")
    shutil.copytree(unchanged_tiny_route, base / "tiny")
    compare(base / "tiny", base / "c", *OPTIONS)
    return base


@pytest.fixture
def finished_copy(finished: Path, tmp_path: Path) -> Path:
    """The same for a test that writes."""
    return Path(shutil.copytree(finished, tmp_path / "copy"))
