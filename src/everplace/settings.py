"""Settings: models whose fields explain themselves, TOML files of them, and one sentence for what is wrong."""

from __future__ import annotations

import sys
import textwrap
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, get_args

import tomli_w
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import PydanticUndefined

from everplace.errors import ConfigError
from everplace.files import readable
from everplace.regular_files import read_regular

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = [
    "Problem",
    "Settings",
    "explained_toml",
    "explanations",
    "first_problem",
    "read_settings",
    "read_toml",
]

_Model = TypeVar("_Model", bound=BaseModel)


class Settings(BaseModel):
    """Base of what a user sets: an unknown name is refused, and the string under a field is its explanation."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Problem(NamedTuple):
    """What is wrong with one value.

    Attributes:
        setting: The setting's name, with the tables that it is in: `weights.place`; empty: the values as a whole.
        reason: What is wrong with it, in pydantic's words or those of a validator of ours.
        kind: What pydantic calls this sort of error, such as `missing` or `literal_error`.
        value: What was given.
        known: The names that may stand there, where `setting` is none of them; else None.
    """

    setting: str
    reason: str
    kind: str
    value: Any
    known: tuple[str, ...] | None


def first_problem(error: ValidationError, model: type[BaseModel]) -> Problem:
    """Returns the first thing that pydantic found wrong with the values for a model."""
    first = error.errors(include_url=False)[0]
    location, kind = first["loc"], first["type"]
    known = tuple(_model_at(model, location).model_fields) if kind == "extra_forbidden" else None
    reason = first["msg"].removeprefix("Value error, ")
    return Problem(".".join(map(str, location)), reason, kind, first["input"], known)


def explanations(model: type[BaseModel]) -> dict[str, str]:
    """Returns what the string under each field of a model says, on one line and with the field's default.

    The fields of a table follow it, under dotted names: `weights`, `weights.place`.
    """
    told: dict[str, str] = {}
    for name, field in model.model_fields.items():
        told[name] = " ".join([*(field.description or "").split(), *_default(field.default)])
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            told |= {f"{name}.{inner}": text for inner, text in explanations(field.annotation).items()}
    return told


def explained_toml(values: BaseModel, table: str = "") -> str:
    """Writes values as TOML, each below its explanation; a value that is not set is a comment."""
    lines = [f"[{table}]"] if table else []
    tables = {name: inner for name, inner in values if isinstance(inner, BaseModel)}
    # What is no table comes first: behind the head of a table all belongs to it.
    for name, value in (*values.model_dump(mode="json", exclude=set(tables)).items(), *tables.items()):
        told = " ".join((type(values).model_fields[name].description or "").split())
        lines += ["", *textwrap.wrap(told, 100, initial_indent="# ", subsequent_indent="# ")]
        if isinstance(value, BaseModel):
            lines.append(explained_toml(value, f"{table}.{name}" if table else name))
        else:
            lines.append(f"# {name} =" if value is None else f"{name} = {_toml(value)}")
    return "\n".join(lines).strip()


def _toml(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return tomli_w.dumps({"": value}).partition("=")[2].strip()


def read_toml(path: Path, name: str = "") -> dict[str, Any]:
    """Reads a TOML file.

    Args:
        path: The file.
        name: What messages call it, such as `--config own.toml`; empty: its path.

    Raises:
        ConfigError: It is missing, cannot be read, or is no TOML.
    """
    name = name or readable(path)
    try:
        return tomllib.loads(read_regular(path).decode("utf-8-sig"))  # Windows' editor begins files with a mark
    except OSError as error:
        raise ConfigError(
            f"cannot read {name}: {error.strerror or error}; check the path and its permissions"
        ) from error
    except RecursionError as error:
        raise ConfigError(f"{name} nests its values too deeply; correct it") from error
    except ValueError as error:  # not UTF-8, not TOML, or a number of thousands of digits
        raise ConfigError(f"{name} is not valid TOML ({error}); correct it") from error


def read_settings(path: Path, model: type[_Model]) -> _Model:
    """Reads a TOML file into a model.

    Raises:
        ConfigError: It is missing, cannot be read, is no TOML, lacks a key, or holds an unknown key or a value that
            cannot be; the message names the file and the key.
    """
    values = read_toml(path)
    try:
        return model.model_validate(values)
    except ValidationError as error:
        problem = first_problem(error, model)
        key, file = problem.setting, readable(path)
        if problem.known is not None:
            message = f"unknown key {key!r} in {file}; known here: {', '.join(sorted(problem.known))}"
        elif problem.kind == "missing":
            message = f"{file} lacks {key!r}; add it"
        else:
            message = f"wrong value of {key!r} in {file}: {problem.reason}" if key else f"{file}: {problem.reason}"
        raise ConfigError(message) from error


def _model_at(model: type[BaseModel], location: tuple[int | str, ...]) -> type[BaseModel]:
    """Returns the model that the last name of a location should be a field of."""
    for name in location[:-1]:
        field = model.model_fields.get(str(name))
        annotation = field.annotation if field is not None else None
        for part in (annotation, *get_args(annotation)):  # a table, or a dict of tables
            if isinstance(part, type) and issubclass(part, BaseModel):
                model = part
    return model


def _default(value: object) -> tuple[str, ...]:
    """Shows a default that says something."""
    if isinstance(value, list | tuple | set | frozenset):
        value = ",".join(map(str, value))
    return () if value in (None, "", PydanticUndefined) or isinstance(value, BaseModel) else (f"[{value}]",)
