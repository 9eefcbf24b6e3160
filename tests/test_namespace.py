"""The package's public names."""

from __future__ import annotations

import subprocess
import sys

import pytest

import everplace


def test_every_public_name_can_be_had() -> None:
    for name in everplace.__all__:
        assert getattr(everplace, name) is not None
    assert set(dir(everplace)) == set(everplace.__all__)


def test_the_lazy_names_are_the_public_names() -> None:
    assert sorted(everplace._HOME) == sorted(everplace.__all__)


@pytest.mark.slow
def test_public_names_stay_when_every_module_was_imported() -> None:
    code = """
import everplace, importlib, inspect, pkgutil
for module in pkgutil.walk_packages(everplace.__path__, "everplace."):
    importlib.import_module(module.name)
for name in everplace.__all__:
    assert not inspect.ismodule(getattr(everplace, name)), name
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
