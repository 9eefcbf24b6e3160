"""`everplace show`: one picture at a time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from everplace.cli import options
from everplace.cli.options import chosen_route, selection_of
from everplace.cli.output import require_picture, show_progress, show_result, warn_of_retrieval

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from everplace.model.condition_vae import ConditionVAE
    from everplace.route.route import Route

__all__ = ["app"]

RunArgument = Annotated[str, typer.Argument(metavar="RUN", help="Run directory of a c-vae or cp-vae.")]
Count = Annotated[int, typer.Option("--count", min=1, help="Places to show.")]


def swap(
    run: RunArgument,
    route: options.RouteArgument,
    *,
    out: options.OutFile,
    conditions: options.Conditions = "",
    frames: options.Frames = "",
    place: Annotated[
        int | None, typer.Option("--place", min=0, help="Position of the place among --frames [the middle one].")
    ] = None,
    drop_dark: options.DropDark = False,
    drop_stationary: options.DropStationary = False,
    as_json: options.Json = False,
) -> None:
    """Decode z_p of one frame with z_c of another, for one place in all conditions.

    As Figures 6 and 7 of Oh and Eoh (2021).

    Example: everplace show swap runs/cp-vae my-route --frames 1620: --out swap.png
    """
    require_picture(out, route)
    from everplace.experiments.translations import swap_figure

    model, label = _model(run)
    chosen = _places(route, conditions, frames, drop_dark, drop_stationary)
    _save(swap_figure(model, chosen, place, label=label), out, as_json)


def constant(
    run: RunArgument,
    route: options.RouteArgument,
    *,
    out: options.OutFile,
    conditions: options.Conditions = "",
    frames: options.Frames = "",
    count: Count = 4,
    drop_dark: options.DropDark = False,
    drop_stationary: options.DropStationary = False,
    as_json: options.Json = False,
) -> None:
    """Decode z_p of every frame with one constant z_c: condition-invariant images.

    As Figures 8 and 9 of Oh and Eoh (2021).

    Example: everplace show constant runs/cp-vae my-route --frames 1620: --out constant.png
    """
    require_picture(out, route)
    from everplace.experiments.translations import constant_figure

    model, label = _model(run)
    chosen = _places(route, conditions, frames, drop_dark, drop_stationary)
    _save(constant_figure(model, chosen, count=count, label=label), out, as_json)


def translate(
    run: RunArgument,
    route: options.RouteArgument,
    *,
    out: options.OutFile,
    source: Annotated[
        str | None, typer.Option("--from", metavar="COND", help="Traverse or condition to translate from [the first].")
    ] = None,
    conditions: options.Conditions = "",
    frames: options.Frames = "",
    count: Count = 3,
    drop_dark: options.DropDark = False,
    drop_stationary: options.DropStationary = False,
    as_json: options.Json = False,
) -> None:
    """Decode z_p of one frame with the mean z_c of every condition, above the true frames of these conditions.

    Example: everplace show translate runs/cp-vae my-route --frames 1620: --out translation.png
    """
    require_picture(out, route)
    from everplace.experiments.translations import translation_figure

    model, label = _model(run)
    chosen = _places(route, conditions, frames, drop_dark, drop_stationary)
    _save(translation_figure(model, chosen, count=count, source=source, label=label), out, as_json)


def _retrieval_command(picture: str) -> Callable[..., None]:
    """The command that draws the `matrix` or the `matches` of a method on a pair."""

    def draw(
        route: options.RouteArgument,
        *,
        method: options.Method,
        database: options.Database,
        query: options.Query,
        out: options.OutFile,
        frames: options.Frames = "",
        tolerance: options.Tolerance = None,
        radius: options.Radius = None,
        drop_dark: options.DropDark = False,
        drop_stationary: options.DropStationary = False,
        standardise: options.Standardise = None,
        sequence: options.Sequence = 1,
        sequence_method: options.SequenceSearch = "filter",
        as_json: options.Json = False,
    ) -> None:
        require_picture(out, route)
        from everplace.experiments.recipe_names import named_method
        from everplace.experiments.retrieval_pictures import match_figure, matrix_figure
        from everplace.match.matching import Matching
        from everplace.route.route import open_route
        from everplace.scoring.retrieval import retrieve

        result = retrieve(
            open_route(route), query, database, method, tolerance=tolerance, radius=radius,
            selection=selection_of(frames, drop_dark, drop_stationary),
            matching=Matching(standardise, sequence, sequence_method), progress=show_progress(),
        )  # fmt: skip
        warn_of_retrieval(result, method, "Show others with --frames")
        label = named_method(result.describer.method, result.describer.settings())
        _save((matrix_figure if picture == "matrix" else match_figure)(result, label), out, as_json)

    return draw


def _model(run: str) -> tuple[ConditionVAE, str]:
    """The model of a run, and what titles call it."""
    from everplace.experiments.recipe_names import named_method
    from everplace.experiments.translations import load_divided

    checkpoint = load_divided(run)
    return checkpoint.model, named_method(checkpoint.model.config.kind, checkpoint.settings())


def _places(route: Path, conditions: str, frames: str, drop_dark: bool, drop_stationary: bool) -> Route:
    from everplace.route.selection import select

    opened = chosen_route(route, conditions)
    return select(opened, selection_of(frames, drop_dark, drop_stationary), show_progress())


def _save(figure: Figure, out: Path, as_json: bool) -> None:
    from everplace.plots.canvas import save_figure

    save_figure(figure, out)
    show_result({"out": str(out)}, as_json)


app = typer.Typer(help="Draw one picture: swap, constant, translate, matrix or matches.", no_args_is_help=True)
app.command("swap")(swap)
app.command("constant")(constant)
app.command("translate")(translate)
for _name, _what in (
    ("matrix", "the similarity matrix with its truth and the best matches"),
    ("matches", "a gallery of right and wrong matches"),
):
    _example = f"everplace show {_name} my-route --method hog --database summer --query winter --out {_name}.png"
    app.command(_name, help=f"Draw {_what}.\n\nExample: {_example}")(_retrieval_command(_name))
