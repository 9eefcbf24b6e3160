"""Getting files: again and again until each is whole and the one that was wanted."""

from __future__ import annotations

import hashlib
import queue
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from everplace.downloads.partial import About, Partial, partial_file
from everplace.downloads.server import Patience, Retry, ask, body
from everplace.errors import DownloadError
from everplace.files import readable
from everplace.progress import Progress, quiet

__all__ = ["Download", "fetch", "fetch_all", "sha256_of"]

_PIECE = 2**20
_ATTEMPTS_OFFLINE = 2
_ENDED = object()


@dataclass(frozen=True)
class Download:
    """One file to fetch.

    Attributes:
        url: http or https.
        target: Where it goes.
        sha256: Its published hash, 64 hexadecimal digits; None: none is published.
        size: Its published size in bytes; None: not known.
        known: Where hash and size are from, to end the sentence "... where HASH".
    """

    url: str
    target: Path
    sha256: str | None = None
    size: int | None = None
    known: str = "is published"


def fetch(
    url: str,
    sha256: str | None,
    target: Path,
    progress: Progress = quiet,
    *,
    size: int | None = None,
    patience: Patience | None = None,
) -> Path:
    """Downloads one file, or keeps the one that is there if it is the wanted one.

    A download that was broken off, even by a kill, goes on where it stands; a file that changed at its source in
    between is begun afresh. Two processes that want the same target take turns, and the second finds it there.

    Args:
        url: http or https.
        sha256: The hash it must have, 64 hexadecimal digits; None: only its length is checked.
        target: The file to create; its directory is made if missing. A file there of another hash or size is
            replaced.
        progress: Told of the mebibytes that have come.
        size: The size it must have, in bytes; None: what the server says.
        patience: How long to wait for the server; None: the defaults.

    Returns:
        `target`.

    Raises:
        ConfigError: The URL is none, or not of http or https.
        DownloadError: There is no such file, no way to the server, it gave up, or it gave something else.
        StorageError: The file cannot be written. What has come so far is kept for the next call.
    """
    steps = _steps(Download(url, target, sha256, size), patience or Patience(), threading.Event())
    total = next(steps, None)
    for _ in progress(steps, f"fetching {readable(target.name)}", total):
        pass
    return target


def fetch_all(
    downloads: Sequence[Download],
    progress: Progress = quiet,
    *,
    parallel: int = 4,
    patience: Patience | None = None,
) -> tuple[Path, ...]:
    """Downloads several files as `fetch` does, some at the same time.

    Args:
        downloads: Files with different targets.
        progress: Told of the mebibytes that have come, of all files together.
        parallel: Files at the same time, at least 1.
        patience: How long to wait for the servers; None: the defaults.

    Returns:
        The targets, in order.

    Raises:
        ConfigError: As `fetch`, for the first file that failed; those under way are broken off, and go on where they
            stand at the next call.
        DownloadError: Likewise.
        StorageError: Likewise.
    """
    sizes = [download.size for download in downloads if download.size is not None]
    total = sum(_pieces(size) for size in sizes) if len(sizes) == len(downloads) else None
    steps = _steps_of_all(downloads, max(1, min(parallel, len(downloads))), patience or Patience())
    for _ in progress(steps, f"fetching {len(downloads)} files", total):
        pass
    return tuple(download.target for download in downloads)


def sha256_of(path: Path) -> str:
    """Returns the hash of a file's content as 64 hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(_PIECE):
            digest.update(piece)
    return digest.hexdigest()


def _steps_of_all(downloads: Sequence[Download], threads: int, patience: Patience) -> Iterator[object]:
    """Lets threads download, and yields once for each piece; raises what the first failure raised."""
    waiting: queue.SimpleQueue[Download] = queue.SimpleQueue()
    for download in downloads:
        waiting.put(download)
    news: queue.SimpleQueue[object] = queue.SimpleQueue()
    stop = threading.Event()

    def work() -> None:
        try:
            while not stop.is_set():
                steps = _steps(waiting.get_nowait(), patience, stop)
                next(steps, None)
                for step in steps:
                    news.put(step)
        except queue.Empty:
            pass
        except BaseException as error:  # handed to the one who waits
            news.put(error)
        news.put(_ENDED)

    # Daemons: after Ctrl-C nobody waits for a server that does not answer, and what they leave can be resumed.
    for number in range(threads):
        threading.Thread(target=work, name=f"fetch-{number}", daemon=True).start()
    try:
        ended = 0
        while ended < threads:
            heard = news.get()
            if isinstance(heard, BaseException):
                raise heard
            if heard is _ENDED:
                ended += 1
            else:
                yield heard
    finally:
        stop.set()


def _steps(download: Download, patience: Patience, stop: threading.Event) -> Iterator[int | None]:
    """Downloads one file, unless it is there.

    Yields:
        First how many pieces there are, None if that is not known; then once for each piece that has come.
    """
    if _is_there(download):
        return
    with partial_file(download.target) as partial:
        if _is_there(download):  # another process was faster
            partial.drop()
        else:
            yield from _Transfer(download, partial, patience, stop).steps()


class _Transfer:
    """One file on its way."""

    def __init__(self, download: Download, partial: Partial, patience: Patience, stop: threading.Event) -> None:
        self.download = download
        self.partial = partial
        self.patience = patience
        self.stop = stop
        self.joined = False

    def steps(self) -> Iterator[int | None]:
        """Downloads the file; yields as `_steps` does."""
        if self.partial.about.url != self.download.url:
            self.partial.restart(About(self.download.url))
        shown: int | None = None
        while True:
            for _ in self._receive():
                if shown is None:
                    total = self.partial.about.total
                    yield None if total is None else _pieces(total)
                    shown = 0
                while shown < self.partial.size // _PIECE:
                    shown += 1
                    yield shown
            if self.stop.is_set():
                return
            problem = self._problem()
            if problem is None:
                break
            self.partial.restart(About(self.download.url))
            if not self.joined:
                self.partial.drop()
                raise DownloadError(problem)
            # What was joined may have been of two versions; in one go it cannot be.
            self.joined = False
        yield from range(shown or 0, _pieces(self.partial.size))
        self.partial.finish()

    def _receive(self) -> Iterator[None]:
        """Asks until all bytes have come or `stop` is set; yields when it knows the length, and at every arrival."""
        self.joined = self.partial.size == self.partial.about.total
        failures = 0
        while (before := self.partial.size) != self.partial.about.total:
            try:
                yield from self._receive_once()
            except Retry as failure:
                came = before < self.partial.size < (self.partial.about.total or float("inf"))
                failures = 1 if came else failures + 1
                self._wait(failure, failures)
            if self.stop.is_set():
                return
        yield

    def _receive_once(self) -> Iterator[None]:
        """Asks for what is missing and takes what comes.

        Raises:
            Retry: Not all of it came.
        """
        partial, url = self.partial, self.download.url
        # Without a means to tell versions apart, nothing can be added to what is there.
        start = partial.size if partial.about.validator or self.download.sha256 else 0
        answer = ask(url, start, partial.about.validator, self.patience)
        if answer.start and answer.total != partial.about.total:
            answer.response.close()
            answer = ask(url, 0, "", self.patience)
        if answer.start:
            self.joined = True
        else:
            partial.restart(About(url, answer.validator, answer.total))
            self.joined = False
        yield
        for data in body(answer, _PIECE):
            partial.append(data)
            yield
            if self.stop.is_set():
                return
        if answer.total is None:
            partial.about = About(url, answer.validator, partial.size)
        elif partial.size != answer.total:
            raise Retry(f"the connection ended after {partial.size} of {answer.total} bytes")

    def _wait(self, failure: Retry, failures: int) -> None:
        """Waits before the next attempt, or gives up."""
        patience, url = self.patience, self.download.url
        offline = failure.offline and not self.partial.size
        if failures >= (min(_ATTEMPTS_OFFLINE, patience.attempts) if offline else patience.attempts):
            raise DownloadError(
                f"cannot fetch {url}: {failure}; check the network and run it again, it goes on where it stopped"
            ) from failure
        seconds = patience.first_wait * 2 ** (failures - 1) if failure.after is None else failure.after
        if seconds > patience.longest_wait:
            raise DownloadError(
                f"cannot fetch {url}: {failure} and wants to be left alone for {seconds:.0f} seconds; run it again then"
            ) from failure
        self.stop.wait(seconds)

    def _problem(self) -> str | None:
        """Says in what the whole file differs from the wanted one, or None."""
        wanted, size = self.download, self.partial.size
        end = f"{wanted.known}; it changed at its source or on the way, so it is not kept"
        if wanted.size is not None and size != wanted.size:
            return f"{wanted.url} has {size} bytes where a size of {wanted.size} {end}"
        if wanted.sha256 is not None and (found := sha256_of(self.partial.path)) != wanted.sha256.lower():
            return f"{wanted.url} has the SHA-256 {found} where {wanted.sha256.lower()} {end}"
        return None


def _is_there(download: Download) -> bool:
    """Says whether the target is the wanted file already."""
    path = download.target
    if not path.is_file() or (download.size is not None and path.stat().st_size != download.size):
        return False
    return download.sha256 is None or sha256_of(path) == download.sha256.lower()


def _pieces(size: int) -> int:
    return -(-size // _PIECE)
