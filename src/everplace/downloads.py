"""Downloading files: resumed where they broke off, checked, and whole by rename.

What has come so far lies beside the target in `.NAME.download`; `.NAME.download.version` says of which version of
which address it is the beginning, so that the rest is only taken from that one.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import time
import urllib.parse
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import requests
from requests.exceptions import InvalidSchema, InvalidURL, MissingSchema
from urllib3.exceptions import HTTPError as BrokenBody

from everplace.errors import ConfigError, DownloadError, StorageError
from everplace.files import readable
from everplace.locking import waiting_turn
from everplace.progress import Progress, quiet

__all__ = ["fetch", "sha256_of"]

_PIECE = 2**16
_TIMEOUT = 30.0
"""Seconds without a byte after which a connection counts as dead."""
_ATTEMPTS = 4
"""Requests in a row without a new byte after which a server is given up."""
_FIRST_WAIT = 1.0
"""Seconds before the second attempt; doubled before each further one."""
_PARTIAL = frozenset({206, 416})
"""Statuses of a server that sends a part of a file, or cannot, as the file ends before it."""
_PASSING = frozenset({408, 425, 429, 500, 502, 503, 504})
"""Statuses of a server that may do better at the next attempt."""


def fetch(
    url: str,
    sha256: str | None,
    target: Path,
    progress: Progress = quiet,
    *,
    known: str = "is published",
) -> Path:
    """Downloads one file, or keeps the one that is there if it is the wanted one.

    A download that was broken off, even by a kill, goes on where it stands; a file that changed at its source in
    between is begun afresh. Two processes that want the same target take turns, and the second finds it there.

    Args:
        url: http or https.
        sha256: The hash it must have, 64 hexadecimal digits; None: only its length is checked.
        target: The file to create; its directory is made if missing. A file there of another hash is replaced.
        progress: Told of the pieces that have come.
        known: Where the hash is from, to end the sentence "... where HASH".

    Returns:
        `target`.

    Raises:
        ConfigError: The URL is none, or not of http or https.
        DownloadError: There is no such file, no way to the server, it gave up, or it gave something else.
        StorageError: The file cannot be written. What has come so far is kept for the next call.
    """
    part = target.with_name(f".{target.name}.download")
    with _told_in_one_sentence(url, target), waiting_turn(target):
        if target.is_file() and (sha256 is None or sha256_of(target) == sha256.lower()):
            return target
        _receive(url, part, progress, f"fetching {readable(target.name)}")
        if sha256 is not None and (found := sha256_of(part)) != sha256.lower():
            part.unlink()
            _version_file(part).unlink()
            raise DownloadError(
                f"{url} has the SHA-256 {found} where {sha256.lower()} {known}; it changed at its source or on the "
                "way, so it is not kept"
            )
        part.replace(target)
        _version_file(part).unlink()
    return target


def sha256_of(path: Path) -> str:
    """Returns the hash of a file's content as 64 hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(2**20):
            digest.update(piece)
    return digest.hexdigest()


@contextlib.contextmanager
def _told_in_one_sentence(url: str, target: Path) -> Iterator[None]:
    """Turns what keeps a file from being fetched into an error of ours."""
    try:
        yield
    except (InvalidSchema, InvalidURL, MissingSchema) as error:
        raise ConfigError(f"{readable(url)!r} is not an http or https address; correct it") from error
    except (requests.RequestException, BrokenBody) as error:
        raise _not_fetched(url, error) from error
    except OSError as error:
        raise StorageError(
            f"cannot write {readable(target)}: {error.strerror or error}; free space or choose another place"
        ) from error


def _not_fetched(url: str, error: BaseException) -> DownloadError:
    """Says why, from a library's error: the status that a server answered, or what broke the connection at first."""
    status = _status(error)
    if status in (404, 410):
        return DownloadError(f"{url} does not exist (HTTP {status}); check the address, or look for where it moved")
    if status in (401, 403, 407):
        return DownloadError(
            f"{url} is not given to everyone (HTTP {status}); fetch it in a browser, where one can log in"
        )
    if status in _PASSING:
        return DownloadError(
            f"cannot fetch {url}: the server is overloaded or fails (HTTP {status}); run it again later, it goes on "
            "where it stopped"
        )
    if status is not None:
        return DownloadError(f"{url} cannot be fetched (HTTP {status}); check the address")
    while error.__context__ is not None:  # libraries wrap it several times
        error = error.__context__
    reason = (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
    return DownloadError(
        f"cannot fetch {url}: {reason}; check the network and run it again, it goes on where it stopped"
    )


def _status(error: BaseException) -> int | None:
    return getattr(getattr(error, "response", None), "status_code", None)


def _receive(url: str, part: Path, progress: Progress, what: str) -> None:
    """Asks until all bytes have come, or too often in a row for nothing."""
    failures = 0
    while True:
        before = _size(part)
        try:
            _receive_rest(url, part, progress, what)
            return
        except (requests.HTTPError, requests.ConnectionError, requests.Timeout, BrokenBody) as error:
            failures = 1 if _size(part) > before else failures + 1
            if failures == _ATTEMPTS or _status(error) not in (None, *_PASSING):
                raise
        time.sleep(_FIRST_WAIT * 2 ** (failures - 1))


def _receive_rest(url: str, part: Path, progress: Progress, what: str) -> None:
    """Asks once for what is missing of a file, and adds what comes to what is there."""
    note = _version_file(part)
    address, _, tag = note.read_text("utf-8", "replace").partition("\n") if note.exists() else ("", "", "")
    start = _size(part) if address == url and tag else 0
    # Compressed on the way, a file would have other bytes and other positions; some servers refuse Python's own name.
    headers = {"Accept-Encoding": "identity", "User-Agent": f"everplace/{version('everplace')}"}
    if start:  # another version than that of the tag is sent from its beginning (RFC 9110, 13.1.5)
        headers |= {"Range": f"bytes={start}-", "If-Range": tag}
    with requests.get(url, headers=headers, stream=True, timeout=_TIMEOUT) as answer:
        found, sent = _tag(answer), answer.headers.get("Content-Range", "")
        if start and sent == f"bytes */{start}":
            return  # a kill came between the last byte and the rename
        # Not every server heeds If-Range, so the version is compared here as well.
        continues = start > 0 and sent.startswith(f"bytes {start}-") and found in ("", tag)
        if answer.status_code in _PARTIAL and not continues:
            if not start:
                raise requests.ConnectionError("the server sent a part that nobody asked for")
            note.unlink()
            _receive_rest(url, part, progress, what)
            return
        answer.raise_for_status()
        path = urllib.parse.urlsplit(url).path
        if answer.headers.get("Content-Type", "").startswith("text/html") and not path.endswith((".html", ".htm")):
            raise DownloadError(
                f"{url} gave a web page instead of a file; open it in a browser to see what it asks for"
            )
        length = answer.headers.get("Content-Length", "")
        with part.open("ab" if continues else "wb") as file:
            if not continues:  # once the bytes of another version are gone
                note.write_text(f"{url}\n{found}", "utf-8")
            pieces = answer.raw.stream(_PIECE, decode_content=False)
            for piece in progress(pieces, what, -(-int(length) // _PIECE) if length.isdecimal() else None):
                file.write(piece)
            file.flush()
            os.fsync(file.fileno())


def _tag(answer: requests.Response) -> str:
    """Returns the strong ETag, or else the date of the last change; weak ETags do not promise equal bytes."""
    etag = answer.headers.get("ETag", "")
    return etag if etag.startswith('"') else answer.headers.get("Last-Modified", "")


def _version_file(part: Path) -> Path:
    return part.with_name(f"{part.name}.version")


def _size(part: Path) -> int:
    return part.stat().st_size if part.exists() else 0
