"""`everplace serve`."""

from __future__ import annotations

from typing import Annotated

import typer

from everplace.errors import MissingExtraError

__all__ = ["serve"]


def serve(
    map_: Annotated[str, typer.Argument(metavar="MAP", help="Directory of the map, or an object store's address.")],
    *,
    host: Annotated[
        str, typer.Option("--host", metavar="HOST", help="Where to listen; beyond this machine it takes a token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", min=0, max=65535, metavar="PORT", help="0: any free one.")] = 8000,
    token: Annotated[
        str, typer.Option("--token", envvar="EVERPLACE_TOKEN", metavar="TOKEN", help="Required of clients.")
    ] = "",
    allow_host: Annotated[
        list[str] | None,
        typer.Option("--allow-host", metavar="NAME", help="A further name under which clients reach it (repeatable)."),
    ] = None,
) -> None:
    """Serve a map as a page for the browser and an HTTP interface for programs.

    Example: everplace serve my-map --port 8000
    """
    import importlib.util

    for module in ("fastapi", "prometheus_client", "python_multipart", "uvicorn"):
        if importlib.util.find_spec(module) is None:
            raise MissingExtraError("everplace serve", "serve")
    from everplace.serve.http_server import serve_map

    serve_map(map_, host=host, port=port, token=token, names=allow_host or ())
