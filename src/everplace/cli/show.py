"""`everplace show`: one picture at a time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from everplace.cli import options
from everplace.cli.option_groups import RetrievalOptions, RouteOptions, grouped
from everplace.cli.output import require_picture, show_progress, show_result, warn_of_retrieval
from everplace.cli.registering import register

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from everplace.model.condition_vae import ConditionVAE
    from everplace.route.route import Route
    from everplace.scoring.retrieval import Retrieval

__all__ = ["app"]

RunArgument = Annotated[str, typer.Argument(metavar="RUN", help="Run directory of a c-vae or cp-vae.")]
Count = Annotated[int, typer.Option("--count", min=1, help="Places to show.")]


@grouped
def swap(
    run: RunArgument,
    route: options.RouteArgument,
    *,
    out: options.OutFile,
    places: RouteOptions,
    place: Annotated[
        int | None, typer.Option("--place", min=0, help="Position of the place among --frames [the middle one].")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Decode z_p of one frame with z_c of another, for one place in all conditions.

    As Figures 6 and 7 of Oh and Eoh (2021).

    Example: everplace show swap runs/cp-vae my-route --frames 1620: --out swap.png
    """
    require_picture(out, route)
    from everplace.experiments.translations import swap_figure

    model, label = _model(run)
    chosen = _select(route, places)
    _save(swap_figure(model, chosen, place, label=label), out, as_json)


@grouped
def constant(
    run: RunArgument,
    route: options.RouteArgument,
    *,
    out: options.OutFile,
    places: RouteOptions,
    count: Count = 4,
    as_json: options.Json = False,
) -> None:
    """Decode z_p of every frame with one constant z_c: condition-invariant images.

    As Figures 8 and 9 of Oh and Eoh (2021).

    Example: everplace show constant runs/cp-vae my-route --frames 1620: --out constant.png
    """
    require_picture(out, route)
    from everplace.experiments.translations import constant_figure

    model, label = _model(run)
    chosen = _select(route, places)
    _save(constant_figure(model, chosen, count=count, label=label), out, as_json)


@grouped
def translate(
    run: RunArgument,
    route: options.RouteArgument,
    *,
    out: options.OutFile,
    source: Annotated[
        str | None, typer.Option("--from", metavar="COND", help="Traverse or condition to translate from [the first].")
    ] = None,
    places: RouteOptions,
    count: Count = 3,
    as_json: options.Json = False,
) -> None:
    """Decode z_p of one frame with the mean z_c of every condition, above the true frames of these conditions.

    Example: everplace show translate runs/cp-vae my-route --frames 1620: --out translation.png
    """
    require_picture(out, route)
    from everplace.experiments.translations import translation_figure

    model, label = _model(run)
    chosen = _select(route, places)
    _save(translation_figure(model, chosen, count=count, source=source, label=label), out, as_json)


@grouped
def matrix(
    route: options.RouteArgument, *, asked: RetrievalOptions, out: options.OutFile, as_json: options.Json = False
) -> None:
    """Draw the similarity matrix with the best matches, and its truth unless the drives are not aligned.

    Example: everplace show matrix my-route --method hog --database summer --query winter --out matrix.png
    """
    require_picture(out, route)
    found = _retrieve(route, asked)
    from everplace.experiments.retrieval_pictures import matrix_figure

    _save(matrix_figure(*found), out, as_json)


@grouped
def matches(
    route: options.RouteArgument, *, asked: RetrievalOptions, out: options.OutFile, as_json: options.Json = False
) -> None:
    """Draw a gallery of right and wrong matches; of drives that are not aligned, of best matches.

    Example: everplace show matches my-route --method hog --database summer --query winter --out matches.png
    """
    require_picture(out, route)
    found = _retrieve(route, asked)
    from everplace.experiments.retrieval_pictures import match_figure

    _save(match_figure(*found), out, as_json)


def _retrieve(route: Path, asked: RetrievalOptions) -> tuple[Retrieval, str]:
    """What was found, and what titles call the method."""
    result = asked.retrieve(route, show_progress())
    from everplace.experiments.recipe_names import named_method

    warn_of_retrieval(result, asked.method, "Show others with --frames")
    return result, named_method(result.describer.method, result.describer.settings())


def _model(run: str) -> tuple[ConditionVAE, str]:
    """The model of a run, and what titles call it."""
    from everplace.experiments.recipe_names import named_method
    from everplace.experiments.translations import load_divided

    checkpoint = load_divided(run)
    return checkpoint.model, named_method(checkpoint.model.config.kind, checkpoint.settings())


def _select(route: Path, places: RouteOptions) -> Route:
    from everplace.route.selection import select

    return select(places.chosen(route), places.selection(), show_progress())


def _save(figure: Figure, out: Path, as_json: bool) -> None:
    from everplace.plots.canvas import save_figure

    save_figure(figure, out)
    show_result({"out": str(out)}, as_json)


app = typer.Typer(help="Draw one picture: swap, constant, translate, matrix or matches.", no_args_is_help=True)
for _command in (swap, constant, translate, matrix, matches):
    register(app, _command)
