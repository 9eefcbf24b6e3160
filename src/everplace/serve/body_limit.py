"""How much of a request is taken: counted as it streams, whatever its header says."""

from __future__ import annotations

import asyncio
import time

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from everplace.serve.refusal import RefusedError, too_busy
from everplace.serve.request_guard import respond
from everplace.serve.service_limits import ServiceLimits

__all__ = ["BodyLimit"]

_PATIENCE = 2.0
_CHUNK_LIMIT = 2
"""What is thrown away of a body that is too large, in limits: a client reads no answer before it has sent."""


class BodyLimit:
    """Ends requests that are too large, alone or together."""

    def __init__(self, app: ASGIApp, limits: ServiceLimits) -> None:
        self._app, self._limits = app, limits
        self._under_way = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hands on, and refuses when too many bytes came."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        taken, started = 0, False
        refusal: RefusedError | None = None

        async def receiving() -> Message:
            nonlocal taken, refusal
            message = await receive()
            size = len(message.get("body", b""))
            taken += size
            self._under_way += size
            if taken > self._limits.body_bytes:
                refusal = RefusedError(
                    413, f"the request has more than {self._limits.body_bytes} bytes, the limit here; send less"
                )
            elif self._under_way > self._limits.bytes_under_way:
                refusal = too_busy()
            if refusal is not None:
                return {"type": "http.disconnect"}  # nobody reads on
            return message

        async def sending(message: Message) -> None:
            nonlocal started
            if refusal is None:
                started = True
                await send(message)

        try:
            await self._app(scope, receiving, sending)
        except Exception:
            if refusal is None:
                raise
        finally:
            self._under_way -= taken
        if refusal is not None and not started:
            await self._throw_away(receive)
            await respond(refusal, scope, receive, send, close=True)

    async def _throw_away(self, receive: Receive) -> None:
        """Reads on for a little while, so that the client comes to read the answer."""
        end, left = time.monotonic() + _PATIENCE, _CHUNK_LIMIT * self._limits.body_bytes
        while left > 0 and (wait := end - time.monotonic()) > 0:
            try:
                message = await asyncio.wait_for(receive(), wait)
            except asyncio.TimeoutError:
                return
            left -= len(message.get("body", b""))
            if message["type"] == "http.disconnect" or not message.get("more_body"):
                return
