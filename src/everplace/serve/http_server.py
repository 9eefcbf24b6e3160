"""Listens, says where, and ends at once when it is told to."""

from __future__ import annotations

import errno
import os
import signal
import socket
from collections.abc import Sequence

import uvicorn

from everplace.errors import ConfigError
from everplace.files import readable
from everplace.serve.client_patience import patient_protocol
from everplace.serve.http_app import build_app
from everplace.serve.map_service import MapService
from everplace.serve.request_guard import require_token
from everplace.serve.service_limits import DEFAULT_LIMITS, ServiceLimits

__all__ = ["serve_map"]

_BACKLOG = 512
_HEAD_BYTES = 32 << 10
_GRACE_SECONDS = 1
_IDLE_SECONDS = 15


def serve_map(
    address: str,
    *,
    host: str = "127.0.0.1",
    port: int = 8000,
    token: str = "",
    names: Sequence[str] = (),
    limits: ServiceLimits = DEFAULT_LIMITS,
) -> None:
    """Serves a map until Ctrl-C, which is raised on, or SIGTERM; prints one line with its address.

    Args:
        address: Of the map.
        host: To listen at.
        port: To listen at; 0: a free one.
        token: Required of clients; it must be given where other machines reach `host`.
        names: Further names under which clients reach the service.
        limits: What is taken on.

    Raises:
        ConfigError: A token is missing, or nothing can listen there.
        MapError: There is no such map, it is damaged, or it was made with what is not here.
    """
    require_token(host, token, names)
    with _listening(host, port) as listener:
        service = MapService(address, limits)
        config = uvicorn.Config(
            build_app(service, host=host, token=token, names=names), http=patient_protocol(limits), ws="none",
            log_config=None, log_level="critical", access_log=False, server_header=False, proxy_headers=False,
            timeout_keep_alive=_IDLE_SECONDS, timeout_graceful_shutdown=_GRACE_SECONDS,
            h11_max_incomplete_event_size=_HEAD_BYTES,
        )  # fmt: skip
        shown = f"[{host}]" if ":" in host else host
        where = f"http://{shown}:{listener.getsockname()[1]}/"
        # uvicorn raises SIGTERM again when all is closed: it has done its work by then.
        before = signal.signal(signal.SIGTERM, lambda *_: None)
        try:
            _Announced(config, f"everplace: {readable(address)} is served at {where} (Ctrl-C ends it)").run([listener])
        finally:
            signal.signal(signal.SIGTERM, before)


class _Announced(uvicorn.Server):
    """Says that it listens when it does."""

    def __init__(self, config: uvicorn.Config, sentence: str) -> None:
        super().__init__(config)
        self._sentence = sentence

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        print(self._sentence, flush=True)


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.getaddrinfo(host, port, family)  # of a name that nobody knows, create_server says a number only
        return socket.create_server((host, port), family=family, backlog=_BACKLOG)
    except socket.gaierror:
        raise ConfigError(f"`host` {readable(host)} is no name or address of this machine") from None
    except (OSError, OverflowError) as error:
        if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            raise ConfigError(f"`port` {port} of {host} is in use; choose another, or 0 for any that is free") from None
        reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
        raise ConfigError(f"cannot listen at `host` {readable(host)}, `port` {port}: {reason}") from None
