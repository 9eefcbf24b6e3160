"""The rooms of the package: a name of a module stands for one thing."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import everplace

PACKAGE = Path(everplace.__file__).parent


def test_no_two_modules_share_a_name() -> None:
    homes: dict[str, list[str]] = defaultdict(list)
    for module in PACKAGE.rglob("*.py"):
        room = module.parent.relative_to(PACKAGE)
        if module.name != "__init__.py" and room.parts[:1] != ("cli",):  # a command's module is named by the command
            homes[module.stem].append(str(room))
    assert len(homes) > 100
    assert {name: rooms for name, rooms in homes.items() if len(rooms) > 1} == {}
