"""What `export` does: a run or a map's descriptor as an ONNX network, and what that costs in scores on a route."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.describe.describer import Describer
from everplace.describe.registry import open_describer
from everplace.errors import RouteError
from everplace.export.onnx_export import OnnxExport, export_onnx
from everplace.images.decoding import ImageSpec, convert_image, decode_images
from everplace.mapping.route_map import Map
from everplace.model.inference import on_device
from everplace.progress import Progress, quiet
from everplace.render.frame import open_drive
from everplace.render.render_config import CONDITIONS, RenderConfig
from everplace.render.rendered_route import drive_poses, route_world
from everplace.route.route import Route
from everplace.route.selection import Selection, select, spread
from everplace.scoring.retrieval import retrieve

__all__ = ["ExportedRun", "export_run"]

_CALIBRATION = 128
"""Images that the ranges of an 8-bit network are measured on."""


@dataclass(frozen=True, eq=False)
class ExportedRun:
    """What was written, and how it compares.

    Attributes:
        network: The files.
        calibrated_on: What the 8-bit ranges were measured on; empty: the network computes in 32 bits.
        auc_pr: On the route, of the run and of the exported network; None: no route was given.
        pair: The query and the database of these.
    """

    network: OnnxExport
    calibrated_on: str = ""
    auc_pr: tuple[float, float] | None = None
    pair: tuple[str, str] = ("", "")

    def summary(self) -> dict[str, Any]:
        """What `--json` prints."""
        told: dict[str, Any] = {**asdict(self.network), "onnx": str(self.network.onnx), "toml": str(self.network.toml)}
        if self.calibrated_on:
            told["calibrated_on"] = self.calibrated_on
        if self.auc_pr is not None:
            query, database = self.pair
            told |= {"query": query, "database": database}
            told["auc_pr"] = dict(zip(("run", "exported"), self.auc_pr, strict=True))
        return told


def export_run(
    run: str | os.PathLike[str],
    out: Path,
    *,
    int8: bool = False,
    route: Route | None = None,
    selection: Selection | None = None,
    progress: Progress = quiet,
) -> ExportedRun:
    """Writes FILE.onnx and FILE.toml, and compares the network with the run on a route.

    Args:
        run: A run directory, or a map, whose descriptors the network then gives.
        out: The network's file; it ends in `.onnx`.
        int8: Compute in 8 bits, calibrated on frames of the route, or without one on rendered frames.
        route: Its second traverse asks the first, and auc_pr is taken of both; None: nothing is compared.
        selection: Which places of it take part.
        progress: Told of the describing.

    Raises:
        RouteError: The route has one traverse alone, or its traverses are not aligned.
        EverplaceError: As for `everplace.export.onnx_export.export_onnx`.
    """
    with on_device("cpu"):
        opened: str | os.PathLike[str] | Describer = run
        if os.path.isdir(os.path.join(run, "states.lance")):  # noqa: PTH112, PTH118 - a name too long for a path is none
            opened = Map.open(run).adapted()
        describer = opened if isinstance(opened, Describer) else open_describer(opened)
    chosen = None if route is None else select(route, selection or Selection(), progress)
    if chosen is not None and (len(chosen.traverses) < 2 or not chosen.aligned):
        raise RouteError("`route` is to compare scores on, so it wants two traverses of the same places; align them")
    images, source = None, ""
    if int8:
        images = _rendered(describer.image) if chosen is None else _frames(chosen, describer.image)
        source = f"{len(images)} {'rendered frames' if chosen is None else f'frames of {chosen.name}'}"
    written = export_onnx(opened, out, images)
    if chosen is None:
        return ExportedRun(written, source)
    database, query = (traverse.name for traverse in chosen.traverses[:2])
    found = (
        retrieve(chosen, query, database, one, progress=progress).scores
        for one in (describer, open_describer(f"onnx:{out}"))
    )
    ours, theirs = (float("nan") if scores is None else scores.auc_pr for scores in found)
    return ExportedRun(written, source, (ours, theirs), (query, database))


def _frames(route: Route, image: ImageSpec) -> list[NDArray[np.uint8]]:
    """Frames of all traverses, evenly spread."""
    paths = [path for traverse in route.traverses for path in traverse.paths]
    return list(decode_images([paths[index] for index in spread(len(paths), _CALIBRATION)], image))


def _rendered(image: ImageSpec) -> list[NDArray[np.uint8]]:
    """Frames of a rendered world in all its conditions."""
    size = image.size or (64, 128)
    config = RenderConfig(places=-(-_CALIBRATION // len(CONDITIONS)), size=(min(size[0], 480), min(size[1], 640)))
    world = route_world(config)
    frames = []
    for condition in CONDITIONS:
        drive = open_drive(world, condition)
        frames += [
            convert_image(drive.frame((x, y, heading), config.size), image)
            for x, y, heading in drive_poses(world, config, condition).tolist()
        ]
    return frames
