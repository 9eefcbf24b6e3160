from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

import pytest
from tests.file_server import FileServer, Trouble

from everplace import downloads
from everplace.downloads import fetch
from everplace.errors import ConfigError, DownloadError, StorageError

OTHER = bytes(range(256)) * 10_000
PIECE = 2**16

T = TypeVar("T")


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(downloads, "_TIMEOUT", 0.3)
    monkeypatch.setattr(downloads, "_ATTEMPTS", 3)
    monkeypatch.setattr(downloads, "_FIRST_WAIT", 0.01)


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "cache" / "file.bin"


def left(target: Path) -> list[str]:
    return sorted(path.name for path in target.parent.iterdir())


def break_off(server: FileServer, target: Path, sent: int = 2**20) -> None:
    """Leaves the first bytes of the file beside the target, as an attempt that failed does."""
    server.troubles = [Trouble(send=sent), Trouble(status=503), Trouble(status=503)]
    with pytest.raises(DownloadError):
        fetch(server.url, None, target)
    assert left(target) == [".file.bin.download", ".file.bin.download.version"]
    assert (target.parent / ".file.bin.download").read_bytes() == server.content[:sent]
    server.requests.clear()


@pytest.mark.parametrize("with_hash", [True, False])
def test_a_file_comes_whole(server: FileServer, target: Path, with_hash: bool) -> None:
    assert fetch(server.url, server.sha256 if with_hash else None, target) == target
    assert target.read_bytes() == server.content
    assert left(target) == ["file.bin"]
    assert server.requests[0]["User-Agent"].startswith("everplace/")


@pytest.mark.parametrize("size", [0, 1, PIECE, PIECE + 1])
def test_every_size(server: FileServer, target: Path, size: int) -> None:
    server.content = server.content[:size]
    fetch(server.url, server.sha256, target)
    assert target.read_bytes() == server.content


def test_what_is_there_is_not_fetched_again(server: FileServer, target: Path) -> None:
    fetch(server.url, server.sha256, target)
    fetch(server.url, server.sha256.upper(), target)
    fetch(server.url, None, target)
    assert len(server.requests) == 1


def test_another_file_at_the_target_is_replaced(server: FileServer, target: Path) -> None:
    target.parent.mkdir()
    target.write_bytes(b"old")
    fetch(server.url, server.sha256, target)
    assert target.read_bytes() == server.content


def test_truncated_and_stalled_answers_are_gone_on_with(server: FileServer, target: Path) -> None:
    server.troubles = [Trouble(send=15 * PIECE), Trouble(send=0, stall=True), Trouble(send=8 * PIECE, stall=True)]
    fetch(server.url, server.sha256, target)
    assert target.read_bytes() == server.content
    assert server.asked == ["", f"bytes={15 * PIECE}-", f"bytes={15 * PIECE}-", f"bytes={23 * PIECE}-"]
    assert server.sent == len(server.content)


def test_new_bytes_renew_the_attempts(server: FileServer, target: Path) -> None:
    server.troubles = [Trouble(send=PIECE)] * 12
    fetch(server.url, None, target)
    assert target.read_bytes() == server.content
    assert server.asked[-1] == f"bytes={12 * PIECE}-"


def test_a_server_that_only_stalls_is_given_up(server: FileServer, target: Path) -> None:
    server.troubles = [Trouble(send=0, stall=True)] * 9
    with pytest.raises(DownloadError, match=r"cannot fetch http://.*: timed out; check the network"):
        fetch(server.url, None, target)
    assert len(server.requests) == 3


@pytest.mark.parametrize("status", [408, 429, 500, 502, 503, 504])
def test_passing_faults_are_waited_out(server: FileServer, target: Path, status: int) -> None:
    server.troubles = [Trouble(status=status), Trouble(status=status)]
    fetch(server.url, server.sha256, target)
    assert target.read_bytes() == server.content


def test_faults_that_do_not_pass(server: FileServer, target: Path) -> None:
    server.troubles = [Trouble(status=503)] * 9
    with pytest.raises(DownloadError, match=r"is overloaded or fails \(HTTP 503\); run it again later"):
        fetch(server.url, None, target)
    assert len(server.requests) == 3
    assert not target.exists()


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
        fetch(server.url, None, target)
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
    fetch(server.url, None, target)
    assert target.read_bytes() == server.content


def test_a_file_that_changes_during_one_call(server: FileServer, target: Path) -> None:
    def change() -> None:
        while not server.requests:
            time.sleep(0.005)
        server.content, server.etag = OTHER, '"2"'

    server.troubles = [Trouble(send=15 * PIECE, stall=True)]
    changing = threading.Thread(target=change)
    changing.start()
    fetch(server.url, None, target)
    changing.join()
    assert target.read_bytes() == OTHER
    assert server.asked == ["", f"bytes={15 * PIECE}-"]


def test_a_date_of_change_serves_where_there_is_no_strong_etag(server: FileServer, target: Path) -> None:
    server.etag, server.last_modified = 'W/"1"', "Sat, 01 Jan 2022 00:00:00 GMT"
    break_off(server, target)
    fetch(server.url, None, target)
    assert server.requests[0]["If-Range"] == "Sat, 01 Jan 2022 00:00:00 GMT"
    assert server.asked == ["bytes=1048576-"]
    assert target.read_bytes() == server.content


def test_without_any_version_it_starts_afresh(server: FileServer, target: Path) -> None:
    server.etag = ""
    break_off(server, target)
    server.content = OTHER
    fetch(server.url, None, target)
    assert server.asked == [""]
    assert target.read_bytes() == OTHER


def test_a_server_without_ranges_sends_it_all_again(server: FileServer, target: Path) -> None:
    server.ranges = False
    break_off(server, target)
    fetch(server.url, server.sha256, target)
    assert target.read_bytes() == server.content


@pytest.mark.parametrize("said", [None, "bytes 0-9/10", "bytes 1048577-2000000/2000001", "all of it"])
def test_a_server_that_lies_about_the_part_it_sends(server: FileServer, target: Path, said: str | None) -> None:
    server.content_range = said
    break_off(server, target)
    fetch(server.url, None, target)
    assert server.asked == ["bytes=1048576-", ""]
    assert target.read_bytes() == server.content


def test_a_server_that_does_not_say_how_long_it_is(server: FileServer, target: Path) -> None:
    server.with_length = False
    fetch(server.url, server.sha256, target)
    assert target.read_bytes() == server.content


@pytest.mark.parametrize("damage", ["{", "", "\n\n"])
def test_a_damaged_note_of_the_version_starts_afresh(server: FileServer, target: Path, damage: str) -> None:
    break_off(server, target)
    (target.parent / ".file.bin.download.version").write_text(damage)
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
    assert server.asked == [f"bytes={len(server.content)}-"]
    assert server.sent == 2**20
    assert target.read_bytes() == server.content


@pytest.mark.parametrize("after_a_break", [False, True])
def test_a_wrong_hash_is_refused_and_nothing_kept(server: FileServer, target: Path, after_a_break: bool) -> None:
    if after_a_break:
        break_off(server, target)
    with pytest.raises(DownloadError, match=f"has the SHA-256 {server.sha256} where 0000"):
        fetch(server.url, "0" * 64, target)
    assert server.asked == (["bytes=1048576-"] if after_a_break else [""])
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
    with pytest.raises(DownloadError, match=r"127\.0\.0\.1.*: Connection refused; check the network"):
        fetch(f"http://127.0.0.1:{port}/x", None, target)


def test_an_address_in_a_foreign_script(server: FileServer, target: Path) -> None:
    fetch(server.url.replace("file.bin", "Straße %20.bin"), None, target)
    assert server.requests[0]["path"] == "/Stra%C3%9Fe%20%20.bin"


def test_no_place_to_write(server: FileServer, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(StorageError, match="cannot write .*file: .*; choose another place"):
        fetch(server.url, None, tmp_path / "file" / "x.bin")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limits of this kind")
def test_a_disk_that_is_full_keeps_what_has_come(server: FileServer, target: Path) -> None:
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10 * PIECE, hard))
    try:
        with pytest.raises(StorageError, match=r"cannot write .*file\.bin: .*; free space or choose another place"):
            fetch(server.url, None, target)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not target.exists()
    fetch(server.url, None, target)
    assert server.asked == ["", f"bytes={10 * PIECE}-"]
    assert target.read_bytes() == server.content


def test_progress_counts_the_pieces_of_each_attempt(server: FileServer, target: Path) -> None:
    server.troubles = [Trouble(send=40 * PIECE)]
    seen: list[tuple[str, int | None]] = []

    def progress(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        seen.append((what, total))
        yield from items

    fetch(server.url, None, target, progress)
    assert seen == [("fetching file.bin", 49), ("fetching file.bin", 9)]


CODE = """import sys
from pathlib import Path
from everplace.downloads import fetch
fetch(sys.argv[1], None, Path(sys.argv[2]))
"""


@pytest.mark.parametrize("kind", [signal.SIGKILL, signal.SIGINT])
def test_killed_in_the_middle_and_resumed(server: FileServer, target: Path, kind: signal.Signals) -> None:
    server.troubles = [Trouble(send=30 * PIECE, stall=True)]
    partial = target.parent / ".file.bin.download"
    with subprocess.Popen([sys.executable, "-c", CODE, server.url, target], stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 30
        while not partial.exists() or partial.stat().st_size < 30 * PIECE:
            assert time.monotonic() < deadline, "the child did not download"
            time.sleep(0.01)
        process.send_signal(kind)
        assert process.wait(30) != 0
    assert not target.exists()
    fetch(server.url, server.sha256, target)
    assert server.asked == ["", f"bytes={30 * PIECE}-"]
    assert target.read_bytes() == server.content
    assert left(target) == ["file.bin"]


def test_two_processes_want_the_same_file(server: FileServer, target: Path) -> None:
    server.troubles = [Trouble(send=15 * PIECE, stall=True)]
    with subprocess.Popen([sys.executable, "-c", CODE, server.url, target]) as process:
        while not server.requests:
            time.sleep(0.01)
        waiting = threading.Thread(target=fetch, args=(server.url, server.sha256, target))
        waiting.start()
        time.sleep(0.2)
        assert len(server.requests) == 1
        os.kill(process.pid, signal.SIGKILL)
        waiting.join(30)
    assert server.asked == ["", f"bytes={15 * PIECE}-"]
    assert target.read_bytes() == server.content
    assert left(target) == ["file.bin"]
