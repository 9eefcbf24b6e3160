"""How the service begins and ends."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest
from tests.cli.test_main import refused
from tests.serve.running_service import running


@pytest.mark.parametrize(
    ("sent", "status", "said"), [(signal.SIGINT, 130, "everplace: stopped\n"), (signal.SIGTERM, 0, "")]
)
@pytest.mark.slow
def test_it_ends_at_once_whoever_is_connected(
    unchanged_summer_map: Path, sent: signal.Signals, status: int, said: str
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "everplace", "serve", str(unchanged_summer_map), "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    url = httpx.URL(line.split(" at ")[1].split()[0])
    assert line == f"everplace: {unchanged_summer_map} is served at {url} (Ctrl-C ends it)\n"
    silent = socket.create_connection(("127.0.0.1", url.port or 80))
    slow = socket.create_connection(("127.0.0.1", url.port or 80))
    slow.sendall(b"POST /localize HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n")
    with httpx.Client(base_url=url, trust_env=False) as client:
        assert client.get("/healthz").status_code == 200  # stays connected
        start = time.monotonic()
        process.send_signal(sent)
        out, err = process.communicate(timeout=20)
        assert time.monotonic() - start < 5
    assert (process.returncode, out, err) == (status, "", said)
    silent.close()
    slow.close()


def test_a_port_in_use(unchanged_summer_map: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"--port {port} of 127.0.0.1 is in use" in refused("serve", unchanged_summer_map, "--port", str(port))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--host", "0.0.0.0"], "so a token is required; give --token"),
        (["--host", "192.0.2.1", "--token", "x"], "cannot listen at --host 192.0.2.1"),
        (["--host", "no.such.host.invalid", "--token", "x"], "is no name or address of this machine"),
        (["--token", "two words"], "--token must consist of printable ASCII"),
        (["--port", "65536"], "less than or equal to 65535"),
    ],
)
def test_what_cannot_be_served_is_said_in_a_sentence(
    unchanged_summer_map: Path, options: list[str], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("EVERPLACE_TOKEN", raising=False)
    assert said in refused("serve", unchanged_summer_map, *options)


def test_no_map_no_service(tmp_path: Path) -> None:
    assert "there is no map at" in refused("serve", tmp_path / "none", "--port", "0")


@pytest.mark.skipif(not socket.has_ipv6 or not Path("/proc/net/if_inet6").exists(), reason="no IPv6 here")
@pytest.mark.slow
def test_ipv6(unchanged_summer_map: Path) -> None:
    with running(unchanged_summer_map, "--host", "::1") as service:
        assert service.url.startswith("http://[::1]:")
        assert service.client.get("/healthz").status_code == 200


@pytest.mark.slow
def test_the_token_of_the_environment_counts(unchanged_summer_map: Path) -> None:
    assert "EVERPLACE_TOKEN" not in os.environ
    with running(unchanged_summer_map, token="from-outside") as service:
        assert service.client.get("/map").status_code == 401
        assert service.client.get("/map", headers={"Authorization": "Bearer from-outside"}).status_code == 200


@pytest.mark.parametrize("missing", ["fastapi", "prometheus_client", "python_multipart", "uvicorn"])
def test_without_the_extra_it_says_how_to_get_it(missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    assert "pip install 'everplace[serve]'" in refused("serve", tmp_path)
