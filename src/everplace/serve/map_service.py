"""The service without its protocol: the newest version of a map, and answers from it."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ImageError, MissingExtraError
from everplace.images.decoding import BROKEN_IMAGE_ERRORS, ImageSpec, decode_encoded
from everplace.images.formats import image_size
from everplace.mapping.localizer import Localizer
from everplace.mapping.map_answer import Observation
from everplace.mapping.route_map import Map
from everplace.mapping.thumbnails import Thumbnails
from everplace.serve.drive_sessions import DriveSessions
from everplace.serve.map_summary import binned_most, map_summary, places_per_bin
from everplace.serve.query_translation import QueryTranslation
from everplace.serve.refusal import RefusedError
from everplace.serve.service_limits import ServiceLimits
from everplace.serve.work_queue import WorkQueue

__all__ = ["LoadedMap", "LocateRequest", "MapService"]

T = TypeVar("T")
_READERS = 2
_READS_WAITING = 256


@dataclass(frozen=True)
class LocateRequest:
    """What is asked of a frame.

    Attributes:
        image: The image file.
        frame: Its name, given back.
        session: Name of the drive that it belongs to; empty: of none.
        time: Seconds; given back.
        matches: How many places to name.
        details: Whether to say what the answer rests on.
    """

    image: bytes
    frame: str
    session: str = ""
    time: float | None = None
    matches: int = 0
    details: bool = False


class LoadedMap:
    """One version of the map with all that answers rest on; nothing of it changes.

    Attributes:
        version: Its number.
        tag: Tells it from other versions and other maps.
        localizer: Whose copies answer.
        thumbnails: Of its frames.
        translation: Shows queries in other conditions.
        summary: The JSON of `GET /map`.
    """

    def __init__(self, map_: Map) -> None:
        """Reads the map; errors as `Localizer`."""
        self.version = map_.version
        self.tag = f"{map_.version}-{map_.created}"
        self.localizer = Localizer(map_)
        self.thumbnails: Thumbnails = map_.thumbnails()
        self.translation = QueryTranslation(map_, self.thumbnails)
        summary = map_summary(map_, self.localizer.places, decodes=self.translation.possible)
        self.summary = json.dumps(summary, allow_nan=False).encode()
        self._frames = map_.frames("stem", "place", "x", "y", "heading")
        self._condition = {drive["name"]: drive["condition"] for drive in map_.document["drives"]}

    def frame(self, row: int) -> dict[str, Any]:
        """What is known of a frame.

        Raises:
            RefusedError: There is none of this number.
        """
        self._require(row)
        known = {name: column[0] for name, column in self._frames.slice(row, 1).to_pydict().items()}
        pose = [known["x"], known["y"], known["heading"]]
        return {
            "id": row,
            "drive": known["drive"],
            "condition": self._condition[known["drive"]],
            "frame": known["stem"],
            "place": known["place"] if known["place"] >= 0 else None,
            "pose": None if np.isnan(pose).any() else pose,
        }

    def thumbnail(self, row: int) -> bytes:
        """The JPEG file of a frame.

        Raises:
            RefusedError: There is none of this number.
            MapError: The map was removed or damaged meanwhile.
        """
        self._require(row)
        return self.thumbnails.read(row)

    def _require(self, row: int) -> None:
        if not 0 <= row < len(self.thumbnails):
            raise RefusedError(404, f"the map has no frame of this number; it has 0 to {len(self.thumbnails) - 1}")


class MapService:
    """Answers from the newest version of a map, which may grow meanwhile."""

    def __init__(self, address: str | os.PathLike[str], limits: ServiceLimits) -> None:
        """Reads the map.

        Args:
            address: Of the map.
            limits: What is taken on.

        Raises:
            MapError: There is none, it is damaged, or it was made with what is not here.
        """
        self._address, self.limits = address, limits
        self._map = Map.open(address)
        self.loaded = LoadedMap(self._map)
        self.sessions = DriveSessions(limits)
        self.work = WorkQueue("locate", limits.waiting, prepare=_compute_alone)
        self._reads = WorkQueue("read", _READS_WAITING, _READERS)
        self._keeper = WorkQueue("look", 0, 1)
        self._looked = time.monotonic()
        self._complaint = ""

    async def current(self) -> LoadedMap:
        """The newest version, looked for once a second at most.

        Whoever finds it to be due waits for the look, and for the new version to be read; others get what there is.
        """
        if self._keeper.under_way == 0 and time.monotonic() - self._looked >= self.limits.look_seconds:
            await self._keeper.run(self._look)
        return self.loaded

    async def locate(self, request: LocateRequest) -> dict[str, Any]:
        """The answer to a frame, as JSON.

        Raises:
            RefusedError: It is no image, or too large, or there is too much to do.
        """
        loaded = await self.current()
        return await self.work.run(lambda: self._located(loaded, request))

    async def translate(self, image: bytes, condition: str) -> bytes:
        """A query shown in a condition, as a PNG file; refusals as `locate` and `QueryTranslation.png`."""
        loaded = await self.current()
        return await self.work.run(lambda: loaded.translation.png(self._decoded(image), condition))

    async def read(self, work: Callable[[], T]) -> T:
        """Runs what reads the map, beside the work on frames.

        Raises:
            RefusedError: Too many read.
        """
        return await self._reads.run(work)

    def close(self) -> None:
        """Ends the threads."""
        for queue in (self.work, self._reads, self._keeper):
            queue.close()

    def _look(self) -> None:
        """Takes the newest version of the map, if it is another; where that fails, the old one stays."""
        try:
            if self._map.newest_version() != self.loaded.version:
                self._map = Map.open(self._address)
                self.loaded = LoadedMap(self._map)
            self._complaint = ""
        except Exception as error:  # whatever it is, the map that was read goes on answering
            if str(error) != self._complaint:  # once, not every second
                print(f"everplace: version {self.loaded.version} goes on answering: {error}", file=sys.stderr)
            self._complaint = str(error)
        finally:
            self._looked = time.monotonic()

    def _located(self, loaded: LoadedMap, request: LocateRequest) -> dict[str, Any]:
        image = self._decoded(request.image)
        if request.session:
            session = self.sessions.take(request.session, loaded.localizer, loaded.version)
            with session.lock:
                seen = session.localizer.observe(image, request.time, matches=request.matches)
            return _as_json(session.version, request, seen)
        seen = loaded.localizer.another(1).observe(image, request.time, matches=request.matches)
        return _as_json(loaded.version, request, seen)

    def _decoded(self, data: bytes) -> NDArray[np.uint8]:
        """H×W×3 RGB of an image file from a stranger."""
        try:
            height, width = image_size("the image", data)
            if height * width > self.limits.pixels:
                raise RefusedError(
                    413, f"the image has more than {self.limits.pixels} pixels, the limit here; send it smaller"
                )
            return decode_encoded("the image", data, ImageSpec())
        except MissingExtraError:
            raise RefusedError(400, "images of this format are not read here; send PNG or JPEG") from None
        except (ImageError, *BROKEN_IMAGE_ERRORS):
            raise RefusedError(400, "the image is empty, broken or of an unknown kind; send PNG or JPEG") from None


def _compute_alone() -> None:
    """Has torch compute in the calling thread alone: the service's threads are as many as the cores."""
    import torch

    torch.set_num_threads(1)


def _as_json(version: int, request: LocateRequest, seen: Observation) -> dict[str, Any]:
    answer: dict[str, Any] = {"frame": request.frame, **seen.answer.to_dict(), "version": version}
    if request.matches:
        answer["matches"] = [asdict(match) for match in seen.matches]
    if request.details:
        answer["belief"] = binned_most(seen.belief)
        answer["similarity"] = binned_most(seen.similarity)
        answer["places_per_bin"] = places_per_bin(len(seen.belief))
    return answer
