"""Work of a library that may crash or never end, done in a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

__all__ = ["ChildError", "file_limits", "output_of_child"]

_SECONDS, _BYTES_A_SECOND = 20.0, 2**20
_MEMORY, _TIMES_THE_FILE = 2**30, 16  # so much, and so many times the file for what is compressed

_OUT_OF_MEMORY = 71
_CALL = f"""
import faulthandler, json, os, sys
path, module, name, seconds, memory, arguments = json.loads(sys.argv.pop())
sys.path[:] = path
faulthandler.dump_traceback_later(seconds, exit=True)
from importlib import import_module
function = getattr(import_module(module), name)
try:
    import resource
    with open("/proc/self/statm") as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + memory, resource.RLIM_INFINITY))
except (ImportError, OSError, ValueError):
    pass  # not every system has such limits, and some have a lower one already
out = os.fdopen(os.dup(1), "wb", buffering=1 << 20)
os.dup2(2, 1)  # what a library prints is no answer
try:
    function(out, *arguments)
    out.flush()
except MemoryError:
    os._exit({_OUT_OF_MEMORY})
"""


class ChildError(Exception):
    """A child process crashed, failed or took too long; the message says which."""


def file_limits(path: Path) -> tuple[float, int]:
    """Returns the seconds and the bytes of memory that reading a file may take: 20 s and a second for each MiB.

    Raises:
        OSError: There is no such file.
    """
    size = path.stat().st_size
    return _SECONDS + size / _BYTES_A_SECOND, _MEMORY + _TIMES_THE_FILE * size


@contextlib.contextmanager
def output_of_child(function: Callable[..., None], *arguments: str, seconds: float, memory: int) -> Iterator[IO[bytes]]:
    """Calls a function in a child process, whose time and memory are limited.

    The child imports the module of the function, so that should be light.

    Args:
        function: At the top of its module; called with the binary file to write its answer to, and the arguments.
        arguments: Texts.
        seconds: How long the child may take, the reader's own time included.
        memory: How many bytes it may ask for beyond what the imports take; on Linux only.

    Yields:
        What the function writes. To find it too short raises EOFError, which becomes the ChildError that explains it.

    Raises:
        ChildError: The child crashed, failed, took too long or asked for too much.
    """
    called = json.dumps([sys.path, function.__module__, function.__name__, seconds, memory, arguments])
    started = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-I", "-c", _CALL, called],  # -I: nothing in the working directory is imported
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=None if os.environ.get("EVERPLACE_TRACEBACK") else subprocess.DEVNULL,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},  # each thread reserves memory
    )
    whole = True
    with process:
        try:
            yield _output(process)
        except EOFError:
            whole = False
        except BaseException:
            process.kill()
            raise
    if process.returncode != 0 or not whole:
        late = time.monotonic() - started >= seconds
        raise ChildError(f"reading it {_ended(process.returncode, late)}")


def _output(process: subprocess.Popen[Any]) -> IO[bytes]:
    assert process.stdout is not None
    return process.stdout


def _ended(status: int, late: bool) -> str:
    if status < 0:
        return f"ended with {signal.Signals(-status).name}"
    if status == _OUT_OF_MEMORY:
        return "took too much memory"
    return "came to no end" if late else "failed"
