"""`everplace describe`."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from everplace.choices import DescriptorFormat
from everplace.cli.options import EngineOption, Json, OutFile, given_pairs
from everplace.cli.output import (
    require_file,
    require_no_frame,
    require_other,
    show_progress,
    show_result,
    warn,
)
from everplace.errors import ConfigError
from everplace.files import readable

__all__ = ["describe"]


def describe(
    method: Annotated[
        str, typer.Argument(metavar="METHOD", help="A run directory, or sad, hog, alexnet, vgg19, hub:..., onnx:...")
    ],
    images: Annotated[Path, typer.Argument(metavar="IMAGES", help="Directory of images, a video, or a ROS bag.")],
    *,
    out: OutFile,
    batch: Annotated[
        int | None,
        typer.Option("--batch", min=1, help="Images described at once [what the method asks for, else 32]."),
    ] = None,
    file_format: Annotated[DescriptorFormat, typer.Option("--format", help="Layout of the HDF5 file.")] = "everplace",
    image_root: Annotated[
        Path | None,
        typer.Option(
            "--image-root", metavar="DIR", help="Directory above IMAGES from which the image files are named [IMAGES]."
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="NAME=VALUE", help="An option of a video or bag, such as every_seconds=0.5; see data list."
        ),
    ] = None,
    engine: EngineOption = "local",
    as_json: Json = False,
) -> None:
    """Describe every image of a directory, or every frame of a video; FILE.h5 gets the descriptors and the names.

    The frames of a video or bag are called by their numbers in it.

    With --image-root my-route the images are called winter/1.png, as hloc and kapture want them.

    Example: everplace describe runs/cp-vae my-route/winter --out winter.h5
    """
    require_file(out)
    require_other(out, images)
    if out.suffix.lower() not in (".h5", ".hdf5"):
        require_no_frame(out, images.parent)
    below = _below(images, image_root)
    options = given_pairs(settings)
    from everplace.describe.described_file import describe_to_file
    from everplace.describe.on_cluster import open_with
    from everplace.describe.recorded_frames import RecordedFrames, is_recording, open_recording
    from everplace.route.folder import open_traverse

    opened = open_recording(images, options) if is_recording(images) else open_traverse(images)
    if isinstance(opened, RecordedFrames):
        if image_root is not None:
            raise ConfigError(f"--image-root names image files, which {readable(images)} does not hold; leave it out")
    elif options:
        raise ConfigError(f"--set is for videos and bags, and {readable(images)} holds images; leave it out")
    describer = open_with(engine, method, show_progress())
    count = describe_to_file(
        describer, opened, out, layout=file_format, directory=below, batch=batch, progress=show_progress()
    )
    if isinstance(opened, RecordedFrames):
        for note in opened.notes:
            warn(note)
    show_result(
        {
            "method": describer.method,
            "images": count,
            "dimension": describer.dimension,
            "bytes_per_descriptor": 4 * describer.dimension,
            "settings": dict(describer.settings()),
            "out": str(out),
        },
        as_json,
    )


def _below(images: Path, root: Path | None) -> str:
    """The way from the root to the images, with slashes; empty where they are the same."""
    if root is None:
        return ""
    # As the path is given, before links are followed: a drive may be a link in its route to where it was recorded.
    for path in (images.absolute(), images.resolve()):
        for above in (path, *path.parents):
            if _same(above, root):
                below = path.relative_to(above)
                return "" if below == Path() else below.as_posix()
    raise ConfigError(
        f"--image-root {readable(root)} is not above {readable(images)}; name a directory that the images lie in"
    )


def _same(path: Path, other: Path) -> bool:
    with contextlib.suppress(OSError):
        return path.samefile(other)
    return False
