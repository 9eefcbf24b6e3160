"""How much of a request is taken: counted as it streams, whatever its header says."""

from __future__ import annotations

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from everplace.serve.refusal import RefusedError, refuse, too_busy
from everplace.serve.service_limits import ServiceLimits

__all__ = ["BodyLimit"]


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
        taken, started, read = 0, False, False
        refusal: RefusedError | None = None

        async def receiving() -> Message:
            nonlocal taken, read, refusal
            message = await receive()
            read = not message.get("more_body")
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
            await refuse(refusal, scope, receive, send, read=read)
