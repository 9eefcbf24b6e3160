"""`everplace compare`."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from everplace.cli.options import (
    DropDark,
    DropStationary,
    Epochs,
    Frames,
    Grey,
    ImageSize,
    Json,
    Minutes,
    OutDirectory,
    Radius,
    RouteArgument,
    Seed,
    Sequence,
    SequenceSearch,
    Standardise,
    Tolerance,
)  # fmt: skip
from everplace.cli.output import (
    named_settings,
    one_of,
    provenance,
    require_directory,
    require_one_length,
    require_outside,
    show_progress,
    show_result,
    warn,
)
from everplace.files import readable

if TYPE_CHECKING:
    from everplace.describe.describer import Describer
    from everplace.route.route import Route

__all__ = ["compare", "register"]


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("compare")(compare)


def compare(
    route: RouteArgument,
    methods: Annotated[
        str,
        typer.Option(
            "--methods",
            metavar="A,B,...",
            help="Run directories, sad, hog, ..., or vae, c-vae, cp-vae, cae, fabmap to fit.",
        ),
    ],
    out: OutDirectory,
    frames: Frames = "",
    fit_frames: Annotated[
        str, typer.Option("--fit-frames", metavar="A:B", help="Places to fit methods on that must be fitted.")
    ] = "",
    conditions: Annotated[
        str, typer.Option("--conditions", metavar="A,B", help="Traverses or conditions to compare between [all].")
    ] = "",
    tolerance: Tolerance = None,
    radius: Radius = None,
    drop_dark: DropDark = False,
    drop_stationary: DropStationary = False,
    standardise: Standardise = None,
    sequence: Sequence = 1,
    sequence_method: SequenceSearch = "filter",
    image_size: ImageSize = None,
    grey: Grey = False,
    epochs: Epochs = None,
    minutes: Minutes = None,
    seed: Seed = None,
    as_json: Json = False,
) -> None:
    """Compare methods on all ordered pairs of conditions; DIR gets metrics.json, table.md, pr_curves.png, report.html.

    DIR/manifest.json says what another person needs for the same numbers; a comparison that was stopped goes on.

    Example: everplace compare my-route --methods cp-vae,sad,hog --fit-frames 0:800 --frames 820: --out result
    """
    how = one_of(standardise, "--standardise", ("centre", "full"))
    search = one_of(sequence_method, "--sequence-method", ("filter", "seqslam", "mean"))
    require_one_length(epochs, minutes)
    require_directory(out)
    require_outside(out, route)
    from everplace.experiments.comparison import compare_methods
    from everplace.experiments.comparison_report import write_comparison
    from everplace.experiments.fitting import fit_and_open, require_fit_settings, select_tested
    from everplace.experiments.manifest import open_study, require_same_study
    from everplace.route.route import open_route
    from everplace.route.selection import Selection, parse_frames
    from everplace.scoring.retrieval import Matching, Truth

    opened = open_route(route)
    names = tuple(name for name in conditions.split(",") if name)
    chosen = opened.choose(names) if names else opened
    wanted = [name for name in methods.split(",") if name]
    selection = Selection(parse_frames(frames) if frames else None, drop_dark, drop_stationary)
    chosen_by = {"conditions": names, "drop_dark": drop_dark, "drop_stationary": drop_stationary}
    given = {"image_size": image_size, "grey": grey or None, "seed": seed, "epochs": epochs, "minutes": minutes}
    settings = {**chosen_by, **{key: value for key, value in given.items() if value is not None}}
    with named_settings(settings):
        require_fit_settings(settings)
    tested = select_tested(chosen, wanted, selection, fit_frames, show_progress())
    study = open_study(
        tested,
        Truth(tolerance, radius),
        Matching(how, sequence, search),
        split={**chosen_by, "frames": frames},
        progress=show_progress(),
    )
    require_same_study(out, study)
    ready = fit_and_open(chosen, wanted, fit_frames, out, settings=settings, progress=show_progress())
    _warn_of_seen_places(ready.describers, tested)
    comparison = compare_methods(study, ready, out, command=_command(), progress=show_progress())
    for method, reason in comparison.left_out.items():
        warn(f"{method} is left out: {reason}")
    for note in comparison.notes:
        warn(note)
    write_comparison(comparison, out, title=f"Comparison on {opened.name}", details=provenance())
    if as_json:
        show_result(comparison.metrics(), as_json=True)
    else:
        print((out / "table.md").read_text("utf-8"), end="")


def _warn_of_seen_places(describers: Mapping[str, Describer], tested: Route) -> None:
    from everplace.experiments.evaluation import seen_places, seen_sentence

    for label, describer in describers.items():
        if seen := seen_places(describer, tested):
            warn(f"{seen_sentence(label, seen)} Test on others with --frames")


def _command() -> str:
    """The command as it was given, but for the output directory: where it wrote changes no number."""
    arguments = sys.argv[1:]
    for index, argument in enumerate(arguments):
        if argument.startswith("--out="):
            arguments[index] = "--out=DIR"
        elif index and arguments[index - 1] == "--out":
            arguments[index] = "DIR"
    return shlex.join(["everplace", *map(readable, arguments)])
