"""The `everplace` command: its sub-commands, and how every error becomes one sentence and an exit status."""

from __future__ import annotations

import errno
import io
import os
import sys
import warnings
from importlib.metadata import version
from typing import Annotated, Any

import typer
from typer.main import get_command

from everplace.cli import data, map, show
from everplace.cli.adapt import adapt
from everplace.cli.compare import compare
from everplace.cli.demo import demo
from everplace.cli.describe import describe
from everplace.cli.evaluate import evaluate
from everplace.cli.export import export
from everplace.cli.localize import localize
from everplace.cli.match import match
from everplace.cli.methods import methods
from everplace.cli.option_names import naming_options, with_options
from everplace.cli.registering import register
from everplace.cli.serve import serve
from everplace.cli.train import train
from everplace.errors import EverplaceError
from everplace.threads import wait_briefly
from everplace.warning_source import file_of_warning

__all__ = ["app", "main", "run"]

_BAD_USAGE, _MACHINE_FAILED, _INTERRUPTED = 2, 1, 130

_KEEPING = (["demo"], ["train"], ["compare"], ["data", "fetch"], ["data", "pack"])
"""Commands that go on where they stood when they are given again; what the others began is gone."""

app = typer.Typer(
    name="everplace",
    help="Recognise a place again in another season, weather or light.\n\nStart with: everplace demo",
    no_args_is_help=True,
    add_completion=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"everplace {version('everplace')}")
        raise typer.Exit


@app.callback()
def _options(
    _: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


for _subcommand in (demo, train, adapt, methods, describe, match, evaluate, compare, export, localize, serve):
    register(app, _subcommand)
app.add_typer(show.app, name="show")
app.add_typer(data.app, name="data")
app.add_typer(map.app, name="map")


def main() -> None:
    """Runs the command and exits with its status: 0, 1 machine, 2 usage or input, 130 Ctrl-C."""
    warnings.showwarning = _show_warning
    wait_briefly()
    for stream in (sys.stdout, sys.stderr):  # a terminal without UTF-8 gets escapes for what it cannot show
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Runs the command with these arguments and returns its exit status."""
    path = _called(arguments)
    with naming_options(path[-1][1], arguments):
        return _run(arguments, " ".join(name for name, _ in path))


def _run(arguments: list[str], called: str) -> int:
    try:
        status = get_command(app).main(args=arguments, prog_name="everplace", standalone_mode=False)
    except typer.Abort:
        return _interrupted(arguments)
    except EverplaceError as error:
        _say(str(error))
        return error.exit_status
    except KeyboardInterrupt:
        return _interrupted(arguments)
    except MemoryError:
        return _out_of_memory()
    except BrokenPipeError:
        # Whoever read our output has gone; Python would complain once more when it closes stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _MACHINE_FAILED
    except OSError as error:
        known = {errno.ENOSPC: "the disk is full; free some space", errno.EDQUOT: "the quota is used up; free space"}
        where = f" ({error.filename})" if error.filename else ""
        _say(known.get(error.errno or 0, f"{error.strerror or error}{where}; check the path and its permissions"))
        return _MACHINE_FAILED
    except Exception as error:  # the last resort: no traceback reaches a user
        if hasattr(error, "format_message"):  # Typer's own errors, whichever library they come from
            return _usage(error, called)
        if type(error).__name__ == "OutOfMemoryError" or "allocate memory" in str(error):
            return _out_of_memory()
        if os.environ.get("EVERPLACE_TRACEBACK"):
            raise
        what = str(error).strip().splitlines()
        _say(
            f"this is a bug in everplace: {type(error).__name__}: {what[0] if what else ''}; "
            "please report it with what EVERPLACE_TRACEBACK=1 shows"
        )
        return _MACHINE_FAILED
    # Typer catches Ctrl-C itself and returns its status.
    if status == _INTERRUPTED:
        return _interrupted(arguments)
    return status if isinstance(status, int) else 0


def _usage(error: Exception, called: str) -> int:
    """Says what is wrong with the command line, in one sentence with the way to the help."""
    format_message = getattr(error, "format_message", None)
    message = str(format_message() if callable(format_message) else error).strip().rstrip(".")
    message = message.replace("Value error, ", "")  # what the parser puts before the reason
    context = getattr(error, "ctx", None)
    if message.startswith("Usage:"):  # no arguments at all: the message is the help
        print(message, file=sys.stderr)
        return _BAD_USAGE
    # Of a number of values that is wrong the parser does not tell the command.
    command = context.command_path if context is not None else called
    _say(f"{message}; see {command} --help")
    return _BAD_USAGE


def _called(arguments: list[str]) -> list[tuple[str, Any]]:
    """The command that is called, after those that it belongs to, with their names."""
    path: list[tuple[str, Any]] = [("everplace", get_command(app))]
    for name in arguments:
        commands = getattr(path[-1][1], "commands", {})
        if name not in commands:
            break
        path.append((name, commands[name]))
    return path


def _out_of_memory() -> int:
    _say("the machine is out of memory; use a smaller --image-size, batch_size or fewer frames")
    return _MACHINE_FAILED


def _interrupted(arguments: list[str]) -> int:
    keeps = any(arguments[: len(command)] == command for command in _KEEPING)
    _say("stopped; what was finished is kept" if keeps else "stopped")
    return _INTERRUPTED


_named: set[tuple[object, ...]] = set()


def _show_warning(message: Warning | str, category: object, *where: object, **_more: object) -> None:
    """Says a warning as a sentence; the line of code it came from helps no user.

    What a library says of a file comes with the file's name, for the first file of which it says such a thing.
    """
    text, file = " ".join(str(message).split()), file_of_warning()
    if not file:
        _say(text)
    elif (category, *where[:2]) not in _named:
        _named.add((category, *where[:2]))
        _say(f"{file}: {text.rstrip('.')}; it was read all the same, and more such files are not named")


def _say(message: str) -> None:
    print(f"everplace: {with_options(message)}", file=sys.stderr)


if __name__ == "__main__":
    main()
