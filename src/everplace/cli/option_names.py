"""The library's messages name arguments, in backticks; who runs a command knows these as its options."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from typing import Any

__all__ = ["naming_options", "with_options"]

_ARGUMENT = re.compile("`([a-z_]+)(?:=([^`]*))?`")  # `frames`, `by=poses`, `resume=True`
_SET = "--set"

_running: ContextVar[tuple[Any, Sequence[str]] | None] = ContextVar("running", default=None)


@contextlib.contextmanager
def naming_options(command: Any, arguments: Sequence[str]) -> Iterator[None]:
    """Has `with_options` name the options of this command, as its parser knows them, while it runs.

    Args:
        command: The command.
        arguments: What it was given, which may name the kind of source that `--set` is about.
    """
    token = _running.set((command, arguments))
    try:
        yield
    finally:
        _running.reset(token)


def with_options(message: str) -> str:
    """Writes for each argument in backticks the option of the running command that gives it.

    What is no option of the command, or is not wholly an argument's name (and value), stays as it is.
    """
    running = _running.get()
    if running is None or _ARGUMENT.search(message) is None:
        return message
    options = _options(*running)

    def option(found: re.Match[str]) -> str:
        name, value = found[1], found[2]
        if name not in options:
            return found[0]
        if value is None or value == "True":  # a flag is given by its name
            return options[name]
        return f"{options[name]}{'=' if options[name].startswith(_SET) else ' '}{value}"

    return _ARGUMENT.sub(option, message)


def _options(command: Any, arguments: Sequence[str]) -> dict[str, str]:
    """The options of a command by the names of the arguments that they give."""
    long = [option for parameter in command.params for option in parameter.opts if option.startswith("--")]
    known = {option.removeprefix("--").replace("-", "_"): option for option in long}
    if _SET in long:
        from everplace.importing.kinds import source_kinds

        kinds = source_kinds()
        named = [kind for kind in kinds if kind in arguments]
        known |= {field: f"{_SET} {field}" for kind in named or kinds for field in kinds[kind].Options.model_fields}
    return known
