"""Processes of Python that need not import everything anew: each is forked from one that has.

A process of the command takes seconds to import what it needs, far longer than most tests of it. Here one process for
each process of pytest imports it, and then forks for each command. What is forked has its own memory, arguments,
environment, directory and standard files, takes signals and ends as a fresh interpreter does. Tests of how the command
starts, and of what it imports when, start a fresh one.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import warnings
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

__all__ = ["ForkedProcess"]

_IMPORTED = (
    "torch", "scipy.stats", "sklearn.cluster", "lightning_fabric", "lance_namespace", "fastapi", "uvicorn",
    "everplace.cli.main", "everplace.experiments.comparison", "everplace.mapping.localizer",
    "everplace.mapping.route_learning", "everplace.mapping.route_map", "everplace.training.fit",
    "everplace.serve.http_server",
)  # fmt: skip
"""What starts no thread: of threads a fork has only the one that forks."""


class ForkedProcess(subprocess.Popen[str]):
    """A `subprocess.Popen` of this Python with `-m MODULE` or `-c CODE`, text in its pipes."""

    def __init__(self, *arguments: object, **options: Any) -> None:
        """Starts it.

        Args:
            arguments: What would stand behind `python`.
            options: As for `subprocess.Popen`: `stdin`, `stdout`, `stderr`, `env` and `cwd`.
        """
        super().__init__([sys.executable, *map(str, arguments)], text=True, **options)

    if sys.platform == "linux":  # elsewhere it starts the interpreter

        def _execute_child(self, *given: Any) -> None:
            """Has the parent of all fork instead of starting the interpreter."""
            command, cwd, environment = given[0], given[5], given[6]
            ends = given[10:16]  # read and write for each of stdin, stdout, stderr; -1: that of this process
            files = [end if end != -1 else own for end, own in zip((ends[0], ends[3], ends[5]), range(3), strict=True)]
            self._told, tells = os.pipe()
            request = {"command": command[1:], "cwd": str(cwd or Path.cwd()), "env": dict(environment or os.environ)}
            try:
                socket.send_fds(_forking(), [json.dumps(request).encode()], [*files, tells])
            finally:
                os.close(tells)
                self._close_pipe_fds(*ends)  # type: ignore[attr-defined]
            self.pid = int(self._line())
            self._child_created = True

        def _line(self) -> bytes:
            line = b""
            while not line.endswith(b"\n"):
                letter = os.read(self._told, 1)
                if not letter:
                    raise EOFError("the process that forks has ended")
                line += letter
            return line

        def _try_wait(self, flags: int) -> tuple[int, int]:
            if flags & os.WNOHANG and not select.select([self._told], [], [], 0)[0]:
                return 0, 0
            status = int(self._line())
            os.close(self._told)
            return self.pid, status

        def _internal_poll(self, *_: object, **__: object) -> int | None:
            if self.returncode is None:
                pid, status = self._try_wait(os.WNOHANG)
                if pid:
                    self._handle_exitstatus(status)  # type: ignore[attr-defined]
            return self.returncode


@cache
def _forking() -> socket.socket:
    """The way to the process that forks, which is started by the first who asks and ends with this one."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    command = [sys.executable, "-m", "tests.forked", str(theirs.fileno())]
    paths = os.pathsep.join(filter(None, (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH"))))
    process = subprocess.Popen(command, pass_fds=[theirs.fileno()], env={**os.environ, "PYTHONPATH": paths})
    theirs.close()

    def end() -> None:
        ours.close()
        process.wait()

    atexit.register(end)
    return ours


def _next_command(asked: socket.socket) -> Callable[[], object] | None:
    """Forks for each command: returns it in the process that is to run it, and None in the first when all is over."""
    for module in _IMPORTED:
        import_module(module)
    gc.freeze()  # so that no fork looks through it all again
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those that tell how a command ended
    while True:
        message, files, *_ = socket.recv_fds(asked, 2**20, 4)
        if not message:
            return None
        if os.fork() == 0:
            break
        for file in files:
            os.close(file)
    asked.close()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    *standard, tells = files
    pid = os.fork()
    if pid:
        for file in standard:
            os.close(file)
        os.write(tells, f"{pid}\n".encode())
        os.write(tells, f"{os.waitpid(pid, 0)[1]}\n".encode())
        os._exit(0)
    return _become(json.loads(message), standard, tells)


def _become(request: dict[str, Any], standard: list[int], tells: int) -> Callable[[], object]:
    """Takes over files, environment, directory and arguments."""
    for number, file in enumerate(standard):
        os.dup2(file, number)
        os.close(file)
    os.close(tells)
    os.environ.clear()
    os.environ.update(request["env"])
    os.chdir(request["cwd"])
    for name, mode, number in (("stdin", "r", 0), ("stdout", "w", 1), ("stderr", "w", 2)):
        errors = "backslashreplace" if name == "stderr" else "strict"
        setattr(sys, name, open(number, mode, errors=errors, closefd=False))  # noqa: SIM115
    how, what, *arguments = request["command"]
    sys.argv = ["-c", *arguments]
    sys.path[0] = ""
    if how == "-c":
        return lambda: exec(compile(what, "<string>", "exec"), {"__name__": "__main__"})
    sys.path[0] = request["cwd"]
    return lambda: runpy.run_module(what, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    with socket.socket(fileno=int(sys.argv[1])) as _asked, warnings.catch_warnings():
        _command = _next_command(_asked)
    if _command is not None:
        _command()
