"""The service without its protocol: the newest version of a map, and answers from it."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ImageError, MissingExtraError
from everplace.images.decoding import BROKEN_IMAGE_ERRORS, ImageSpec, decode_encoded
from everplace.images.formats import image_size
from everplace.mapping.localizer import Localizer
from everplace.mapping.map_answer import Observation
from everplace.serve.drive_sessions import DriveSessions
from everplace.serve.map_summary import binned_most, places_per_bin
from everplace.serve.newest_map import NewestMap
from everplace.serve.refusal import RefusedError
from everplace.serve.service_limits import ServiceLimits
from everplace.serve.work_queue import WorkQueue

__all__ = ["LocateRequest", "MapService"]

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
        self.limits = limits
        self.map = NewestMap(address, limits)
        self.sessions = DriveSessions(limits)
        self.work = WorkQueue("locate", limits.waiting, prepare=_compute_alone)
        self._reads = WorkQueue("read", _READS_WAITING, _READERS)

    async def locate(self, request: LocateRequest) -> dict[str, Any]:
        """The answer to a frame, as JSON.

        Raises:
            RefusedError: It is no image, or too large, or there is too much to do.
        """
        loaded = await self.map.current()
        if not request.session:
            return await self.work.run(lambda: self._located(loaded.localizer.another(1), loaded.version, request))
        session = self.sessions.take(request.session, loaded.localizer, loaded.version)
        with self.sessions.entered(session):
            work = partial(self._located, session.localizer, session.version, request)
            return await self.work.run(work, session.turn)

    async def translate(self, image: bytes, condition: str) -> bytes:
        """A query shown in a condition, as a PNG file; refusals as `locate` and `QueryTranslation.png`."""
        loaded = await self.map.current()
        return await self.work.run(lambda: loaded.translation.png(self._decoded(image), condition))

    async def read(self, work: Callable[[], T]) -> T:
        """Runs what reads the map, beside the work on frames.

        Raises:
            RefusedError: Too many read.
        """
        return await self._reads.run(work)

    def close(self) -> None:
        """Ends the threads."""
        for queue in (self.work, self._reads):
            queue.close()

    def _located(self, localizer: Localizer, version: int, request: LocateRequest) -> dict[str, Any]:
        seen = localizer.observe(self._decoded(request.image), request.time, matches=request.matches)
        return _as_json(version, request, seen)

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
