"""What commands print: progress on stderr, results on stdout as a table for people or as JSON."""

from __future__ import annotations

import contextlib
import os
import shlex
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from everplace.cli.option_names import with_options
from everplace.errors import ConfigError, SettingError
from everplace.files import STANDARD_OUTPUT, is_special, json_text, readable
from everplace.progress import Progress

if TYPE_CHECKING:
    from everplace.describe.describer import Describer
    from everplace.route.route import Route
    from everplace.scoring.retrieval import MatchRule, Retrieval

__all__ = [
    "named_settings",
    "provenance",
    "require_directory",
    "require_file",
    "require_no_frame",
    "require_other",
    "require_outside",
    "require_picture",
    "show_progress",
    "show_result",
    "warn",
    "warn_of_methods",
    "warn_of_retrieval",
]

T = TypeVar("T")

_LONGEST_LIST = 24


def show_progress() -> Progress:
    """A `Progress` that draws a bar on stderr for a person at a terminal, and stays silent in a log file."""

    def bar(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        from rich.console import Console
        from rich.progress import track

        console = Console(stderr=True)
        if console.is_terminal:
            yield from track(items, description=what, total=total, console=console, transient=True)
        else:
            yield from items

    return bar


def show_result(result: Mapping[str, Any], as_json: bool) -> None:
    """Prints a result on stdout: for people without its long lists, which nobody reads in a line."""
    if as_json:
        print(json_text(result), end="")
        return
    width = max((len(key) for key in _flat(result)), default=0)
    for key, value in _flat(result).items():
        text = f"{value:.4g}" if isinstance(value, float) else readable(str(value))
        print(f"{key:<{width}}  {text}")


def provenance() -> dict[str, str]:
    """Where a report comes from: the command, the time and the version."""
    command = shlex.join(["everplace", *map(readable, sys.argv[1:])])
    now = datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC")
    return {"command": command, "date": now, "version": f"everplace {version('everplace')}"}


def warn(message: str) -> None:
    """Says something on stderr that the user should know, though the work goes on."""
    print(f"everplace: {with_options(message)}", file=sys.stderr)


def warn_of_methods(describers: Mapping[str, Describer], route: Route, rule: MatchRule | None, advice: str) -> None:
    """Warns of scores that are no test of a method.

    Args:
        describers: Methods by label.
        route: The tested route.
        rule: When a match is right, fully resolved.
        advice: What to do where places were trained on.
    """
    from everplace.experiments.trust import circular_sentence, seen_places, seen_sentence

    for label, describer in describers.items():
        if seen := seen_places(describer, route):
            warn(f"{seen_sentence(label, describer, seen)} {advice}")
        if circular := circular_sentence(label, describer, route, rule):
            warn(circular)


def warn_of_retrieval(result: Retrieval, method: str, advice: str) -> None:
    """Warns of scores that are not there or say little: of places that the method had seen, of a drive's own frames."""
    if result.why_unscored:
        warn(f"there are no scores: {result.why_unscored}")
    warn_of_methods({method: result.describer}, result.pair.tested, result.rule, advice)
    if result.pair.warning:
        warn(result.pair.warning)


def require_directory(out: Path, option: str = "--out") -> None:
    """Refuses an output (`option`) that cannot be a directory, before any work is done.

    Raises:
        ConfigError: It, or what it lies in, is a file, or it is standard output.
    """
    _require_no_dash(out, option)
    for path in (out, *out.parents):
        if path.exists():
            if not path.is_dir():
                raise ConfigError(f"{option} {readable(out)} cannot be a directory: {readable(path)} is a file")
            return


def require_file(out: Path, endings: tuple[str, ...] = (), option: str = "--out") -> None:
    """Refuses an output (`option`) that cannot be a file, before any work is done.

    Raises:
        ConfigError: It is a directory, a device or standard output, lies in a file, or has another ending than those
            given.
    """
    _require_no_dash(out, option)
    if out.is_dir():
        raise ConfigError(f"{option} {readable(out)} is a directory; name a file")
    if is_special(out):
        raise ConfigError(f"{option} {readable(out)} is a device, a FIFO or a socket; name a file")
    if endings and out.suffix.lower() not in endings:
        raise ConfigError(f"{option} {readable(out)} must end in {' or '.join(endings)}")
    require_directory(out.parent, option)


def _require_no_dash(out: Path, option: str) -> None:
    if out == STANDARD_OUTPUT:
        raise ConfigError(f"{option} - is standard output, which takes text alone; name a place (./- is one too)")


def require_outside(out: Path, route: Path, option: str = "--out") -> None:
    """Refuses an output directory (`option`) inside a route, where it would count as a traverse or change one.

    Raises:
        ConfigError: It lies there, or is the route itself.
    """
    if any(_lies_in(out, place) for place in (route, *_directories(route))):
        raise ConfigError(f"{option} {readable(out)} lies in the route {readable(route)}; name a place outside")


def require_no_frame(out: Path, route: Path, option: str = "--out") -> None:
    """Refuses an output file (`option`) inside a traverse of a route, where a picture would count as a frame.

    Raises:
        ConfigError: It lies there.
    """
    if any(_lies_in(out, traverse) for traverse in _directories(route)):
        raise ConfigError(
            f"{option} {readable(out)} lies in a traverse of {readable(route)}, where it would count as a frame or "
            "replace one; name a place outside"
        )


def require_picture(out: Path, route: Path, option: str = "--out") -> None:
    """Refuses an output file (`option`) that is no picture, or lies where it would count as a frame of a route.

    Raises:
        ConfigError: As for `require_file` and `require_no_frame`.
    """
    require_file(out, (".png", ".svg", ".pdf"), option)
    require_no_frame(out, route, option)


def require_other(out: Path, given: Path, option: str = "--out") -> None:
    """Refuses an output file (`option`) that is a file which is read.

    Raises:
        ConfigError: It is.
    """
    if os.path.realpath(out) == os.path.realpath(given):
        raise ConfigError(f"{option} {readable(out)} is a file that is read; name another")


def _lies_in(path: Path, directory: Path) -> bool:
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(directory))


def _directories(route: Path) -> list[Path]:
    """What may be traverses, which may be links to somewhere else."""
    try:
        return [path for path in route.iterdir() if path.is_dir()]
    except OSError:  # opening the route says what is wrong with it
        return []


@contextlib.contextmanager
def named_settings(
    options: Collection[str], config: Path | None = None, *, called: Mapping[str, str] | None = None
) -> Iterator[None]:
    """Says of a setting that is wrong which option gives it, or else which file.

    Args:
        options: Settings that were given by the options of the same names.
        config: The file of the others.
        called: The options of settings that have another name.

    Raises:
        ConfigError: Instead of the SettingError.
    """
    try:
        yield
    except SettingError as error:
        if error.setting.split(".")[0] in options:
            option = (called or {}).get(error.setting, error.setting)
            raise ConfigError(f"--{option.replace('_', '-')}: {error.message}") from None
        if config is not None:
            raise ConfigError(f"--config {readable(config)}: {error}") from None
        raise


def _flat(result: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in result.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key}.")
        elif isinstance(value, list | tuple):
            if len(value) <= _LONGEST_LIST:
                flat[f"{prefix}{key}"] = ", ".join(map(str, value))
        elif value is not None:
            flat[f"{prefix}{key}"] = value
    return flat
