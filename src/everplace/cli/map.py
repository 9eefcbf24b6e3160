"""`everplace map`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from everplace.cli.options import EngineOption, Json
from everplace.cli.output import provenance, require_directory, require_file, show_progress, show_result, warn
from everplace.errors import MapError
from everplace.files import readable

__all__ = ["app"]

app = typer.Typer(
    help="Make a durable map of a route, and add drives to it.", no_args_is_help=True, rich_markup_mode=None
)

MapArgument = Annotated[str, typer.Argument(metavar="MAP", help="Directory of the map, or an object store's address.")]
Drive = Annotated[Path, typer.Option("--drive", metavar="DIR|VIDEO|BAG", help="Images, a video or a bag.")]
Name = Annotated[str, typer.Option("--name", metavar="NAME", help="What the drive is called [its file or directory].")]
Condition = Annotated[str, typer.Option("--condition", metavar="C", help="What it shows the route under [its name].")]
Poses = Annotated[
    Path | None, typer.Option("--poses", metavar="FILE", help="CSV file with the columns stem,x,y,heading.")
]


@app.command()
def create(
    map_: MapArgument,
    *,
    drive: Drive,
    name: Name = "",
    condition: Condition = "",
    method: Annotated[
        str,
        typer.Option(
            "--method", metavar="METHOD", help="What describes frames [hog16+efficientnet if installed, else hog16]."
        ),
    ] = "",
    dimensions: Annotated[int, typer.Option("--dimensions", min=1, metavar="D", help="Numbers of a descriptor.")] = 96,
    poses: Poses = None,
    engine: EngineOption = "local",
    as_json: Json = False,
) -> None:
    """Make a map from one drive, without training.

    Example: everplace map create my-map --drive summer.mp4 --condition summer
    """
    from everplace.mapping.route_map import Map

    made = Map.create(
        map_, drive, name=name, condition=condition, method=method, dimensions=dimensions, poses=poses,
        engine=engine, progress=show_progress(),
    )  # fmt: skip
    show_result(made.info(), as_json)


@app.command()
def add(
    map_: MapArgument,
    *,
    drive: Drive,
    name: Name = "",
    condition: Condition = "",
    align: Annotated[
        Literal["auto", "names", "poses", "images"],
        typer.Option("--align", help="What tells the places; auto believes names only where the images agree."),
    ] = "auto",
    poses: Poses = None,
    no_learn: Annotated[bool, typer.Option("--no-learn", help="Leave the map's descriptor as it is.")] = False,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="DIR", help="Write a page of what the images show, to look at.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Align a drive with a map, add it, and learn from what is sure.

    Example: everplace map add my-map --drive winter.mp4 --condition winter
    """
    from dataclasses import asdict

    from everplace.mapping.route_map import Map

    if report is not None:
        require_directory(report, "--report")
    opened = Map.open(map_)
    added = opened.add(
        drive,
        name=name,
        condition=condition,
        align=align,
        poses=poses,
        learn=not no_learn,
        report=report,
        details=provenance(),
        progress=show_progress(),
    )
    if added.agreement is not None and added.how == "images" and align == "auto":
        warn(
            f"the names of {added.name!r} agree with {added.agreement:.0%} of what its images show, so they were not "
            "believed; the images were"
        )
    show_result(asdict(added), as_json)


@app.command()
def remove(map_: MapArgument, name: Annotated[str, typer.Argument(metavar="NAME")], *, as_json: Json = False) -> None:
    """Take a drive, and what it taught, out of a map.

    Example: everplace map remove my-map winter
    """
    from everplace.mapping.route_map import Map

    opened = Map.open(map_)
    opened.remove(name, show_progress())
    show_result(opened.info(), as_json)


@app.command()
def info(
    map_: MapArgument,
    *,
    figure: Annotated[
        Path | None,
        typer.Option("--figure", metavar="FILE", help="Draw how right its answers are, by the probability they give."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show a map's drives, places by condition, calibration and size.

    Example: everplace map info my-map --figure my-map.png
    """
    if figure is not None:
        require_file(figure, (".png", ".svg", ".pdf"), "--figure")
    from everplace.mapping.answer_reliability import answer_reliability, reliability_figure
    from everplace.mapping.route_map import Map

    opened = Map.open(map_)
    found = answer_reliability(opened)
    if figure is not None:
        if found is None:
            raise MapError(
                f"the map {readable(map_)} has matched too few frames of other drives surely to hold some out, so "
                "nothing shows how right its answers are; add a drive with `everplace map add`"
            )
        from everplace.plots.canvas import save_figure

        save_figure(reliability_figure(found), figure)
    reliability = None if found is None else found.to_dict()
    result = {**opened.info(), "reliability": reliability}
    show_result(result if figure is None else {**result, "figure": str(figure)}, as_json)


@app.command()
def verify(map_: MapArgument, *, as_json: Json = False) -> None:
    """Read all of a map and check that it is whole.

    Example: everplace map verify my-map
    """
    from everplace.mapping.route_map import Map

    opened = Map.open(map_)
    faults = opened.verify()
    show_result({"versions": len(opened.versions()), "faults": faults}, as_json)
    if faults:
        raise MapError(f"the map {map_} is damaged: {faults[0]}; restore an earlier version, or a copy")


@app.command()
def versions(map_: MapArgument, *, as_json: Json = False) -> None:
    """List the versions of a map.

    Example: everplace map versions my-map
    """
    from everplace.mapping.route_map import Map

    found = Map.open(map_).versions()
    if as_json:
        show_result({"versions": found}, as_json=True)
        return
    for version in found:
        print(f"{version['version']:>4}  {version['created']}  {', '.join(version['drives'])}")


@app.command()
def restore(
    map_: MapArgument, version: Annotated[int, typer.Argument(metavar="VERSION")], *, as_json: Json = False
) -> None:
    """Make an earlier version of a map the newest.

    Example: everplace map restore my-map 2
    """
    from everplace.mapping.route_map import Map

    opened = Map.open(map_)
    opened.restore(version)
    show_result(opened.info(), as_json)


@app.command()
def compare(
    map_: MapArgument,
    version: Annotated[int, typer.Argument(metavar="VERSION")],
    drive: Annotated[str, typer.Argument(metavar="DRIVE", help="A drive of the map, images, a video or a bag.")],
    *,
    as_json: Json = False,
) -> None:
    """Tell whether the map of today answers a drive better than an earlier version did.

    Example: everplace map compare my-map 1 winter.mp4
    """
    from dataclasses import asdict

    from everplace.mapping.version_comparison import compare_versions

    compared = compare_versions(map_, version, drive, show_progress())
    if as_json:
        show_result(asdict(compared), as_json=True)
        return
    print(f"{compared.drive}: {compared.frames} frames, the places of {compared.known} are known")
    print("version  recall  probability  sure  drives")
    for one in compared.versions:
        recall = "     -" if one.recall is None else f"{one.recall:6.3f}"
        drives = ", ".join(map(readable, one.drives)) + (", which this drive taught" if one.taught else "")
        print(f"{one.version:>7}  {recall}  {one.probability:11.3f}  {one.sure:4.2f}  {drives}")
