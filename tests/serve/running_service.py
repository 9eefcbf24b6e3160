"""Starts `everplace serve` in a process of its own, as a user does, and ends it."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
from tests.forked import ForkedProcess

_WITH_LIMITS = """
import sys
from dataclasses import replace
from everplace.serve.http_server import serve_map
from everplace.serve.service_limits import DEFAULT_LIMITS
serve_map(sys.argv[1], port=0, limits=replace(DEFAULT_LIMITS, **{limits!r}))
"""


@dataclass
class RunningService:
    """A service that answers.

    Attributes:
        url: With a slash at its end.
        process: Of the service.
        client: Speaks to it.
    """

    url: str
    process: subprocess.Popen[str]
    client: httpx.Client

    @property
    def port(self) -> int:
        return httpx.URL(self.url).port or 80

    def localize(self, image: Path, **fields: str) -> httpx.Response:
        return self.client.post("/localize", files={"image": (image.name, image.read_bytes())}, data=fields)


@contextlib.contextmanager
def running(address: Path, *options: str, token: str = "", **limits: float) -> Iterator[RunningService]:
    """A service of a map; with limits of its own, or with options of the command."""
    command = ["-m", "everplace", "serve", address, "--port", "0", *options]
    if limits:
        command = ["-c", _WITH_LIMITS.format(limits=limits), address]
    environment = {**os.environ, "EVERPLACE_TOKEN": token}
    process = ForkedProcess(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment)
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        line = process.stdout.readline()
        found = re.search(r"http://\S+/", line)
        assert found, line + process.stderr.read()
        with httpx.Client(base_url=found[0], timeout=60, trust_env=False) as client:
            yield RunningService(found[0], process, client)
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(10)
        finally:
            process.kill()
            said = process.stderr.read()
            process.stdout.close()
            process.stderr.close()
    assert process.returncode == 0, said
    assert "bug in everplace" not in said, said
