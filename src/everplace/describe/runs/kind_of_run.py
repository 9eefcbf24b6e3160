"""What kind of model a run directory holds, told without importing torch."""

from __future__ import annotations

import json
from pathlib import Path

__all__ = ["kind_of_run"]


def kind_of_run(run: Path) -> str:
    """The kind of model that a run directory holds; empty if it does not say, which opening it explains."""
    try:
        return str(json.loads((run / "checkpoint.json").read_text("utf-8"))["model"]["kind"])
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return ""
