"""`everplace compare`."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from typing import Annotated

import typer

from everplace.cli import options
from everplace.cli.option_groups import MatchingOptions, RouteOptions, TrainingOptions, TruthOptions, grouped
from everplace.cli.option_names import with_options
from everplace.cli.options import split_names
from everplace.cli.output import (
    named_settings,
    provenance,
    require_directory,
    require_outside,
    show_progress,
    show_result,
    warn,
    warn_of_methods,
)
from everplace.files import readable

__all__ = ["compare"]


@grouped
def compare(
    route: options.RouteArgument,
    *,
    methods: Annotated[
        str,
        typer.Option(
            "--methods",
            metavar="A,B,...",
            help="Run directories, sad, hog, ..., or vae, c-vae, cp-vae, cae, fabmap to fit.",
        ),
    ],
    out: options.OutDirectory,
    places: RouteOptions,
    fit_frames: Annotated[
        str, typer.Option("--fit-frames", metavar="A:B", help="Places to fit methods on that must be fitted.")
    ] = "",
    right: TruthOptions,
    how: MatchingOptions,
    training: TrainingOptions,
    as_json: options.Json = False,
) -> None:
    """Compare methods on all ordered pairs of conditions; DIR gets metrics.json, table.md, pr_curves.png, report.html.

    DIR/manifest.json says what another person needs for the same numbers; a comparison that was stopped goes on.

    Example: everplace compare my-route --methods cp-vae,sad,hog --fit-frames 0:800 --frames 820: --out result
    """
    require_directory(out)
    require_outside(out, route)
    chosen, wanted, selection = places.chosen(route), split_names(methods), places.selection()
    from everplace.experiments.manifest import open_study, require_same_study, require_told
    from everplace.route.selection import parse_frames

    require_told(chosen, right.truth())  # before torch is imported
    if fit_frames:
        parse_frames(fit_frames, "`fit_frames`")
    from everplace.experiments.comparison import compare_methods
    from everplace.experiments.comparison_methods import fit_and_open, require_fit_settings, select_tested
    from everplace.experiments.comparison_report import write_comparison

    progress = show_progress()
    chosen_by = {
        "conditions": places.names, "drop_dark": places.drop_dark, "drop_stationary": places.drop_stationary
    }  # fmt: skip
    settings = chosen_by | training.given()
    with named_settings(settings):
        require_fit_settings(settings)
    tested = select_tested(chosen, wanted, selection, fit_frames, progress)
    split = {**chosen_by, "frames": places.frames}
    study = open_study(tested, right.truth(), how.matching(), split=split, progress=progress)
    require_same_study(out, study)
    ready = fit_and_open(chosen, wanted, fit_frames, out, settings=settings, progress=progress)
    warn_of_methods(ready.describers, tested, study.truth, "Test on others with --frames")
    comparison = compare_methods(study, ready, out, command=_command(), progress=progress)
    reasons = {method: with_options(reason) for method, reason in comparison.left_out.items()}
    comparison = replace(comparison, left_out=reasons, manifest={**comparison.manifest, "left_out": reasons})
    for method, reason in reasons.items():
        warn(f"{method} is left out: {reason}")
    for note in comparison.notes:
        warn(note)
    write_comparison(comparison, out, title=f"Comparison on {chosen.name}", details=provenance())
    if as_json:
        show_result(comparison.metrics(), as_json=True)
    else:
        print((out / "table.md").read_text("utf-8"), end="")


def _command() -> str:
    """The command as it was given, but for the output directory: where it wrote changes no number."""
    arguments = sys.argv[1:]
    for index, argument in enumerate(arguments):
        if argument.startswith("--out="):
            arguments[index] = "--out=DIR"
        elif index and arguments[index - 1] == "--out":
            arguments[index] = "DIR"
    return shlex.join(["everplace", *map(readable, arguments)])
