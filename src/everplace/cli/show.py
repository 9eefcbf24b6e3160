"""`everplace show`: one picture at a time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from everplace.cli.options import (
    Database,
    DropDark,
    DropStationary,
    Frames,
    Json,
    OutFile,
    Query,
    Radius,
    RouteArgument,
    Sequence,
    SequenceSearch,
    Standardise,
    Tolerance,
)  # fmt: skip
from everplace.cli.output import (
    one_of,
    require_file,
    require_no_frame,
    show_progress,
    show_result,
    warn,
)

if TYPE_CHECKING:
    from everplace.route.route import Route

__all__ = ["register"]

_PICTURES = (".png", ".svg", ".pdf")

RunArgument = Annotated[str, typer.Argument(metavar="RUN", help="Run directory of a c-vae or cp-vae.")]
Conditions = Annotated[str, typer.Option("--conditions", metavar="A,B", help="Traverses or conditions to show [all].")]
Method = Annotated[str, typer.Option("--method", metavar="METHOD", help="A run directory, or sad, hog, ...")]


def register(app: typer.Typer) -> None:
    """Adds the sub-commands."""
    show = typer.Typer(help="Draw one picture: swap, constant, translate, matrix or matches.", no_args_is_help=True)
    show.command("swap")(swap)
    show.command("constant")(constant)
    show.command("translate")(translate)
    show.command("matrix")(matrix)
    show.command("matches")(matches)
    app.add_typer(show, name="show")


def swap(
    run: RunArgument,
    route: RouteArgument,
    out: OutFile,
    conditions: Conditions = "",
    frames: Frames = "",
    place: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option("--place", min=0, help="Position of the place among --frames [the middle one]."),
    ] = None,
    drop_dark: DropDark = False,
    drop_stationary: DropStationary = False,
    as_json: Json = False,
) -> None:
    """Decode z_p of one frame with z_c of another, for one place in all conditions.

    As Figures 6 and 7 of Oh and Eoh (2021).

    Example: everplace show swap runs/cp-vae my-route --frames 1620: --out swap.png
    """
    require_file(out, _PICTURES)
    require_no_frame(out, route)
    from everplace.experiments.recipe_names import named_method
    from everplace.experiments.translations import load_divided, swap_figure
    from everplace.plots.canvas import save_figure

    checkpoint = load_divided(run)
    label = named_method(checkpoint.model.config.kind, checkpoint.settings())
    chosen = _select(route, conditions, frames, drop_dark, drop_stationary)
    save_figure(swap_figure(checkpoint.model, chosen, place, label=label), out)
    show_result({"out": str(out)}, as_json)


def constant(
    run: RunArgument,
    route: RouteArgument,
    out: OutFile,
    conditions: Conditions = "",
    frames: Frames = "",
    count: Annotated[int, typer.Option("--count", min=1, help="Places to show.")] = 4,
    drop_dark: DropDark = False,
    drop_stationary: DropStationary = False,
    as_json: Json = False,
) -> None:
    """Decode z_p of every frame with one constant z_c: condition-invariant images.

    As Figures 8 and 9 of Oh and Eoh (2021).

    Example: everplace show constant runs/cp-vae my-route --frames 1620: --out constant.png
    """
    require_file(out, _PICTURES)
    require_no_frame(out, route)
    from everplace.experiments.recipe_names import named_method
    from everplace.experiments.translations import constant_figure, load_divided
    from everplace.plots.canvas import save_figure

    checkpoint = load_divided(run)
    label = named_method(checkpoint.model.config.kind, checkpoint.settings())
    chosen = _select(route, conditions, frames, drop_dark, drop_stationary)
    save_figure(constant_figure(checkpoint.model, chosen, count=count, label=label), out)
    show_result({"out": str(out)}, as_json)


def translate(
    run: RunArgument,
    route: RouteArgument,
    out: OutFile,
    source: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option("--from", metavar="COND", help="Traverse or condition to translate from [the first]."),
    ] = None,
    conditions: Conditions = "",
    frames: Frames = "",
    count: Annotated[int, typer.Option("--count", min=1, help="Places to show.")] = 3,
    drop_dark: DropDark = False,
    drop_stationary: DropStationary = False,
    as_json: Json = False,
) -> None:
    """Decode z_p of one frame with the mean z_c of every condition, above the true frames of these conditions.

    Example: everplace show translate runs/cp-vae my-route --frames 1620: --out translation.png
    """
    require_file(out, _PICTURES)
    require_no_frame(out, route)
    from everplace.experiments.recipe_names import named_method
    from everplace.experiments.translations import load_divided, translation_figure
    from everplace.plots.canvas import save_figure

    checkpoint = load_divided(run)
    label = named_method(checkpoint.model.config.kind, checkpoint.settings())
    chosen = _select(route, conditions, frames, drop_dark, drop_stationary)
    save_figure(translation_figure(checkpoint.model, chosen, count=count, source=source, label=label), out)
    show_result({"out": str(out)}, as_json)


def matrix(
    route: RouteArgument,
    method: Method,
    database: Database,
    query: Query,
    out: OutFile,
    frames: Frames = "",
    tolerance: Tolerance = None,
    radius: Radius = None,
    drop_dark: DropDark = False,
    drop_stationary: DropStationary = False,
    standardise: Standardise = None,
    sequence: Sequence = 1,
    sequence_method: SequenceSearch = "filter",
    as_json: Json = False,
) -> None:
    """Draw the similarity matrix with its truth and the best matches.

    Example: everplace show matrix my-route --method hog --database summer --query winter --out matrix.png
    """
    _evaluated(
        "matrix", route, method, database, query, out, frames, tolerance, radius, drop_dark, drop_stationary,
        standardise, sequence, sequence_method, as_json,
    )  # fmt: skip


def matches(
    route: RouteArgument,
    method: Method,
    database: Database,
    query: Query,
    out: OutFile,
    frames: Frames = "",
    tolerance: Tolerance = None,
    radius: Radius = None,
    drop_dark: DropDark = False,
    drop_stationary: DropStationary = False,
    standardise: Standardise = None,
    sequence: Sequence = 1,
    sequence_method: SequenceSearch = "filter",
    as_json: Json = False,
) -> None:
    """Draw a gallery of right and wrong matches.

    Example: everplace show matches my-route --method hog --database summer --query winter --out matches.png
    """
    _evaluated(
        "matches", route, method, database, query, out, frames, tolerance, radius, drop_dark, drop_stationary,
        standardise, sequence, sequence_method, as_json,
    )  # fmt: skip


def _evaluated(
    what: str,
    route: Path,
    method: str,
    database: str,
    query: str,
    out: Path,
    frames: str,
    tolerance: int | None,
    radius: float | None,
    drop_dark: bool,
    drop_stationary: bool,
    standardise: str | None,
    sequence: int,
    sequence_method: str,
    as_json: bool,
) -> None:
    require_file(out, _PICTURES)
    require_no_frame(out, route)
    how = one_of(standardise, "--standardise", ("centre", "full"))
    search = one_of(sequence_method, "--sequence-method", ("filter", "seqslam", "mean"))
    from everplace.describe.registry import open_describer
    from everplace.experiments.captions import match_note, pair_words, right_words, score_words
    from everplace.experiments.evaluation import seen_places, seen_sentence
    from everplace.experiments.recipe_names import named_method
    from everplace.experiments.retrieval_pictures import match_figure, matrix_figure
    from everplace.match.standardise import require_standardisable
    from everplace.plots.canvas import save_figure
    from everplace.route.route import open_route
    from everplace.route.selection import Selection, parse_frames
    from everplace.scoring.retrieval import Matching, Truth, choose_pair, of_itself_sentence, retrieve, true_matches

    progress = show_progress()
    describer = open_describer(method, progress=progress)
    if how is not None:
        require_standardisable(describer.method, describer.metric)
    selection = Selection(parse_frames(frames) if frames else None, drop_dark, drop_stationary)
    chosen, pair = choose_pair(open_route(route), query, database, selection, progress)
    matches, truth = true_matches(chosen, pair, Truth(tolerance, radius))
    if seen := seen_places(describer, chosen):
        warn(f"{seen_sentence(method, seen)} Show others with --frames")
    if pair.of_itself:
        warn(of_itself_sentence(pair))
    matching = Matching(how, sequence, search)
    result = retrieve(describer, pair, matches, matching, progress=progress)
    label = named_method(result.method, describer.settings())
    title = f"{label}: {pair_words(pair.query.name, pair.database.name)}"
    score = score_words(describer.metric, matching)
    if what == "matrix":
        figure = matrix_figure(pair, result, title=title, note=f"right: {right_words(truth)}", score=score)
    else:
        figure = match_figure(pair, result, title=title, note=match_note(truth, score))
    save_figure(figure, out)
    show_result({"out": str(out)}, as_json)


def _select(route: Path, conditions: str, frames: str, drop_dark: bool, drop_stationary: bool) -> Route:
    from everplace.route.route import open_route
    from everplace.route.selection import Selection, parse_frames, select

    opened = open_route(route)
    names = [name for name in conditions.split(",") if name]
    selection = Selection(parse_frames(frames) if frames else None, drop_dark, drop_stationary)
    return select(opened.choose(names) if names else opened, selection, show_progress())
