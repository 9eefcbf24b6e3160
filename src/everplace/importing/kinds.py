"""The kinds of sources that can be imported, and their options: a kind is a module of `data/sources`."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import pkgutil
import re
import types
from collections.abc import Mapping
from typing import Any, Union, cast, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticUndefined

from everplace.errors import ConfigError
from everplace.files import readable
from everplace.importing import sources
from everplace.importing.foreign_route import Source

__all__ = ["missing_extras", "open_kind", "option_help", "read_options", "source_kinds"]

_LISTS = (list, set, frozenset)
_ATTRIBUTE = re.compile(r" {8}(\w+): (.*)")


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


def option_help(options: type[BaseModel]) -> dict[str, str]:
    """Returns what the docstring of an options class says about each option, with its default."""
    described: dict[str, str] = {}
    for base in reversed(options.__mro__):  # a class may inherit options that its own docstring does not repeat
        name = ""
        for line in inspect.cleandoc(base.__dict__.get("__doc__") or "").splitlines():
            match = _ATTRIBUTE.fullmatch("    " + line)
            if match is not None:
                name = match[1]
                described[name] = match[2].strip()
            elif name and line.strip():
                described[name] += " " + line.strip()
    return {
        option: " ".join(filter(None, (described.get(option, ""), _default(field.default))))
        for option, field in options.model_fields.items()
    }


def read_options(kind: str, options: type[BaseModel], given: Mapping[str, str]) -> BaseModel:
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
        problem = error.errors(include_url=False)[0]
        what = problem["msg"].removeprefix("Value error, ")
        name = str(problem["loc"][0]) if problem["loc"] else ""
        if name in given:
            raise ConfigError(f"--set {name}={readable(given[name])} cannot be: {what}") from error
        raise ConfigError(f"options of the kind {kind!r}: {f'{name}: ' if name else ''}{what}") from error


def _is_list(annotation: Any) -> bool:
    """Says whether a type is a list of any length, maybe among alternatives."""
    origin = get_origin(annotation) or annotation
    if origin in (Union, types.UnionType):
        return any(_is_list(part) for part in get_args(annotation))
    return origin in _LISTS or (origin is tuple and get_args(annotation)[1:] == (...,))


def _default(value: object) -> str:
    """Shows a default that says something."""
    if isinstance(value, list | tuple | set | frozenset):
        value = ",".join(map(str, value))
    return "" if value in (None, "", PydanticUndefined) else f"[{value}]"
