"""The routes of the service."""

from __future__ import annotations

import sys
import traceback
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from pathlib import PurePosixPath
from typing import Annotated, Any

from fastapi import FastAPI, File, Form, Path, Query, Request, UploadFile
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Receive, Scope, Send

from everplace.errors import MapError
from everplace.serve.body_limit import BodyLimit
from everplace.serve.http_answers import Failure, FrameInfo, Health, LocatedImage, MapOverview
from everplace.serve.map_service import LocateRequest, MapService
from everplace.serve.page_files import INDEX, PageFile, page_files
from everplace.serve.refusal import RefusedError, refuse
from everplace.serve.request_guard import RequestGuard
from everplace.serve.service_metrics import CountedRequests, ServiceMetrics

__all__ = ["build_app"]

_SENTENCES = {
    400: "the form cannot be read; send multipart/form-data with the field image",
    404: "there is nothing here; /openapi.json says what there is",
    405: "this address does not take this method; /openapi.json says which it takes",
}
_ANY: dict[int | str, dict[str, Any]] = {
    status: {"model": Failure, "description": meaning}
    for status, meaning in (
        (401, "A token is required."), (403, "Host or Origin is of somebody else."), (404, "There is nothing."),
        (422, "A field or the address is not as it must be."), (503, "Busy; Retry-After says when to ask again."),
    )
}  # fmt: skip
_UPLOAD: dict[int | str, dict[str, Any]] = {
    **_ANY,
    400: {"model": Failure, "description": "There is no image, or it cannot be decoded."},
    413: {"model": Failure, "description": "Too many bytes or pixels."},
}
_FAILED = "the service failed; it has logged why"
_SESSION = r"^[A-Za-z0-9_-]{1,64}$"

Image = Annotated[UploadFile, File(description="An image file: JPEG, PNG, WebP, BMP, TIFF, PPM.")]
FrameId = Annotated[int, Path(ge=0, le=2**53, description="The frame's row in the map, as /map gives it.")]


def build_app(service: MapService, *, host: str, token: str = "", names: Iterable[str] = ()) -> ASGIApp:
    """The service as an ASGI application.

    Args:
        service: What answers.
        host: That it listens at.
        token: Required of all but the page and `/healthz`; empty: of nobody.
        names: Further names under which clients reach it.
    """

    @asynccontextmanager
    async def closing(_: FastAPI) -> AsyncIterator[None]:
        yield
        service.close()

    app = FastAPI(
        title="everplace", summary="Where on a map a frame was taken.", docs_url=None, redoc_url=None, lifespan=closing
    )
    metrics = ServiceMetrics(service)
    _add_answers(app, service, metrics)
    _add_page(app, page_files())
    app.add_exception_handler(RefusedError, _refused)
    app.add_exception_handler(MapError, _unreadable)
    app.add_exception_handler(RequestValidationError, _malformed)
    app.add_exception_handler(HTTPException, _not_served)
    app.add_exception_handler(Exception, _failed)  # and is raised on, to be logged
    limited = BodyLimit(app, service.limits)
    return CountedRequests(_Caught(RequestGuard(limited, host, token, names)), metrics)


def _add_answers(app: FastAPI, service: MapService, metrics: ServiceMetrics) -> None:
    @app.post("/localize", response_model=LocatedImage, responses=_UPLOAD)
    async def localize(
        image: Image,
        session: Annotated[
            str | None, Form(pattern=_SESSION, description="Frames of one session are those of one drive, in order.")
        ] = None,
        frame: Annotated[
            str | None, Form(max_length=256, description="Name given back; default: the upload's.")
        ] = None,
        time: Annotated[float | None, Form(allow_inf_nan=False, description="Seconds; given back.")] = None,
        matches: Annotated[int, Form(ge=0, le=20, description="How many places to name, best first.")] = 0,
        details: Annotated[bool, Form(description="Add belief and similarity along the route.")] = False,
    ) -> Response:
        """Says where a frame was taken."""
        name = _plain(frame or PurePosixPath(image.filename or "").stem)
        asked = LocateRequest(await image.read(), name, session or "", time, matches, details)
        return JSONResponse(await service.locate(asked))

    @app.delete("/sessions/{session}", status_code=204, response_class=Response, responses=_ANY)
    async def end_session(session: Annotated[str, Path(pattern=_SESSION)]) -> Response:
        """Forgets a drive."""
        if not service.sessions.end(session):
            raise RefusedError(404, "there is no session of this name; its first frame makes it")
        return Response(status_code=204)

    @app.post(
        "/translate",
        response_class=Response,
        responses={**_UPLOAD, 200: {"content": {"image/png": {}}, "description": "The frame in that condition."}},
    )
    async def translate(image: Image, condition: Annotated[str, Form(max_length=256)]) -> Response:
        """Shows a frame as it would look in another condition of the map, where the map's method decodes."""
        return Response(await service.translate(await image.read(), condition), media_type="image/png")

    @app.get("/map", response_model=MapOverview, responses=_ANY)
    async def overview(request: Request) -> Response:
        """Tells what the map holds."""
        loaded = await service.map.current()
        return _tagged(request, loaded.summary, "application/json", loaded.tag)

    @app.get(
        "/frames/{id}",
        response_class=Response,
        responses={**_ANY, 200: {"content": {"image/jpeg": {}}, "description": "A thumbnail."}},
    )
    async def thumbnail(
        request: Request,
        id: FrameId,
        version: Annotated[
            int | None, Query(description="Of the map that the number is of; default: the newest.")
        ] = None,
    ) -> Response:
        """Gives the thumbnail of a frame of the map."""
        loaded = await service.map.current()
        if version not in (None, loaded.version):
            raise RefusedError(404, f"the map has become version {loaded.version} meanwhile; ask /map again")
        data = await service.read(lambda: loaded.thumbnail(id))
        return _tagged(request, data, "image/jpeg", f"{loaded.tag}-{id}")

    @app.get("/frames/{id}/info", response_model=FrameInfo, responses=_ANY)
    async def frame_info(id: FrameId) -> Response:
        """Tells what is known of a frame of the map."""
        return JSONResponse((await service.map.current()).frame(id))

    @app.get("/healthz", response_model=Health, responses={403: _ANY[403]})
    async def health() -> Response:
        """Says that the service answers."""
        return JSONResponse({"status": "ok", "version": service.map.loaded.version})

    @app.get(
        "/metrics",
        response_class=Response,
        responses={
            401: _ANY[401],
            403: _ANY[403],
            200: {"content": {"text/plain": {}}, "description": "Of Prometheus."},
        },
    )
    async def measured() -> Response:
        """Counts requests, their latency, sessions and the map's version."""
        return Response(metrics.text(), media_type="text/plain; version=0.0.4; charset=utf-8")


def _add_page(app: FastAPI, page: dict[str, PageFile]) -> None:
    @app.get("/", include_in_schema=False)
    async def index(request: Request) -> Response:
        return file(request, INDEX)

    @app.get("/page/{name}", include_in_schema=False)
    async def page_file(request: Request, name: str) -> Response:
        return file(request, name)

    def file(request: Request, name: str) -> Response:
        if name not in page:
            raise RefusedError(404, _SENTENCES[404])
        return _tagged(request, page[name].content, page[name].media_type, page[name].tag)


def _tagged(request: Request, content: bytes, media_type: str, tag: str) -> Response:
    """An answer that a browser may keep, but asks about before it shows it again."""
    headers = {"ETag": f'"{tag}"', "Cache-Control": "private, no-cache"}
    if f'"{tag}"' in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    return Response(content, media_type=media_type, headers=headers)


def _plain(name: str) -> str:
    """A name as UTF-8 holds it: forms may say that their text is of any encoding."""
    return name.encode("utf-8", "backslashreplace").decode("utf-8")[:256]


def _refused(_: Request, error: Exception) -> Response:
    assert isinstance(error, RefusedError)
    return JSONResponse({"detail": error.sentence}, error.status, error.headers)


def _unreadable(_: Request, error: Exception) -> Response:
    print(f"everplace: {error}", file=sys.stderr)
    return JSONResponse(
        {"detail": "the map cannot be read at present; the service has logged why"}, 503, {"Retry-After": "5"}
    )


def _malformed(_: Request, error: Exception) -> Response:
    """One sentence of what the form or address lacks."""
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    field = _plain(str(first["loc"][-1]))
    if field == "image":
        return JSONResponse({"detail": "there is no image; send an image file in the field image"}, 400)
    return JSONResponse({"detail": f"{field}: {_plain(str(first['msg']))}"}, 422)


def _not_served(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    sentence = _SENTENCES.get(error.status_code, "this cannot be answered")
    return JSONResponse({"detail": sentence}, error.status_code, error.headers)


def _failed(_: Request, error: Exception) -> Response:  # noqa: ARG001 - clients are told no details
    return JSONResponse({"detail": _FAILED}, 500)


class _Caught:
    """Tells the log what went wrong, and the client that something did."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        started = False

        async def sending(message: Any) -> None:
            nonlocal started
            started = True
            await send(message)

        try:
            await self._app(scope, receive, sending)
        except Exception as error:
            print(f"everplace: this is a bug in everplace: {type(error).__name__}", file=sys.stderr)
            traceback.print_exception(error)
            if not started:
                await refuse(RefusedError(500, _FAILED), scope, receive, send)
