"""`everplace data inspect`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from everplace.cli.options import Json, RouteArgument
from everplace.cli.output import require_picture, show_progress, show_result, warn

if TYPE_CHECKING:
    from everplace.route.inspection import Inspection, TraverseInspection
    from everplace.route.route import Route

__all__ = ["inspect"]

_SHOWN = 5


def inspect(
    route: RouteArgument,
    sheet: Annotated[
        Path | None,
        typer.Option("--sheet", metavar="FILE.png", help="Also draw places across the traverses."),
    ] = None,
    places: Annotated[int, typer.Option("--places", min=1, help="Places on the sheet.")] = 8,
    as_json: Json = False,
) -> None:
    """Look at every frame: counts, sizes, gaps, duplicates, dark and stationary places, unreadable files.

    Every unreadable file is listed, and the exit status stays 0: to find them is what the command is for.

    Example: everplace data inspect my-route --sheet my-route.png
    """
    if sheet is not None:
        require_picture(sheet, route, "--sheet")
    from everplace.route.inspection import inspect_route
    from everplace.route.route import open_route
    from everplace.route.spelling import spelling_hint

    opened = open_route(route)
    found = inspect_route(opened, show_progress())
    if sheet is not None:
        from everplace.experiments.contact_sheet import contact_sheet
        from everplace.plots.canvas import save_figure

        save_figure(contact_sheet(opened, found.kept, count=places), sheet)
    for traverse in found.traverses:
        if hint := spelling_hint(traverse.missing, traverse.traverse.stems, ""):
            warn(f"{traverse.traverse.name} lacks places that it may have: {hint}")
        for problem in traverse.unreadable.values() if not as_json else ():
            warn(problem)
    result = _result(opened, found, None if as_json else _SHOWN)
    show_result({**result, "sheet": None if sheet is None else str(sheet)}, as_json)


def _result(route: Route, found: Inspection, shown: int | None) -> dict[str, Any]:
    """What is printed; lists are cut after `shown` entries."""
    return {
        "route": str(route.root),
        "shared_places": len(found.places),
        "tolerance": route.tolerance,
        "radius": route.radius,
        "protocol": route.protocol,
        "truth_from": route.truth_origin,
        "aligned_by": route.aligned_by,
        "dark_places": int(found.dark.sum()),
        "stationary_places": int(found.stationary.sum()),
        "unreadable_places": int(found.broken.sum()),
        "kept_places": len(found.kept),
        "tunnels": _cut([_stretch(*stretch, shown) for stretch in found.tunnels], shown),
        "stops": _cut([_stretch(*stretch, shown) for stretch in found.stops], shown),
        "duplicates": _cut(
            [list(group) if shown is None else " = ".join(group[:3]) for group in found.duplicates], shown
        ),
        "traverses": {traverse.traverse.name: _traverse(traverse, shown) for traverse in found.traverses},
    }


def _traverse(found: TraverseInspection, shown: int | None) -> dict[str, Any]:
    traverse = found.traverse
    gaps = found.gaps
    return {
        "condition": traverse.condition,
        "frames": len(traverse),
        "poses": traverse.poses is not None,
        "bytes": found.bytes,
        "sizes": {f"{height}×{width}": count for (height, width), count in sorted(found.sizes.items())},
        "unreadable": len(found.unreadable) if shown else found.unreadable,
        "dark": int(found.dark.sum()),
        "stationary": int(found.stationary.sum()),
        "alike": int(found.alike.sum()),
        "gaps": None if gaps is None else _cut([_stretch(*gap, shown) for gap in gaps], shown),
        "missing": _cut(found.missing, shown),
    }


def _stretch(first: str, last: str, count: int, shown: int | None) -> Any:
    return {"first": first, "last": last, "count": count} if shown is None else f"{first} to {last} ({count})"


def _cut(items: Sequence[Any], shown: int | None) -> list[Any]:
    if shown is None or len(items) <= shown:
        return list(items)
    return [*items[:shown], f"... and {len(items) - shown} more"]
