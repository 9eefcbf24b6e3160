"""Small data sets that tests write, and what a source or a whole import makes of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from PIL import Image

from everplace.importing.foreign_route import ForeignFrame, ForeignRoute
from everplace.importing.import_route import import_route
from everplace.route.route import Route, open_route
from everplace.route.truth import TruthPair


class DataSet:
    """A directory to write a data set into, and to read it as the import does.

    Attributes:
        root: The directory.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        root.mkdir()

    def images(self, folder: str, names: Iterable[str]) -> list[bytes]:
        """Writes a picture of its own for each name; returns the files' bytes."""
        written = []
        for index, name in enumerate(names):
            path = self.root / folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            coarse = np.random.default_rng([index, *folder.encode()]).integers(0, 256, (4, 8, 3), dtype=np.uint8)
            Image.fromarray(np.kron(coarse, np.ones((8, 8, 1), dtype=np.uint8))).save(path)
            written.append(path.read_bytes())
        return written

    def text(self, name: str, lines: Sequence[str]) -> Path:
        """Writes a text file."""
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        return path

    def read(self, kind: ModuleType, where: str = ".", **options: Any) -> ForeignRoute:
        """Opens the data set, or a directory in it."""
        route: ForeignRoute = kind.read(self.root / where, kind.Options(**options))
        return route

    def frames(self, kind: ModuleType, where: str = ".", **options: Any) -> dict[str, list[ForeignFrame]]:
        """Reads all frames, by traverse."""
        return {one.name: list(one.frames) for one in self.read(kind, where, **options).traverses}

    def pairs(self, kind: ModuleType, **options: Any) -> list[TruthPair]:
        """Reads the truth."""
        return list(self.read(kind, **options).truth or ())

    def imported(self, kind: str, **options: str) -> Route:
        """Imports the data set into a route beside it."""
        out = self.root.parent / f"route-{kind}"
        import_route(kind, self.root, out, options)
        return open_route(out)


@pytest.fixture
def data_set(tmp_path: Path) -> DataSet:
    return DataSet(tmp_path / "set")
