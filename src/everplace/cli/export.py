"""`everplace export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from everplace.cli.options import Json
from everplace.cli.output import require_file, show_result

__all__ = ["export"]


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Directory of a trained model.")],
    onnx: Annotated[Path, typer.Option("--onnx", metavar="FILE", help="File to write, ending in .onnx.")],
    as_json: Json = False,
) -> None:
    """Write a run's encoder as an ONNX network, and beside it the TOML with which onnx:FILE describes images.

    Example: everplace export runs/cp-vae --onnx cp-vae.onnx
    """
    require_file(onnx, (".onnx",), option="--onnx")
    from everplace.export.onnx_export import export_onnx

    written = export_onnx(run, onnx)
    show_result(
        {
            "onnx": str(written.onnx),
            "toml": str(written.toml),
            "dimension": written.dimension,
            "bytes": written.bytes,
            "difference": written.difference,
        },
        as_json,
    )
