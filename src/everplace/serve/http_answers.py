"""The shapes of the service's JSON, as `/openapi.json` tells them."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict

__all__ = ["Failure", "FrameInfo", "Health", "LocatedImage", "MapOverview"]


class Failure(BaseModel):
    """Why there is no answer, in one sentence."""

    detail: str


class Health(BaseModel):
    """The service answers, from this version of the map."""

    status: str
    version: int


class NamedPlace(BaseModel):
    """A place that the frame may show; `id` is that of `/frames/{id}`."""

    id: int
    drive: str
    condition: str
    database_frame: str
    place: int
    score: float
    probability: float
    pose: list[float] | None


class LocatedImage(BaseModel):
    """Where a frame was taken; `matches`, `belief`, `similarity` and `places_per_bin` where they were asked for."""

    frame: str
    time: float | None
    place: int
    drive: str
    database_frame: str
    score: float
    probability: float
    off_map: float
    condition: dict[str, float]
    unseen_condition: bool
    pose: list[float] | None
    provisional: bool
    version: int
    matches: list[NamedPlace] = []
    belief: list[float] = []
    similarity: list[float] = []
    places_per_bin: int = 1


class FrameInfo(BaseModel):
    """A frame of the map; `place` is null where nothing tells it."""

    id: int
    drive: str
    condition: str
    frame: str
    place: int | None
    pose: list[float] | None


class ConditionTable(BaseModel):
    """Frames of each bin of places under each condition."""

    conditions: list[str]
    drives: list[dict[str, str]]
    cells: list[list[int]]
    places_per_bin: int


class PrecisionRow(BaseModel):
    """Held-out answers of at least this probability: which share is right, and of all frames on the map is found."""

    threshold: float
    precision: float
    recall: float


class MapOverview(BaseModel):
    """A map as `everplace map info --json` tells it, and what a page shows of it."""

    model_config = ConfigDict(extra="allow")

    drives: list[dict[str, Any]]
    places: int
    conditions: dict[str, int]
    method: str
    dimension: int
    calibration: dict[str, Any]
    bytes: int | None
    version: int
    provisional: bool
    places_per_bin: int
    table: ConditionTable
    poses: list[list[float] | None] | None
    frames: dict[str, list[int]]
    stems: dict[str, list[str]]
    order: dict[str, list[int | None]]
    place_order: list[int]
    learned: dict[str, Any]
    decodes: bool
    precision: list[PrecisionRow] | None
