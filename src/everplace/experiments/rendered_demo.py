"""`everplace demo`: a rendered route, three models, five methods, one report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from everplace.describe.describer import Describer
from everplace.describe.registry import open_describer
from everplace.errors import MapError
from everplace.experiments.comparison import compare_methods
from everplace.experiments.comparison_methods import Methods, fit, run_of
from everplace.experiments.comparison_report import write_comparison
from everplace.experiments.manifest import open_study
from everplace.experiments.recipe_names import named_method
from everplace.mapping.route_map import Map
from everplace.match.matching import Matching
from everplace.model.checkpoint import load_checkpoint
from everplace.plots.canvas import new_figure
from everplace.plots.training_curves import TRAINING_CAPTION, draw_training
from everplace.progress import Progress, quiet, shown
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import open_route
from everplace.route.selection import Selection, parse_frames, select
from everplace.scoring.retrieval import MatchRule
from everplace.threads import usable_cores
from everplace.training.fitted_methods import build_config
from everplace.training.metrics_table import read_metrics

__all__ = ["MAP", "DemoSettings", "run_demo"]

MAP = "map"
"""Directory of the demo's map, of the route's first traverse."""

MODELS: dict[str, dict[str, str]] = {
    "c-vae": {"model": "c-vae"},
    "cp-vae": {"model": "cp-vae"},
    "cp-vae-best": {"model": "cp-vae", "recipe": "best"},
}
"""The models by their labels, with what makes each."""


@dataclass(frozen=True)
class DemoSettings:
    """How large the demo is; by default 2 to 5 minutes on two cores.

    Attributes:
        places: Places of the rendered route.
        trained: Places to train on.
        tested: Places to test on.
        epochs: Epochs of each model.
        rendered: Height and width of the frames on disk.
        seen: Height and width of the frames as the models see them.
    """

    places: int = 640
    trained: str = "0:500"
    tested: str = "520:"
    epochs: int = 12
    rendered: tuple[int, int] = (64, 128)
    seen: tuple[int, int] = (32, 64)


def run_demo(
    out: Path,
    settings: DemoSettings | None = None,
    *,
    details: dict[str, str],
    progress: Progress = quiet,
) -> dict[str, Any]:
    """Renders a route in summer and winter, trains C-VAE and CP-VAE (both recipes), compares them with SAD and HOG.

    Makes a map of the summer too.

    Args:
        out: The directory to fill; a demo that was stopped goes on where it stood.
        settings: How large it is.
        details: Command and version, for the head of the report.
        progress: Told of every step that takes more than two seconds.

    Returns:
        The content of metrics.json.

    Raises:
        StorageError: `out` cannot be written to.
    """
    settings = settings or DemoSettings()
    route_directory = out / "route"
    if not route_directory.exists():
        world = render_config(
            {"places": settings.places, "size": settings.rendered, "conditions": ("summer", "winter")}
        )
        render_route(route_directory, world, progress=progress, workers=usable_cores())
    route = open_route(route_directory)
    describers: dict[str, Describer] = {}
    curves = {}
    chosen = {}
    for label, model in MODELS.items():
        run = run_of(out, label)
        config = build_config(**model, frames=settings.trained, image_size=settings.seen, epochs=settings.epochs)
        describers[label] = fit(route, config, out, label, progress)
        curves[label] = read_metrics(run)
        chosen[label] = load_checkpoint(run).about["epoch"]
    describers |= {name: open_describer(name) for name in ("sad", "hog")}
    tested = select(route, Selection(parse_frames(settings.tested)), progress)
    sources = {label: str(run_of(out, label)) if label in MODELS else label for label in describers}
    study = open_study(tested, MatchRule(), Matching(), split={"frames": settings.tested}, progress=progress)
    comparison = compare_methods(
        study,
        Methods(describers, sources, fit={"frames": settings.trained}),
        out,
        command=details.get("command", ""),
        progress=progress,
    )
    title = "everplace demo: a rendered route, summer and winter"
    report = shown(progress, "the report", lambda: write_comparison(comparison, out, title=title, details=details))
    for label, metrics in progress(curves.items(), "curves of the training", len(curves)):
        figure = new_figure(10)
        draw_training(figure, metrics, chosen=chosen[label])
        named = named_method(label, describers[label].settings())
        report.section(f"Training of {named}").figure(
            figure, alt=f"Terms of the bound of {named} over the epochs.", caption=TRAINING_CAPTION
        )
    report.write(out / "report.html")
    try:
        Map.open(out / MAP)
    except MapError:
        Map.create(out / MAP, route.traverses[0], method="hog16", progress=progress)
    return comparison.metrics()
