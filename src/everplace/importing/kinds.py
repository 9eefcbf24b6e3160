"""The kinds of sources that can be imported, and their options: a kind is a module of `importing/sources`."""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
import types
from collections.abc import Mapping
from typing import Any, TypeVar, Union, cast, get_args, get_origin

from pydantic import BaseModel, ValidationError

from everplace.errors import ConfigError
from everplace.files import readable
from everplace.importing import sources
from everplace.importing.foreign_route import Source
from everplace.settings import first_problem

__all__ = ["missing_extras", "open_kind", "read_options", "source_kinds"]

_Options = TypeVar("_Options", bound=BaseModel)
_LISTS = (list, set, frozenset)


def source_kinds() -> dict[str, Source]:
    """Returns the modules that read a kind of source, by name, sorted."""
    names = sorted(module.name for module in pkgutil.iter_modules(sources.__path__) if not module.name.startswith("_"))
    modules = {name: importlib.import_module(f"{sources.__name__}.{name}") for name in names}
    return {
        name: cast(Source, module)
        for name, module in modules.items()
        if all(hasattr(module, part) for part in ("SUMMARY", "Options", "read"))
    }


def open_kind(kind: str) -> Source:
    """Returns the module of this name.

    Raises:
        ConfigError: There is none.
    """
    known = source_kinds()
    if kind not in known:
        raise ConfigError(f"there is no kind of source {readable(kind)!r}; choose one of {', '.join(known)}")
    return known[kind]


def missing_extras(kind: Source) -> list[str]:
    """Returns the extras that the kind, or a part of it, needs and that are not installed, sorted.

    A module says so with `EXTRAS`: the extra by the package that it imports.
    """
    extras: Mapping[str, str] = getattr(kind, "EXTRAS", {})
    return sorted({extra for package, extra in extras.items() if importlib.util.find_spec(package) is None})


def read_options(kind: str, options: type[_Options], given: Mapping[str, str]) -> _Options:
    """Turns texts into a kind's options; a list's items are separated by commas.

    Raises:
        ConfigError: The kind has no option of a name, or a value cannot be; the message names it.
    """
    known = options.model_fields
    for name in given:
        if name not in known:
            offer = f"it knows {', '.join(known)}" if known else "it has none"
            raise ConfigError(f"the kind {kind!r} has no option {readable(name)!r}; {offer}")
    values: dict[str, Any] = {
        name: [part.strip() for part in text.split(",") if part.strip()] if _is_list(known[name].annotation) else text
        for name, text in given.items()
    }
    try:
        return options.model_validate(values)
    except ValidationError as error:
        problem = first_problem(error, options)
        name = problem.setting.partition(".")[0]  # an item of a list is told by the list
        if name in given:
            raise ConfigError(f"`{name}`={readable(given[name])} cannot be: {problem.reason}") from error
        raise ConfigError(f"options of the kind {kind!r}: {problem.reason}") from error


def _is_list(annotation: Any) -> bool:
    """Says whether a type is a list of any length, maybe among alternatives."""
    origin = get_origin(annotation) or annotation
    if origin in (Union, types.UnionType):
        return any(_is_list(part) for part in get_args(annotation))
    return origin in _LISTS or (origin is tuple and get_args(annotation)[1:] == (...,))
