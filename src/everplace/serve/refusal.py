"""What the service answers where it does not do what it is asked."""

from __future__ import annotations

import asyncio
import time

from starlette.responses import JSONResponse
from starlette.types import Receive, Scope, Send

__all__ = ["RefusedError", "refuse", "too_busy"]

_PATIENCE = 2.0
_THROWN_AWAY = 32 << 20


class RefusedError(Exception):
    """An answer other than the wanted one.

    Attributes:
        status: Of HTTP.
        sentence: For whoever asked; no path and nothing of the inside.
        retry_after: Seconds after which asking again may help; 0: it will not.
    """

    def __init__(self, status: int, sentence: str, retry_after: int = 0) -> None:
        super().__init__(sentence)
        self.status, self.sentence, self.retry_after = status, sentence, retry_after

    @property
    def headers(self) -> dict[str, str]:
        """That go with it."""
        return {"Retry-After": str(self.retry_after)} if self.retry_after else {}


def too_busy() -> RefusedError:
    """There is more to do than the service takes on."""
    return RefusedError(503, "the service is busy; ask again in a second", retry_after=1)


async def refuse(refusal: RefusedError, scope: Scope, receive: Receive, send: Send, *, read: bool = False) -> None:
    """Answers a request whose body was not read, and ends the connection.

    Args:
        refusal: The answer.
        scope: Of the request.
        receive: Gives what is left of the body.
        send: Takes the answer.
        read: All of the body was read.
    """
    if not read:
        await _throw_away(receive)
    headers = {**refusal.headers, "Connection": "close"}
    if refusal.status == 401:
        headers["WWW-Authenticate"] = "Bearer"
    await JSONResponse({"detail": refusal.sentence}, refusal.status, headers)(scope, receive, send)


async def _throw_away(receive: Receive) -> None:
    """Reads on for a little while: many a client reads no answer before it has sent all."""
    end, left = time.monotonic() + _PATIENCE, _THROWN_AWAY
    while left > 0 and (wait := end - time.monotonic()) > 0:
        try:
            message = await asyncio.wait_for(receive(), wait)
        except asyncio.TimeoutError:
            return
        left -= len(message.get("body", b""))
        if not message.get("more_body"):
            return
