"""Drives that are answered frame by frame: whoever names a session has a filter of their own."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

from everplace.mapping.frame_window import SEQUENCE
from everplace.mapping.localizer import Localizer
from everplace.serve.service_limits import ServiceLimits

__all__ = ["DriveSession", "DriveSessions"]

_BYTES_A_PLACE = 96 * SEQUENCE
"""Of each view: its scores, what they say, three beliefs, and as many again where the drive stands."""


@dataclass(eq=False)
class DriveSession:
    """One drive.

    Attributes:
        localizer: Knows its last frames.
        version: Of the map that it answers from.
        used: When it was last asked for, by the clock of `DriveSessions`.
        lock: Held while a frame is answered, as the next one rests on it.
    """

    localizer: Localizer
    version: int
    used: float
    lock: threading.Lock = field(default_factory=threading.Lock)


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
        self._lock = threading.Lock()

    def __len__(self) -> int:
        """Returns how many live."""
        with self._lock:
            self._forget_idle()
            return len(self._sessions)

    def take(self, name: str, localizer: Localizer, version: int) -> DriveSession:
        """The drive of a name; it begins anew where there is none, or where the map has a newer version.

        Args:
            name: Of the session.
            localizer: Of the map as it is now.
            version: Of that map.
        """
        with self._lock:
            self._forget_idle()
            found = self._sessions.pop(name, None)
            if found is None or found.version < version:
                self._forget_before(version)
                found = DriveSession(localizer.another(SEQUENCE), version, 0.0)
            found.used = self._clock()
            self._sessions[name] = found
            fit = self._limits.session_bytes // (_BYTES_A_PLACE * len(localizer.places))
            while len(self._sessions) > max(min(self._limits.sessions, fit), 1):
                self._sessions.popitem(last=False)
            return found

    def end(self, name: str) -> bool:
        """Forgets a drive; says whether there was one."""
        with self._lock:
            return self._sessions.pop(name, None) is not None

    def _forget_before(self, version: int) -> None:
        """Lets go of earlier versions of the map, of which each session keeps one in memory."""
        for name in [name for name, session in self._sessions.items() if session.version < version]:
            del self._sessions[name]

    def _forget_idle(self) -> None:
        oldest = self._clock() - self._limits.session_seconds
        while self._sessions and next(iter(self._sessions.values())).used < oldest:
            self._sessions.popitem(last=False)
