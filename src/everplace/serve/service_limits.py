"""What the service takes on, and for how long it waits for anybody."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["DEFAULT_LIMITS", "ServiceLimits"]


@dataclass(frozen=True)
class ServiceLimits:
    """Limits that keep one client from taking what belongs to all.

    Attributes:
        body_bytes: Of one request.
        bytes_under_way: Of all requests that are being answered, together.
        pixels: Of one image.
        connections: Open at once.
        waiting: Frames that wait for a worker; further ones are told to come back.
        session_waiting: Of these, how many may be of one session.
        head_seconds: From the first byte of a request, or from connecting, to the end of its head.
        body_seconds: From there to the end of its body.
        send_seconds: That a client may leave an answer unread.
        sessions: Drives whose filter is kept.
        session_bytes: That these may take together; on a map of very many places there are fewer.
        session_seconds: After which a drive that is not heard of is forgotten.
        look_seconds: Between two looks for a newer version of the map.
        look_wait_seconds: That a client waits for a newer version to be read.
    """

    body_bytes: int = 20 << 20
    bytes_under_way: int = 256 << 20
    pixels: int = 25_000_000
    connections: int = 512
    waiting: int = 64
    session_waiting: int = 16
    head_seconds: float = 10.0
    body_seconds: float = 30.0
    send_seconds: float = 30.0
    sessions: int = 256
    session_bytes: int = 512 << 20
    session_seconds: float = 1800.0
    look_seconds: float = 1.0
    look_wait_seconds: float = 1.0


DEFAULT_LIMITS = ServiceLimits()
