from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from email.utils import formatdate
from pathlib import Path
from typing import TypeVar

import pytest
from tests.file_server import FileServer, Trouble

from everplace.downloads import Download, Patience, fetch, fetch_all, sha256_of
from everplace.errors import ConfigError, DownloadError, StorageError

QUICK = Patience(timeout=0.3, attempts=3, first_wait=0.01)
OTHER = bytes(range(256)) * 10_000

T = TypeVar("T")


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "cache" / "file.bin"


def left(target: Path) -> list[str]:
    return sorted(path.name for path in target.parent.iterdir())


def break_off(server: FileServer, target: Path, sent: int = 2**20) -> None:
    """Leaves the first bytes of the file beside the target, as an attempt that failed does."""
    server.troubles = [Trouble(send=sent), Trouble(status=503), Trouble(status=503)]
    with pytest.raises(DownloadError):
        fetch(server.url, None, target, patience=QUICK)
    assert left(target) == [".file.bin.download", ".file.bin.download.json"]
    assert (target.parent / ".file.bin.download").read_bytes() == server.content[:sent]
    server.requests.clear()


@pytest.mark.parametrize("with_hash", [True, False])
def test_a_file_comes_whole(server: FileServer, target: Path, with_hash: bool) -> None:
    assert fetch(server.url, server.sha256 if with_hash else None, target) == target
    assert target.read_bytes() == server.content
    assert left(target) == ["file.bin"]
    assert server.requests[0]["User-Agent"].startswith("everplace/")


@pytest.mark.parametrize("size", [0, 1, 2**20, 2**20 + 1])
def test_every_size(server: FileServer, target: Path, size: int) -> None:
    server.content = server.content[:size]
    fetch(server.url, server.sha256, target, size=size)
    assert target.read_bytes() == server.content


def test_what_is_there_is_not_fetched_again(server: FileServer, target: Path) -> None:
    fetch(server.url, server.sha256, target)
    fetch(server.url, server.sha256.upper(), target, size=len(server.content))
    fetch(server.url, None, target)
    assert len(server.requests) == 1


def test_another_file_at_the_target_is_replaced(server: FileServer, target: Path) -> None:
    target.parent.mkdir()
    target.write_bytes(b"old")
    fetch(server.url, server.sha256, target)
    assert target.read_bytes() == server.content


def test_truncated_and_stalled_answers_are_gone_on_with(server: FileServer, target: Path) -> None:
    server.troubles = [Trouble(send=1_000_000), Trouble(send=0, stall=True), Trouble(send=500_000, stall=True)]
    fetch(server.url, server.sha256, target, patience=QUICK)
    assert target.read_bytes() == server.content
    assert server.asked == ["", "bytes=1000000-", "bytes=1000000-", "bytes=1500000-"]
    assert server.sent == len(server.content)


def test_new_bytes_renew_the_attempts(server: FileServer, target: Path) -> None:
    server.troubles = [Trouble(send=1000)] * 12
    fetch(server.url, None, target, patience=QUICK)
    assert target.read_bytes() == server.content
    assert server.asked[-1] == "bytes=12000-"


def test_a_server_that_only_stalls_is_given_up(server: FileServer, target: Path) -> None:
    server.troubles = [Trouble(send=0, stall=True)] * 9
    with pytest.raises(DownloadError, match=r"cannot fetch http://.*: the server stopped sending; check the network"):
        fetch(server.url, None, target, patience=QUICK)
    assert len(server.requests) == 3


@pytest.mark.parametrize("status", [408, 429, 500, 502, 503, 504])
def test_passing_faults_are_waited_out(server: FileServer, target: Path, status: int) -> None:
    server.troubles = [Trouble(status=status), Trouble(status=status)]
    fetch(server.url, server.sha256, target, patience=QUICK)
    assert target.read_bytes() == server.content


def test_faults_that_do_not_pass(server: FileServer, target: Path) -> None:
    server.troubles = [Trouble(status=503)] * 9
    with pytest.raises(DownloadError, match=r"is overloaded \(HTTP 503\)"):
        fetch(server.url, None, target, patience=QUICK)
    assert len(server.requests) == 3
    assert not target.exists()


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The seconds that were waited for, none of which pass."""
    asked: list[float] = []

    def wait(self: threading.Event, seconds: float | None = None) -> bool:
        if seconds is None or threading.current_thread() is not threading.main_thread():
            return original(self, seconds)
        asked.append(seconds)
        return False

    original = threading.Event.wait
    monkeypatch.setattr(threading.Event, "wait", wait)
    return asked


def test_waits_double_and_retry_after_is_heeded(server: FileServer, target: Path, waits: list[float]) -> None:
    server.troubles = [
        Trouble(status=503),
        Trouble(status=503),
        Trouble(status=503),
        Trouble(status=429, retry_after="7"),
        Trouble(status=429, retry_after=formatdate(time.time() + 100, usegmt=True)),
        Trouble(send=10),
        Trouble(status=503, retry_after="soon"),
    ]
    fetch(server.url, None, target, patience=Patience(attempts=9))
    assert waits[:4] == [1.0, 2.0, 4.0, 7.0]
    assert 80 < waits[4] <= 100
    assert waits[5:] == [1.0, 2.0]


def test_a_wait_that_is_too_long_is_an_error(server: FileServer, target: Path, waits: list[float]) -> None:
    server.troubles = [Trouble(status=429, retry_after="3600")]
    with pytest.raises(DownloadError, match=r"\(HTTP 429\) and wants to be left alone for 3600 seconds; run it again"):
        fetch(server.url, None, target)
    assert waits == []


@pytest.mark.parametrize(
    ("status", "message"),
    [
        (404, r"file\.bin does not exist \(HTTP 404\); check the address"),
        (410, r"does not exist \(HTTP 410\)"),
        (401, r"is not given to everyone \(HTTP 401\); fetch it in a browser"),
        (403, r"is not given to everyone \(HTTP 403\)"),
        (418, r"cannot be fetched \(HTTP 418"),
    ],
)
def test_a_refusal_is_one_clear_error(server: FileServer, target: Path, status: int, message: str) -> None:
    server.troubles = [Trouble(status=status)]
    with pytest.raises(DownloadError, match=message):
        fetch(server.url, None, target, patience=QUICK)
    assert len(server.requests) == 1
    assert not target.exists()


def test_the_next_call_goes_on_where_the_last_one_stopped(server: FileServer, target: Path) -> None:
    break_off(server, target)
    fetch(server.url, None, target)
    assert target.read_bytes() == server.content
    assert server.asked == ["bytes=1048576-"]
    assert server.requests[0]["If-Range"] == '"1"'
    assert left(target) == ["file.bin"]


@pytest.mark.parametrize("if_range", [True, False])
@pytest.mark.parametrize("length", [3 * 2**20 + 17, len(OTHER), 1000])
def test_a_file_that_changed_in_between_starts_afresh(
    server: FileServer, target: Path, if_range: bool, length: int
) -> None:
    break_off(server, target)
    server.content, server.etag, server.if_range = (OTHER * 2)[:length], '"2"', if_range
    fetch(server.url, None, target, patience=QUICK)
    assert target.read_bytes() == server.content


def test_a_file_that_changes_during_one_call(server: FileServer, target: Path) -> None:
    def change() -> None:
        while not server.requests:
            time.sleep(0.005)
        server.content, server.etag = OTHER, '"2"'

    server.troubles = [Trouble(send=1_000_000, stall=True)]
    changing = threading.Thread(target=change)
    changing.start()
    fetch(server.url, None, target, patience=QUICK)
    changing.join()
    assert target.read_bytes() == OTHER
    assert server.asked == ["", "bytes=1000000-"]


def test_a_date_of_change_serves_where_there_is_no_strong_etag(server: FileServer, target: Path) -> None:
    server.etag, server.last_modified = 'W/"1"', "Sat, 01 Jan 2022 00:00:00 GMT"
    break_off(server, target)
    fetch(server.url, None, target)
    assert server.requests[0]["If-Range"] == "Sat, 01 Jan 2022 00:00:00 GMT"
    assert server.asked == ["bytes=1048576-"]
    assert target.read_bytes() == server.content


def test_without_any_version_only_a_hash_allows_to_go_on(server: FileServer, target: Path) -> None:
    server.etag = ""
    break_off(server, target)
    server.content = OTHER
    fetch(server.url, None, target)
    assert server.asked == [""]
    assert target.read_bytes() == OTHER


def test_a_mixture_is_noticed_by_its_hash_and_fetched_anew(server: FileServer, target: Path) -> None:
    server.etag = ""
    break_off(server, target)
    server.content = b"?" * len(server.content)
    fetch(server.url, server.sha256, target)
    assert server.asked == ["bytes=1048576-", ""]
    assert target.read_bytes() == server.content


def test_a_server_without_ranges_sends_it_all_again(server: FileServer, target: Path) -> None:
    server.ranges = False
    break_off(server, target)
    fetch(server.url, server.sha256, target)
    assert target.read_bytes() == server.content


def test_a_server_that_does_not_say_how_long_it_is(server: FileServer, target: Path) -> None:
    server.with_length = False
    fetch(server.url, server.sha256, target)
    assert target.read_bytes() == server.content


@pytest.mark.parametrize("damage", ["{", "[]", '{"url": 3}', '{"url": "u", "validator": "", "total": "7"}', ""])
def test_a_damaged_description_starts_afresh(server: FileServer, target: Path, damage: str) -> None:
    break_off(server, target)
    (target.parent / ".file.bin.download.json").write_text(damage)
    fetch(server.url, None, target)
    assert server.asked == [""]
    assert target.read_bytes() == server.content


def test_what_came_from_another_address_is_not_gone_on_with(server: FileServer, target: Path) -> None:
    break_off(server, target)
    fetch(f"{server.url}?v=2", server.sha256, target)
    assert server.asked == [""]


def test_killed_before_the_rename(server: FileServer, target: Path) -> None:
    break_off(server, target)
    (target.parent / ".file.bin.download").write_bytes(server.content)
    fetch(server.url, server.sha256, target)
    assert server.asked == []
    assert target.read_bytes() == server.content


@pytest.mark.parametrize("after_a_break", [False, True])
def test_a_wrong_hash_is_refused_and_nothing_kept(server: FileServer, target: Path, after_a_break: bool) -> None:
    if after_a_break:
        break_off(server, target)
    with pytest.raises(DownloadError, match=f"has the SHA-256 {server.sha256} where 0000"):
        fetch(server.url, "0" * 64, target)
    assert server.asked == (["bytes=1048576-", ""] if after_a_break else [""])
    assert left(target) == []


def test_a_wrong_size_is_refused(server: FileServer, target: Path) -> None:
    with pytest.raises(
        DownloadError, match="has 3145745 bytes where a size of 9 is published; it changed at its source"
    ):
        fetch(server.url, None, target, size=9)
    assert left(target) == []


def test_a_web_page_is_not_a_file(server: FileServer, target: Path) -> None:
    server.content_type = "text/html; charset=utf-8"
    with pytest.raises(DownloadError, match="gave a web page instead of a file"):
        fetch(server.url, None, target)


@pytest.mark.parametrize(
    "url", ["", "file:///etc/passwd", "ftp://host/x", "http://", "http://h:x/", "x.zip", "http://[/"]
)
def test_only_the_web(target: Path, url: str) -> None:
    with pytest.raises(ConfigError, match="is not an http or https address"):
        fetch(url, None, target)


def test_nobody_listens(target: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(
        DownloadError, match=r"127\.0\.0\.1 cannot be reached \(Connection refused\); check the network"
    ):
        fetch(f"http://127.0.0.1:{port}/x", None, target, patience=QUICK)


def test_an_address_in_a_foreign_script(server: FileServer, target: Path) -> None:
    fetch(server.url.replace("file.bin", "Straße %20.bin"), None, target)
    assert server.requests[0]["path"] == "/Stra%C3%9Fe%20%20.bin"


def test_no_place_to_write(server: FileServer, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(StorageError, match="cannot write .*x.bin: .*; free space or choose another place"):
        fetch(server.url, None, tmp_path / "file" / "x.bin")


def counting(seen: list[tuple[str, int | None]]) -> Callable[..., Iterator[T]]:
    def progress(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        seen.append((what, total))
        for item in items:
            seen.append(("step", None))
            yield item

    return progress


@pytest.mark.parametrize("troubles", [[], [Trouble(send=1_500_000)]])
def test_progress_counts_mebibytes(server: FileServer, target: Path, troubles: list[Trouble]) -> None:
    server.troubles = troubles
    seen: list[tuple[str, int | None]] = []
    fetch(server.url, None, target, counting(seen), patience=QUICK)
    assert seen[0] == ("fetching file.bin", 4)
    assert len(seen) == 1 + 4


def downloads(server: FileServer, directory: Path, count: int) -> list[Download]:
    size = len(server.content)
    return [Download(f"{server.url}?{i}", directory / f"{i}.bin", server.sha256, size) for i in range(count)]


def test_several_at_once(server: FileServer, tmp_path: Path) -> None:
    server.gather = threading.Barrier(3)
    seen: list[tuple[str, int | None]] = []
    targets = fetch_all(downloads(server, tmp_path, 6), counting(seen), parallel=3)
    assert [target.name for target in targets] == [f"{i}.bin" for i in range(6)]
    assert {target.read_bytes() for target in targets} == {server.content}
    assert server.most_at_once == 3
    assert seen[0] == ("fetching 6 files", 24)
    assert len(seen) == 1 + 24


def test_one_that_fails_stops_all(server: FileServer, tmp_path: Path) -> None:
    wanted = downloads(server, tmp_path, 3)
    with pytest.raises(DownloadError, match="where 0000"):
        fetch_all([Download(wanted[0].url, wanted[0].target, "0" * 64), *wanted[1:]], parallel=1, patience=QUICK)
    fetch_all(wanted, patience=QUICK)
    assert [sha256_of(download.target) for download in wanted] == [server.sha256] * 3


def test_none_at_all() -> None:
    assert fetch_all([]) == ()


CODE = """import sys
from pathlib import Path
from everplace.downloads import fetch
fetch(sys.argv[1], None, Path(sys.argv[2]))
"""


@pytest.mark.parametrize("kind", [signal.SIGKILL, signal.SIGINT])
def test_killed_in_the_middle_and_resumed(server: FileServer, target: Path, kind: signal.Signals) -> None:
    server.troubles = [Trouble(send=2_000_000, stall=True)]
    partial = target.parent / ".file.bin.download"
    with subprocess.Popen([sys.executable, "-c", CODE, server.url, target], stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 30
        while not partial.exists() or partial.stat().st_size < 2_000_000:
            assert time.monotonic() < deadline, "the child did not download"
            time.sleep(0.01)
        process.send_signal(kind)
        assert process.wait(30) != 0
    assert not target.exists()
    fetch(server.url, server.sha256, target)
    assert server.asked == ["", "bytes=2000000-"]
    assert target.read_bytes() == server.content


def test_two_processes_want_the_same_file(server: FileServer, target: Path) -> None:
    server.troubles = [Trouble(send=1_000_000, stall=True)]
    with subprocess.Popen([sys.executable, "-c", CODE, server.url, target]) as process:
        while not server.requests:
            time.sleep(0.01)
        waiting = threading.Thread(target=fetch, args=(server.url, server.sha256, target))
        waiting.start()
        time.sleep(0.2)
        assert len(server.requests) == 1
        os.kill(process.pid, signal.SIGKILL)
        waiting.join(30)
    assert server.asked == ["", "bytes=1000000-"]
    assert target.read_bytes() == server.content
