"""Drives that are answered frame by frame: whoever names a session has a filter of their own."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from everplace.mapping.frame_window import SEQUENCE
from everplace.mapping.localizer import Localizer
from everplace.serve.refusal import too_busy
from everplace.serve.service_limits import ServiceLimits

__all__ = ["DriveSession", "DriveSessions"]

_BYTES_A_PLACE = 96 * SEQUENCE
"""Of each view: its scores, what they say, three beliefs, and as many again where the drive stands."""


@dataclass(eq=False)
class DriveSession:
    """One drive.

    Attributes:
        localizer: Knows its last frames.
        map: The localizer of the map that it answers from.
        version: Of that map.
        used: When it was last asked for, by the clock of `DriveSessions`.
        waiting: Frames of it that wait for their answers.
        turn: Held while a frame is answered, as the next one rests on it.
    """

    localizer: Localizer
    map: Localizer
    version: int
    used: float
    waiting: int = 0
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)


class DriveSessions:
    """The drives by their names; the least recently used one goes where there would be too many."""

    def __init__(self, limits: ServiceLimits, clock: Callable[[], float] = time.monotonic) -> None:
        """Begins with none.

        Args:
            limits: How many there may be, and for how long.
            clock: In seconds.
        """
        self._limits, self._clock = limits, clock
        self._sessions: OrderedDict[str, DriveSession] = OrderedDict()

    def __len__(self) -> int:
        """Returns how many live."""
        self._forget_idle()
        return len(self._sessions)

    def take(self, name: str, localizer: Localizer, version: int) -> DriveSession:
        """The drive of a name; it begins anew where there is none, or where the map has become another.

        Args:
            name: Of the session.
            localizer: Of the map as it is now.
            version: Of that map.
        """
        self._forget_idle()
        found = self._sessions.pop(name, None)
        if found is None or found.map is not localizer:
            self._forget_other(localizer)
            found = DriveSession(localizer.another(SEQUENCE), localizer, version, 0.0)
        found.used = self._clock()
        self._sessions[name] = found
        fit = self._limits.session_bytes // (_BYTES_A_PLACE * len(localizer.places))
        while len(self._sessions) > max(min(self._limits.sessions, fit), 1):
            self._sessions.popitem(last=False)
        return found

    @contextmanager
    def entered(self, session: DriveSession) -> Iterator[None]:
        """A frame of a drive, which waits for its answer.

        Raises:
            RefusedError: Too many frames of this drive wait.
        """
        if session.waiting >= self._limits.session_waiting:
            raise too_busy()
        session.waiting += 1
        try:
            yield
        finally:
            session.waiting -= 1

    def end(self, name: str) -> bool:
        """Forgets a drive; says whether there was one."""
        return self._sessions.pop(name, None) is not None

    def _forget_other(self, localizer: Localizer) -> None:
        """Lets go of drives on what the map was before, of which each session keeps one in memory."""
        for name in [name for name, session in self._sessions.items() if session.map is not localizer]:
            del self._sessions[name]

    def _forget_idle(self) -> None:
        oldest = self._clock() - self._limits.session_seconds
        while self._sessions and next(iter(self._sessions.values())).used < oldest:
            self._sessions.popitem(last=False)
