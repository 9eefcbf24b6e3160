"""Opens a method by what a user writes: a run directory, a name, or a name with an argument after a colon."""

from __future__ import annotations

import importlib
import os
import pkgutil
from pathlib import Path

from everplace.describe import methods, runs
from everplace.describe.describer import Describer
from everplace.describe.runs.kind_of_run import kind_of_run
from everplace.errors import MethodError
from everplace.files import readable
from everplace.progress import Progress, quiet

__all__ = ["method_names", "open_describer"]

_RUN_METHODS = {"vae": "vae", "c-vae": "vae", "cp-vae": "vae", "cae": "cae", "fabmap": "fabmap"}
"""Which module opens the run of a kind of model; it has no name of its own, since a model is given by its directory."""


def method_names() -> list[str]:
    """Returns the names of all methods that can be opened by name, sorted."""
    found = (module.name for module in pkgutil.iter_modules(methods.__path__))
    return sorted(name for name in found if not name.startswith("_"))


def open_describer(method: str, *, progress: Progress = quiet) -> Describer:
    """Opens a method for describing images.

    Args:
        method: A run directory (it holds config.toml), "name", or "name:argument"; what the argument means
            is the method's affair.
        progress: Told of what has to be downloaded first, such as published weights.

    Raises:
        MethodError: There is no such method, or it cannot run here.
        CheckpointError: The run directory is damaged.
    """
    # os.path answers False where pathlib raises: a name too long for a path, or with NUL.
    if method and os.path.isfile(os.path.join(method, "config.toml")):  # noqa: PTH113, PTH118
        return _open(runs.__name__, _RUN_METHODS.get(kind_of_run(Path(method)), "vae"), method, progress)
    name, _, argument = method.partition(":")
    if name in method_names():
        return _open(methods.__name__, name, argument, progress)
    choice = f"choose one of {', '.join(method_names())}, or a run directory made by `everplace train`"
    if os.path.isdir(method):  # noqa: PTH112
        raise MethodError(f"{readable(method)} is no run directory, it holds no config.toml; {choice}")
    raise MethodError(f"there is no method or run directory {readable(method)!r}; {choice}")


def _open(room: str, name: str, argument: str, progress: Progress) -> Describer:
    module = importlib.import_module(f"{room}.{name}")
    if hasattr(module, "prepare"):  # opening by itself downloads nothing
        module.prepare(argument, progress)
    describer: Describer = module.open_method(argument)
    return describer
