"""Opens a method by what a user writes: a run directory, a name, or a name with an argument after a colon."""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from everplace.describe import methods, runs
from everplace.describe.describer import Describer
from everplace.errors import MethodError
from everplace.files import readable
from everplace.progress import Progress, quiet

if TYPE_CHECKING:
    import torch

__all__ = ["kind_of_run", "load", "method_names", "open_describer"]


def method_names() -> list[str]:
    """Returns the names of all methods that can be opened by name, sorted."""
    return _modules(methods)


def open_describer(method: str | os.PathLike[str], *, progress: Progress = quiet) -> Describer:
    """Opens a method for describing images.

    Args:
        method: A run directory (it holds config.toml), "name", or "name:argument"; what the argument means
            is the method's affair. Names joined with a plus are methods side by side.
        progress: Told of what has to be downloaded first, such as published weights.

    Raises:
        MethodError: There is no such method, or it cannot run here.
        CheckpointError: The run directory is damaged.
    """
    method = os.fspath(method)
    # os.path answers False where pathlib raises: a name too long for a path, or with NUL.
    if method and os.path.isfile(os.path.join(method, "config.toml")):  # noqa: PTH113, PTH118
        kind = kind_of_run(Path(method))
        return _open(runs, kind if kind in _modules(runs) else "trained", method, progress)
    parts = method.split("+")
    if len(parts) > 1 and all(part.partition(":")[0] in method_names() for part in parts):
        from everplace.describe.joined import JoinedDescriber

        return JoinedDescriber([open_describer(part, progress=progress) for part in parts])
    name, _, argument = method.partition(":")
    if name in method_names():
        return _open(methods, name, argument, progress)
    choice = f"choose one of {', '.join(method_names())}, or a run directory made by `everplace train`"
    if os.path.isdir(method):  # noqa: PTH112
        raise MethodError(f"{readable(method)} is no run directory, it holds no config.toml; {choice}")
    raise MethodError(f"there is no method or run directory {readable(method)!r}; {choice}")


def load(
    method: str | os.PathLike[str], *, device: str | torch.device | None = None, progress: Progress = quiet
) -> Describer:
    """Opens a method for describing images.

    Args:
        method: As `open_describer` takes it: a run directory, "hog", "hub:...", ...
        device: Where a network is applied, such as "cpu" or "cuda:1"; None: a GPU, where there is one. Methods that
            are no torch networks ignore it.
        progress: Told of what has to be downloaded first.

    Raises:
        MethodError: There is no such method or device, or the method cannot run here.
        CheckpointError: The run directory is damaged.
    """
    if device is None:
        return open_describer(method, progress=progress)
    from everplace.model.inference import on_device

    with on_device(device):
        return open_describer(method, progress=progress)


def kind_of_run(run: Path) -> str:
    """The kind of model that a run directory holds, without importing torch.

    Empty if it does not say, which opening it explains.
    """
    try:
        return str(json.loads((run / "checkpoint.json").read_text("utf-8"))["model"]["kind"])
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return ""


def _modules(room: ModuleType) -> list[str]:
    return sorted(one.name for one in pkgutil.iter_modules(room.__path__) if not one.name.startswith("_"))


def _open(room: ModuleType, name: str, argument: str, progress: Progress) -> Describer:
    module = importlib.import_module(f"{room.__name__}.{name}")
    if hasattr(module, "prepare"):  # opening by itself downloads nothing
        module.prepare(argument, progress)
    describer: Describer = module.open_method(argument)
    return describer
