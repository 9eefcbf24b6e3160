"""A real HTTP server that misbehaves as told."""

from __future__ import annotations

import contextlib
import hashlib
import http.server
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Trouble:
    """What goes wrong with one request.

    Attributes:
        status: An HTTP status instead of the file.
        retry_after: Its Retry-After header.
        send: Only so many bytes are sent; then the connection ends, or stands still.
        stall: It stands still.
    """

    status: int = 0
    retry_after: str = ""
    send: int = -1
    stall: bool = False


@dataclass
class FileServer:
    """What the server has and how it behaves; tests alter it while it runs.

    Attributes:
        content: What any path gives that is not among `files`.
        content_range: What it says of a part, instead of the truth; None: nothing.
        gather: Requests wait here for each other before they are answered.
    """

    url: str = ""
    content: bytes = b""
    files: dict[str, bytes] = field(default_factory=dict)
    etag: str = '"1"'
    last_modified: str = ""
    content_type: str = "application/octet-stream"
    ranges: bool = True
    content_range: str | None = ""
    if_range: bool = True
    with_length: bool = True
    troubles: list[Trouble] = field(default_factory=list)
    requests: list[dict[str, str]] = field(default_factory=list)
    gather: threading.Barrier | None = None
    most_at_once: int = 0
    sent: int = 0
    release: threading.Event = field(default_factory=threading.Event)
    lock: threading.Lock = field(default_factory=threading.Lock)
    now: int = 0

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.content).hexdigest()

    @property
    def asked(self) -> list[str]:
        """The Range header of each request; empty: the whole file."""
        return [headers.get("Range", "") for headers in self.requests]


def handler(server: FileServer) -> type[http.server.BaseHTTPRequestHandler]:
    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            with server.lock:
                server.requests.append(dict(self.headers) | {"path": self.path})
                trouble = server.troubles.pop(0) if server.troubles else Trouble()
                server.now += 1
                server.most_at_once = max(server.most_at_once, server.now)
            try:
                if server.gather is not None:
                    server.gather.wait(20)
                self.answer(trouble)
            except (BrokenPipeError, ConnectionResetError):
                pass
            finally:
                with server.lock:
                    server.now -= 1

        def answer(self, trouble: Trouble) -> None:
            if trouble.status:
                self.send_response(trouble.status)
                if trouble.retry_after:
                    self.send_header("Retry-After", trouble.retry_after)
                self.send_header("Content-Length", "0")
                self.end_headers()
                return
            content, start = server.files.get(self.path, server.content), self.start()
            if start >= len(content) > 0:
                self.send_response(416)
                self.send_header("Content-Range", f"bytes */{len(content)}")
                self.end_headers()
                return
            self.send_response(206 if start else 200)
            if start and server.content_range is not None:
                true = f"bytes {start}-{len(content) - 1}/{len(content)}"
                self.send_header("Content-Range", server.content_range or true)
            if server.with_length:
                self.send_header("Content-Length", str(len(content) - start))
            self.send_header("Content-Type", server.content_type)
            for name, value in (("ETag", server.etag), ("Last-Modified", server.last_modified)):
                if value:
                    self.send_header(name, value)
            self.end_headers()
            body = content[start:]
            body = body[: trouble.send] if trouble.send >= 0 else body
            with server.lock:
                server.sent += len(body)
            self.wfile.write(body)
            self.wfile.flush()
            if trouble.stall:
                server.release.wait(30)

        def start(self) -> int:
            wanted = self.headers.get("Range", "")
            if not wanted or not server.ranges:
                return 0
            condition = self.headers.get("If-Range", "")
            if condition and server.if_range and condition not in (server.etag, server.last_modified):
                return 0
            return int(wanted.removeprefix("bytes=").rstrip("-"))

        def log_message(self, *arguments: object) -> None:
            pass

    return Handler


@contextlib.contextmanager
def serving() -> Iterator[FileServer]:
    """Serves on a free port of this machine until it is left."""
    served = FileServer(content=np.random.default_rng(0).bytes(3 * 2**20 + 17))
    listening = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler(served))
    listening.daemon_threads = True
    served.url = f"http://127.0.0.1:{listening.server_address[1]}/file.bin"
    thread = threading.Thread(target=listening.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    try:
        yield served
    finally:
        served.release.set()
        listening.shutdown()
        listening.server_close()
        thread.join()
