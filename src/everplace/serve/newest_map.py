"""The newest version of a map, read beside the work on frames."""

from __future__ import annotations

import asyncio
import os
import sys
import threading
import time
from contextlib import suppress

from everplace.mapping.route_map import Map
from everplace.serve.loaded_map import LoadedMap
from everplace.serve.service_limits import ServiceLimits

__all__ = ["NewestMap"]


class NewestMap:
    """A map that may grow, be replaced, or go away.

    Attributes:
        loaded: The version that answers.
    """

    def __init__(self, address: str | os.PathLike[str], limits: ServiceLimits) -> None:
        """Reads the map.

        Args:
            address: Of the map.
            limits: How often to look, and how long a client may wait for it.

        Raises:
            MapError: There is none, it is damaged, or it was made with what is not here.
        """
        self._address, self._limits = address, limits
        self._map = Map.open(address)
        self.loaded = LoadedMap(self._map)
        self._looked = time.monotonic()
        self._looking = False
        self._complaint = ""

    async def current(self) -> LoadedMap:
        """The newest version that is read; where a look for a newer one is due, that begins.

        Whoever finds it to be due waits for it, but not long: a large map takes a minute to read, and the version
        before it answers meanwhile.
        """
        if not self._looking and time.monotonic() - self._looked >= self._limits.look_seconds:
            self._looking = True
            loop, ended = asyncio.get_running_loop(), asyncio.Event()

            def look() -> None:
                self._look()
                with suppress(RuntimeError):  # the service has ended meanwhile
                    loop.call_soon_threadsafe(ended.set)

            # A daemon: the service ends without waiting for a map to be read.
            threading.Thread(target=look, name="look", daemon=True).start()
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(ended.wait(), self._limits.look_wait_seconds)
        return self.loaded

    def _look(self) -> None:
        """Takes the newest version of the map, if it is another; where that fails, the old one stays."""
        try:
            if not self._map.is_newest():
                self._map = Map.open(self._address)
                self.loaded = LoadedMap(self._map)
            self._complaint = ""
        except Exception as error:  # whatever it is, the map that was read goes on answering
            if str(error) != self._complaint:  # once, not every second
                print(f"everplace: version {self.loaded.version} goes on answering: {error}", file=sys.stderr)
            self._complaint = str(error)
        finally:
            self._looked = time.monotonic()
            self._looking = False
