"""The package's public names."""

from __future__ import annotations

import everplace


def test_every_public_name_can_be_had() -> None:
    for name in everplace.__all__:
        assert getattr(everplace, name) is not None
    assert set(dir(everplace)) == set(everplace.__all__)


def test_the_lazy_names_are_the_public_names() -> None:
    assert sorted(everplace._HOME) == sorted(everplace.__all__)
