"""Who may ask: the Host and Origin of a request, its token; and the headers that keep a browser careful."""

from __future__ import annotations

import hmac
import ipaddress
import socket
from collections.abc import Iterable

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from everplace.errors import ConfigError
from everplace.serve.refusal import RefusedError, refuse

__all__ = ["RequestGuard", "is_loopback", "require_token"]

_OPEN = ("/", "/healthz")
_PAGE = "/page/"
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


def is_loopback(host: str) -> bool:
    """Whether nobody but this machine reaches a service at this name or address."""
    address = _address(host)
    return host == "localhost" if address is None else address.is_loopback


def require_token(host: str, token: str, names: Iterable[str] = ()) -> None:
    """Refuses to serve other machines without a token.

    Raises:
        ConfigError: They could ask, and there is none; or it cannot stand in a header.
    """
    if token and not (token.isascii() and token.isprintable() and " " not in token):
        raise ConfigError("`token` must consist of printable ASCII characters without blanks")
    reached = next((name for name in (host, *names) if not is_loopback(name)), None)
    if not token and reached is not None:
        raise ConfigError(
            f"other machines reach {reached}, so a token is required; give `token`, or set EVERPLACE_TOKEN"
        )


class RequestGuard:
    """Lets through what may be asked."""

    def __init__(self, app: ASGIApp, host: str, token: str, names: Iterable[str]) -> None:
        """Keeps the rules.

        Args:
            app: What is guarded.
            host: That the service listens at.
            token: Required of all but the page and `/healthz`; empty: of nobody.
            names: Further names under which clients reach the service.
        """
        self._app, self._token = app, token.encode()
        self._names = {name.lower() for name in ("localhost", host, *names)}
        address = _address(host)
        # A service at all addresses of a machine is reached by any of them. An address in Host is no rebound name.
        self._any_address = address is not None and address.is_unspecified
        if self._any_address:
            self._names.add(socket.gethostname().lower())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers what may not be asked, and hands the rest on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(_HEADERS)
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        try:
            self._check(Headers(scope=scope), scope["path"])
        except RefusedError as refusal:
            await refuse(refusal, scope, receive, sending)
            return
        await self._app(scope, receive, sending)

    def _check(self, headers: Headers, path: str) -> None:
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._known(_name_of(hosts[0])):
            raise RefusedError(403, "this service is not known under the name in the Host header")
        origin = headers.get("origin")
        if origin is not None and origin.partition("://")[2] != hosts[0]:
            raise RefusedError(403, "pages of other sites may not ask this service")
        if self._token and path not in _OPEN and not path.startswith(_PAGE):
            scheme, _, given = headers.get("authorization", "").partition(" ")
            right = hmac.compare_digest(given.strip().encode("latin-1", "replace"), self._token)
            if scheme.lower() != "bearer" or not right:
                raise RefusedError(401, "a token is required: Authorization: Bearer TOKEN")

    def _known(self, name: str) -> bool:
        address = _address(name)
        if address is not None and (address.is_loopback or self._any_address):
            return True
        return name in self._names


def _name_of(host: str) -> str:
    """The name in a Host header, without port and brackets."""
    if host.startswith("["):
        return host[1:].partition("]")[0].lower()
    return host.partition(":")[0].lower()


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None
