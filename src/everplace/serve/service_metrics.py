"""What the service counts, in the text format of Prometheus."""

from __future__ import annotations

import time

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from everplace.serve.map_service import MapService

__all__ = ["CountedRequests", "ServiceMetrics"]

_BUCKETS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
_METHODS = frozenset({"GET", "POST", "DELETE", "HEAD", "OPTIONS", "PUT", "PATCH"})


class ServiceMetrics:
    """Counters of one service, in a registry of their own."""

    def __init__(self, service: MapService) -> None:
        """Begins at zero."""
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "everplace_requests", "Requests answered.", ("route", "method", "status"), registry=self.registry
        )
        self.seconds = Histogram(
            "everplace_request_seconds", "From a request's head to the end of its answer.", ("route",),
            buckets=_BUCKETS, registry=self.registry,
        )  # fmt: skip
        for name, meaning, value in (
            ("everplace_map_version", "Version of the map that answers.", lambda: service.map.loaded.version),
            ("everplace_sessions", "Drives whose filter is kept.", lambda: len(service.sessions)),
            ("everplace_work_under_way", "Frames that are answered or wait for it.", lambda: service.work.under_way),
        ):
            Gauge(name, meaning, registry=self.registry).set_function(value)

    def text(self) -> bytes:
        """All of them."""
        return generate_latest(self.registry)


class CountedRequests:
    """Counts what passes through."""

    def __init__(self, app: ASGIApp, metrics: ServiceMetrics) -> None:
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hands on, and counts when the answer has ended; an answer that nobody waited for has the status 0."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        status, start = 0, time.perf_counter()

        async def sending(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, receive, sending)
        finally:
            route = getattr(scope.get("route"), "path", "other")
            method = scope["method"] if scope["method"] in _METHODS else "other"
            self._metrics.requests.labels(route, method, str(status)).inc()
            self._metrics.seconds.labels(route).observe(time.perf_counter() - start)
