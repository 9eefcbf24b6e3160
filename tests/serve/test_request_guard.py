"""Who may ask, and what browsers are told."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.serve.running_service import RunningService, running

from everplace.errors import ConfigError
from everplace.serve.request_guard import is_loopback, require_token

TOKEN = "correct-horse"
GUARDED = ("/map", "/frames/0", "/frames/0/info", "/metrics", "/openapi.json", "/nothing")


@pytest.fixture(scope="module")
def guarded(unchanged_summer_map: Path) -> Iterator[RunningService]:
    options = ("--host", "0.0.0.0", "--allow-host", "robot.example")
    with running(unchanged_summer_map, *options, token=TOKEN) as served:
        yield served


def at(service: RunningService, path: str, **headers: str) -> int:
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return service.client.get(f"http://127.0.0.1:{service.port}{path}", headers=named).status_code


def test_without_the_token_there_are_the_page_and_the_health(guarded: RunningService) -> None:
    for path in GUARDED:
        assert at(guarded, path) == 401
    for path in ("/", "/page/main.js", "/healthz"):
        assert at(guarded, path) == 200


def test_uploads_need_the_token_too(guarded: RunningService, winter: list[Path]) -> None:
    url = f"http://127.0.0.1:{guarded.port}/localize"
    files = {"image": winter[0].read_bytes()}
    refused = guarded.client.post(url, files=files)
    assert (refused.status_code, refused.headers["www-authenticate"]) == (401, "Bearer")
    right = {"Authorization": f"Bearer {TOKEN}"}
    assert guarded.client.post(url, files=files, headers=right).status_code == 200
    assert guarded.client.delete(f"http://127.0.0.1:{guarded.port}/sessions/x").status_code == 401


@pytest.mark.parametrize(
    ("given", "status"),
    [
        (f"Bearer {TOKEN}", 200), (f"bearer {TOKEN}", 200), (f"Bearer {TOKEN}x", 401), (f"Bearer {TOKEN[:-1]}", 401),
        ("Bearer", 401), (TOKEN, 401), (f"Basic {TOKEN}", 401), ("Bearer \u00e9", 401),
    ],
)  # fmt: skip
def test_only_the_whole_token_is_right(guarded: RunningService, given: str, status: int) -> None:
    url = f"http://127.0.0.1:{guarded.port}/map"
    assert guarded.client.get(url, headers={b"Authorization": given.encode("latin-1")}).status_code == status


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1", 200), ("127.9.9.9:1", 200), ("localhost:8000", 200), ("LOCALHOST", 200), ("[::1]:80", 200),
        ("evil.example", 403), ("localhost.evil.example", 403), ("192.0.2.7", 403), ("", 403), ("[::1", 200),
        ("127.0.0.1.evil.example:80", 403), ("robot.example", 403),
    ],
)  # fmt: skip
def test_a_service_on_loopback_knows_its_names(service: RunningService, host: str, status: int) -> None:
    assert service.client.get("/healthz", headers={"Host": host}).status_code == status


@pytest.mark.parametrize(("host", "status"), [("192.0.2.7", 200), ("robot.example:80", 200), ("evil.example", 403)])
def test_a_service_on_all_addresses_is_reached_by_them(guarded: RunningService, host: str, status: int) -> None:
    assert at(guarded, "/healthz", Host=host) == status


def test_pages_of_others_may_not_ask(service: RunningService, winter: list[Path]) -> None:
    own = service.url.rstrip("/")
    for origin, status in ((own, 200), ("http://evil.example", 403), ("null", 403), ("http://localhost:1", 403)):
        files = {"image": winter[0].read_bytes()}
        response = service.client.post("/localize", files=files, headers={"Origin": origin})
        assert response.status_code == status
        assert "access-control-allow-origin" not in response.headers
    preflight = service.client.options(
        "/localize", headers={"Origin": "http://evil.example", "Access-Control-Request-Method": "POST"}
    )
    assert preflight.status_code == 403


@pytest.mark.parametrize("path", ["/", "/map", "/frames/0", "/nothing", "/healthz"])
def test_every_answer_is_careful(service: RunningService, path: str) -> None:
    headers = service.client.get(path).headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    assert "cache-control" in headers
    assert "server" not in headers


@pytest.mark.parametrize(
    ("host", "loopback"),
    [
        ("127.0.0.1", True), ("127.3.2.1", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("::", False),
        ("192.168.0.7", False), ("robot", False), ("localhost.example", False), ("", False),
    ],
)  # fmt: skip
def test_loopback(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback
    if not loopback:
        with pytest.raises(ConfigError, match="so a token is required"):
            require_token(host, "")
        with pytest.raises(ConfigError, match="so a token is required"):
            require_token("127.0.0.1", "", ["localhost", host])
    require_token(host, "secret", [host])


@pytest.mark.parametrize("token", ["two words", "line\nbreak", "caf\u00e9", "\x7f"])
def test_a_token_fits_into_a_header(token: str) -> None:
    with pytest.raises(ConfigError, match="printable ASCII"):
        require_token("127.0.0.1", token)
