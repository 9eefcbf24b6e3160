"""Clients that are slow, leave in the middle, or come all at once: the others are served."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
from tests.serve.running_service import RunningService, running

HEAD = (
    b"POST /localize HTTP/1.1\r\nHost: localhost\r\nContent-Type: multipart/form-data; boundary=b\r\n"
    b"Content-Length: 100000\r\n\r\n--b\r\n"
)


@pytest.fixture(scope="module")
def hurried(unchanged_summer_map: Path) -> Iterator[RunningService]:
    with running(unchanged_summer_map, head_seconds=1.0, body_seconds=1.5, send_seconds=1.0, connections=40) as served:
        yield served


def seconds_until_closed(port: int, first: bytes, drip: bytes) -> float:
    """Sends the first bytes, and then one more each 0.1 s: until the service closes the connection."""
    start = time.monotonic()
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.settimeout(0.1)
        try:
            connection.sendall(first)
            while time.monotonic() - start < 20:
                connection.sendall(drip)
                try:
                    if not connection.recv(1):
                        break
                except TimeoutError:
                    pass
        except ConnectionError:
            pass
    return time.monotonic() - start


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "drip", "seconds"),
    [
        (b"", b"", 1.0),  # says nothing
        (b"", b"G", 1.0),  # a line that does not end
        (b"GET / HTTP/1.1\r\n", b"a: b\r\n", 1.0),  # a head that does not end
        (HEAD, b"", 1.5),  # a body that does not come
        (HEAD, b"x", 1.5),  # or drop by drop
        (b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n" + b"GET /h", b"e", 1.0),  # in the second request
    ],
)
def test_slow_clients_are_left(hurried: RunningService, first: bytes, drip: bytes, seconds: float) -> None:
    taken = seconds_until_closed(hurried.port, first, drip)
    assert seconds - 0.3 <= taken < seconds + 4


@pytest.mark.slow
def test_others_are_served_beside_slow_clients(hurried: RunningService, winter: list[Path]) -> None:
    slow = [threading.Thread(target=seconds_until_closed, args=(hurried.port, HEAD, b"x")) for _ in range(20)]
    for client in slow:
        client.start()
    assert all(hurried.localize(path).status_code == 200 for path in winter[:5])
    for client in slow:
        client.join()


@pytest.mark.slow
def test_an_answer_that_nobody_reads_is_dropped(hurried: RunningService) -> None:
    """Thousands of pipelined requests fill every buffer between the two."""
    asked = b"GET /map HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with socket.create_connection(("127.0.0.1", hurried.port)) as connection:
        connection.settimeout(10)
        with pytest.raises(ConnectionError):
            for _ in range(200_000):
                connection.sendall(asked)
    assert hurried.client.get("/healthz").status_code == 200


@pytest.mark.parametrize("sent", [HEAD, HEAD[:40], HEAD + b"x" * 50_000, b""])
@pytest.mark.parametrize("reset", [False, True])
def test_clients_that_leave_in_the_middle_do_no_harm(
    service: RunningService, winter: list[Path], sent: bytes, reset: bool
) -> None:
    for _ in range(10):
        with socket.create_connection(("127.0.0.1", service.port)) as connection:
            connection.sendall(sent)
            if reset:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    assert service.localize(winter[3]).json()["place"] == 3


def test_clients_that_do_not_wait_for_their_answer(service: RunningService, winter: list[Path]) -> None:
    request = httpx.Request("POST", f"{service.url}localize", files={"image": ("a.png", winter[3].read_bytes())})
    head = b"POST /localize HTTP/1.1\r\nHost: localhost\r\n"
    for name in ("Content-Type", "Content-Length"):
        head += f"{name}: {request.headers[name]}\r\n".encode()
    for _ in range(30):
        with socket.create_connection(("127.0.0.1", service.port)) as connection:
            connection.sendall(head + b"\r\n" + request.read())
    while "everplace_work_under_way 0.0" not in service.client.get("/metrics").text:
        time.sleep(0.05)
    assert service.localize(winter[3]).json()["place"] == 3


def test_two_hundred_at_once_are_served_or_told_to_come_back(service: RunningService, winter: list[Path]) -> None:
    together = threading.Barrier(200)

    def ask(number: int) -> httpx.Response:
        with httpx.Client(base_url=service.url, timeout=60, trust_env=False) as client:
            content = winter[number % 60].read_bytes()
            together.wait(30)
            return client.post("/localize", files={"image": (f"{number % 60}.png", content)})

    with ThreadPoolExecutor(200) as pool:
        answers = list(pool.map(ask, range(200)))
    seen = Counter(answer.status_code for answer in answers)
    assert set(seen) <= {200, 503}
    assert seen[200] >= 50
    for number, answer in enumerate(answers):
        if answer.status_code == 200:
            assert answer.json()["frame"] == str(number % 60)
            assert abs(answer.json()["place"] - number % 60) <= 1
        else:
            assert answer.headers["retry-after"] == "1"
            assert "ask again" in answer.json()["detail"]


@pytest.mark.slow
def test_too_many_connections_are_told_to_come_back(hurried: RunningService) -> None:
    time.sleep(1.5)  # those of other tests are gone
    held = [socket.create_connection(("127.0.0.1", hurried.port)) for _ in range(40)]
    with socket.create_connection(("127.0.0.1", hurried.port)) as late:
        late.settimeout(5)
        said = late.recv(1000)
    assert said.startswith(b"HTTP/1.1 503 ")
    assert b"Retry-After: 1\r\n" in said
    for connection in held:
        connection.close()
