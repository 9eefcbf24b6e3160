"""What each method is, needs and gives, as its own module says it in `NOTES`; no method is imported for that.

`NOTES` holds a row for each way to write a method: the text, what it is, what it needs beyond an installation of
everplace, and how many numbers a descriptor has (None: the argument decides). It is written out, so that it can be
read from the source: most methods import torch.
"""

from __future__ import annotations

import ast
import importlib.util
import pkgutil
from importlib.abc import InspectLoader
from types import ModuleType
from typing import NamedTuple

from everplace.describe import methods, runs

__all__ = ["MethodNote", "method_notes"]


class MethodNote(NamedTuple):
    """One way to write a method.

    Attributes:
        method: What to write, such as "hog" or "vgg19:pool4".
        summary: What it is, in a line.
        needs: What it needs beyond everplace; empty: nothing.
        numbers: Numbers of a descriptor; None: they depend on the argument or on what was fitted.
    """

    method: str
    summary: str
    needs: str
    numbers: int | None


def method_notes() -> tuple[MethodNote, ...]:
    """Returns a note for each way to write a method; a module without `NOTES` is told by its docstring."""
    return tuple(note for room in (methods, runs) for note in _notes(room))


def _notes(room: ModuleType) -> list[MethodNote]:
    notes: list[MethodNote] = []
    for found in sorted(pkgutil.iter_modules(room.__path__), key=lambda one: one.name):
        if found.name.startswith("_"):
            continue
        name = f"{room.__name__}.{found.name}"
        spec = importlib.util.find_spec(name)
        assert spec is not None
        assert isinstance(spec.loader, InspectLoader)
        tree = ast.parse(spec.loader.get_source(name) or "")
        values = [
            node.value for node in tree.body if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "NOTES"
        ]
        if values:
            notes += [MethodNote(*row) for row in ast.literal_eval(values[0])]
        else:
            summary = (ast.get_docstring(tree) or "").partition("\n")[0].rstrip(".")
            notes.append(MethodNote(found.name, summary, "", None))
    return notes
