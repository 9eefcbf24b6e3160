"""The tree of errors, as its module draws it."""

from __future__ import annotations

import re

from everplace import errors


def test_the_drawn_tree_is_the_tree() -> None:
    assert errors.__doc__ is not None
    drawn: list[tuple[int, str]] = []
    parents: dict[str, str] = {}
    for line in errors.__doc__.splitlines():
        if found := re.match(r"    ([ │├└─]*)(\w+Error)\b", line):
            depth, name = len(found[1]), found[2]
            parents[name] = next((above for at, above in reversed(drawn) if at < depth), "Exception")
            drawn.append((depth, name))
    assert parents == {name: getattr(errors, name).__bases__[0].__name__ for name in errors.__all__}
