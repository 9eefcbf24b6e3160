"""`everplace methods`: what describes images."""

from __future__ import annotations

from everplace.cli.options import Json
from everplace.cli.output import show_result

__all__ = ["methods"]


def methods(as_json: Json = False) -> None:
    """List the methods that describe images: what each is, needs and gives.

    Each can be written wherever a command takes METHOD. A run directory that was trained is a method too.

    Example: everplace methods
    """
    from everplace.describe.method_notes import method_notes

    notes = method_notes()
    if as_json:
        show_result({"methods": [note._asdict() for note in notes]}, as_json)
        return
    for note in notes:
        gives = "" if note.numbers is None else f" ({note.numbers:,} numbers)"
        print(f"{note.method}: {note.summary}{gives}")
        if note.needs:
            print(f"    needs {note.needs}")
