"""Bodies are counted as they stream."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.serve.running_service import RunningService, running

LIMIT = 200_000


@pytest.fixture(scope="module")
def limited(unchanged_summer_map: Path) -> Iterator[RunningService]:
    with running(unchanged_summer_map, body_bytes=LIMIT, bytes_under_way=3 * LIMIT) as served:
        yield served


def test_what_is_too_large_is_refused(limited: RunningService, winter: list[Path]) -> None:
    response = limited.client.post("/localize", files={"image": b"\x89PNG" * LIMIT})
    assert response.status_code == 413
    assert f"more than {LIMIT} bytes" in response.json()["detail"]
    assert limited.localize(winter[0]).status_code == 200


def test_it_does_not_take_a_length_to_be_refused(limited: RunningService) -> None:
    def chunks() -> Iterator[bytes]:
        yield b'--b\r\nContent-Disposition: form-data; name="image"; filename="a.png"\r\n\r\n'
        for _ in range(40):
            yield b"x" * 10_000

    kind = {"Content-Type": "multipart/form-data; boundary=b"}
    assert limited.client.post("/localize", content=chunks(), headers=kind).status_code == 413


def test_requests_that_take_no_body_read_none(limited: RunningService) -> None:
    assert limited.client.request("GET", "/map", content=b"x" * 3 * LIMIT).status_code == 200
    assert limited.client.request("GET", "/healthz").status_code == 200


@pytest.mark.slow
def test_together_they_are_limited_and_what_ends_makes_room(limited: RunningService, winter: list[Path]) -> None:
    head = (
        b"POST /localize HTTP/1.1\r\nHost: localhost\r\nContent-Type: multipart/form-data; boundary=b\r\n"
        b"Content-Length: 190000\r\n\r\n--b\r\n"
        b'Content-Disposition: form-data; name="image"; filename="a.png"\r\n\r\n'
    )
    held = [socket.create_connection(("127.0.0.1", limited.port)) for _ in range(3)]
    for connection in held:
        connection.sendall(head + b"x" * 180_000)
    time.sleep(2)  # until they are read: whoever brings too much is refused, be it one of these
    busy = limited.client.post("/localize", files={"image": b"x" * 150_000})
    assert (busy.status_code, busy.headers["retry-after"]) == (503, "1")
    for connection in held:
        connection.close()
    end = time.monotonic() + 20
    while limited.client.post("/localize", files={"image": b"x" * 150_000}).status_code == 503:
        assert time.monotonic() < end
    assert limited.localize(winter[0]).status_code == 200
