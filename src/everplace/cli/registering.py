"""How a function becomes a command."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import typer

__all__ = ["register"]


def register(app: typer.Typer, command: Callable[..., Any], name: str = "") -> None:
    """Adds a command; the list of commands says the first line of its help whole, which is cut otherwise."""
    summary = (inspect.getdoc(command) or "").partition("\n")[0]
    app.command(name or command.__name__, short_help=summary)(command)
