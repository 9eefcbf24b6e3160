"""The protocol of one connection: HTTP/1.1, by uvicorn, that waits for no client longer than it must."""

from __future__ import annotations

import asyncio
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from everplace.serve.service_limits import ServiceLimits

__all__ = ["patient_protocol"]

_FULL = (
    b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 1\r\nConnection: close\r\nContent-Type: application/json\r\n"
    b'Content-Length: 58\r\n\r\n{"detail": "too many connections; ask again in a second"}\n'
)


def patient_protocol(limits: ServiceLimits) -> type[asyncio.Protocol]:
    """The class of connections under these limits."""

    class PatientProtocol(H11Protocol):
        _awaited: Any = None
        _deadline: asyncio.TimerHandle | None = None
        _reading: asyncio.TimerHandle | None = None

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            if len(self.connections) > limits.connections:
                transport.write(_FULL)
                transport.close()
                return
            self._watch()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            self._watch()

        def on_response_complete(self) -> None:
            super().on_response_complete()
            self._watch()

        def connection_lost(self, exc: Exception | None) -> None:
            self._stop()
            self.resume_writing()
            super().connection_lost(exc)

        def pause_writing(self) -> None:
            super().pause_writing()
            self._reading = self.loop.call_later(limits.send_seconds, self.transport.abort)

        def resume_writing(self) -> None:
            super().resume_writing()
            if self._reading is not None:
                self._reading.cancel()
                self._reading = None

        def _watch(self) -> None:
            """Sets the time by which the head, or then the body, must be whole; more bytes do not prolong it."""
            state = self.conn.their_state
            if state is self._awaited:
                return
            self._stop()
            idle = state is h11.IDLE and self.timeout_keep_alive_task is not None  # between two requests
            if state not in (h11.IDLE, h11.SEND_BODY) or idle:
                return
            self._awaited = state
            seconds = limits.head_seconds if state is h11.IDLE else limits.body_seconds
            self._deadline = self.loop.call_later(seconds, self.transport.abort)

        def _stop(self) -> None:
            self._awaited = None
            if self._deadline is not None:
                self._deadline.cancel()
                self._deadline = None

    return PatientProtocol
