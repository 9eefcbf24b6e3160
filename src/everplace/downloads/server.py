"""One request for a file, from some byte on, and what each answer means."""

from __future__ import annotations

import http.client
import re
import ssl
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from email.message import Message
from email.utils import parsedate_to_datetime
from importlib.metadata import version

from everplace.errors import ConfigError, DownloadError
from everplace.files import readable

__all__ = ["Answer", "Patience", "Retry", "ask", "body"]

_TRY_AGAIN = {
    408: "took too long",
    425: "is not ready",
    429: "has too many requests",
    500: "failed",
    502: "failed",
    503: "is overloaded",
    504: "took too long",
}
_LOGIN = frozenset({401, 403, 407})
_GONE = frozenset({404, 410})
_RANGE_BEYOND_END = 416
_PARTIAL = 206
_URL_CHARACTERS = ":/?#[]@!$&'()*+,;=%~"
_CONTENT_RANGE = re.compile(r"bytes ([0-9]{1,18})-[0-9]{1,18}/([0-9]{1,18}|\*)")


@dataclass(frozen=True)
class Patience:
    """How long to wait for a server.

    Attributes:
        timeout: Seconds without a byte after which the connection counts as dead.
        attempts: Requests in a row without a new byte after which it is given up.
        first_wait: Seconds before the second attempt; doubled before each further one.
        longest_wait: Seconds that a server may ask to be left alone (Retry-After); more is an error.
    """

    timeout: float = 30.0
    attempts: int = 6
    first_wait: float = 1.0
    longest_wait: float = 300.0


class Retry(Exception):  # noqa: N818 - not an error yet
    """The request failed in a way that may pass.

    Attributes:
        after: Seconds that the server asks to wait; None: it did not say.
        offline: The server was never reached, so waiting long helps little.
    """

    def __init__(self, reason: str, after: float | None = None, *, offline: bool = False) -> None:
        super().__init__(reason)
        self.after = after
        self.offline = offline


@dataclass(frozen=True)
class Answer:
    """A file that a server has begun to send.

    Attributes:
        response: What to read from; the caller closes it.
        start: The position of its first byte in the file.
        validator: What tells this version of the file from another: the strong ETag, or else the date of its last
            change; empty: the server gives neither.
        total: Bytes of the whole file; None: the server does not say.
    """

    response: http.client.HTTPResponse
    start: int
    validator: str
    total: int | None


def ask(url: str, start: int, validator: str, patience: Patience) -> Answer:
    """Requests a file from a byte on.

    Args:
        url: http or https.
        start: How many bytes are there already; 0: all of it is wanted.
        validator: The version those bytes are of; another version is sent from its beginning (RFC 9110, 13.1.5).
        patience: Its timeout counts.

    Returns:
        The answer; its `start` is the one asked for or 0.

    Raises:
        ConfigError: The URL is none, or not of http or https.
        DownloadError: The file does not exist, is not given to everyone, or something else is sent.
        Retry: Anything that may pass.
    """
    try:
        response = urllib.request.urlopen(_request(url, start, validator), timeout=patience.timeout)
    except urllib.error.HTTPError as error:
        with error:
            if error.code == _RANGE_BEYOND_END and start:
                return ask(url, 0, "", patience)
            raise _refusal(url, error) from error
    except urllib.error.URLError as error:
        raise _unreachable(url, error.reason) from error
    except (OSError, http.client.HTTPException) as error:
        raise Retry(f"the connection broke ({_words(error)})") from error
    try:
        return _answer(url, response, start, validator, patience)
    except BaseException:
        response.close()
        raise


def body(answer: Answer, piece: int) -> Iterator[bytes]:
    """Yields what a server sends, as it comes, at most `piece` bytes at a time.

    Raises:
        Retry: The connection broke or stood still.
    """
    with answer.response as response:
        while True:
            try:
                data = response.read1(piece)
            except TimeoutError as error:
                raise Retry("the server stopped sending") from error
            except (OSError, http.client.HTTPException) as error:
                raise Retry(f"the connection broke ({_words(error)})") from error
            if not data:
                return
            yield data


def _request(url: str, start: int, validator: str) -> urllib.request.Request:
    try:
        parts = urllib.parse.urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname or parts.port == 0:
            raise ValueError
        request = urllib.request.Request(urllib.parse.quote(url, safe=_URL_CHARACTERS))
    except ValueError as error:
        raise ConfigError(f"{readable(url)!r} is not an http or https address; correct it") from error
    # Compressed on the way, a file would have other bytes and other positions.
    request.add_header("Accept-Encoding", "identity")
    # Some servers refuse Python's own name.
    request.add_header("User-Agent", f"everplace/{version('everplace')}")
    if start:
        request.add_header("Range", f"bytes={start}-")
        if validator:
            request.add_header("If-Range", validator)
    return request


def _answer(url: str, response: http.client.HTTPResponse, start: int, validator: str, patience: Patience) -> Answer:
    headers = response.headers
    page = headers.get_content_type() == "text/html"
    if page and not urllib.parse.urlsplit(url).path.endswith((".html", ".htm")):
        raise DownloadError(f"{url} gave a web page instead of a file; open it in a browser to see what it asks for")
    found = _validator(headers)
    if response.status == _PARTIAL:
        match = _CONTENT_RANGE.fullmatch(headers.get("Content-Range", "").strip())
        # Not every server heeds If-Range, so the version is compared here as well.
        if match is None or int(match[1]) != start or (validator and found and found != validator):
            response.close()
            if not start:
                raise Retry("the server sent a part that nobody asked for")
            return ask(url, 0, "", patience)
        return Answer(response, start, found or validator, None if match[2] == "*" else int(match[2]))
    length = headers.get("Content-Length", "")
    return Answer(response, 0, found, int(length) if length.isascii() and length.isdigit() else None)


def _validator(headers: Message) -> str:
    """Returns the strong ETag, or else the date of the last change; weak ETags do not promise equal bytes."""
    etag: str = headers.get("ETag", "")
    return etag if etag.startswith('"') else headers.get("Last-Modified", "")


def _refusal(url: str, error: urllib.error.HTTPError) -> Exception:
    """Says what an HTTP status means, for the user or for the next attempt."""
    if error.code in _TRY_AGAIN:
        return Retry(f"the server {_TRY_AGAIN[error.code]} (HTTP {error.code})", _retry_after(error.headers))
    if error.code in _GONE:
        return DownloadError(f"{url} does not exist (HTTP {error.code}); check the address, or look for where it moved")
    if error.code in _LOGIN:
        return DownloadError(
            f"{url} is not given to everyone (HTTP {error.code}); fetch it in a browser, where one can log in"
        )
    return DownloadError(f"{url} cannot be fetched (HTTP {error.code} {error.reason}); check the address")


def _retry_after(headers: Message) -> float | None:
    """Reads Retry-After, a number of seconds or a date (RFC 9110, 10.2.3)."""
    text = headers.get("Retry-After", "").strip()
    if text.isascii() and text.isdigit():
        return float(text[:12])
    try:
        return max(0.0, parsedate_to_datetime(text).timestamp() - time.time())
    except (ValueError, TypeError, OverflowError):
        return None


def _unreachable(url: str, reason: object) -> Exception:
    host = urllib.parse.urlsplit(url).hostname
    if isinstance(reason, ssl.SSLCertVerificationError):
        return DownloadError(
            f"{host} does not prove who it is ({reason.verify_message}); check this machine's clock and certificates"
        )
    if isinstance(reason, TimeoutError):
        return Retry(f"{host} does not answer")
    offline = isinstance(reason, ConnectionRefusedError) or not isinstance(reason, ConnectionError)
    return Retry(f"{host} cannot be reached ({_words(reason)})", offline=offline)


def _words(reason: object) -> str:
    return (reason.strerror if isinstance(reason, OSError) else None) or str(reason) or type(reason).__name__
