"""Methods for a study: opened, or first fitted on places that are not tested."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from everplace.data.route import Route
from everplace.data.selection import Selection, parse_frames, select, select_maps
from everplace.describe.protocol import Describer
from everplace.describe.registry import method_names, open_describer
from everplace.errors import ConfigError, MethodError
from everplace.files import readable
from everplace.progress import Progress, quiet
from everplace.training.methods import FITTED_METHODS, build_config, fit_method

__all__ = ["Methods", "fit", "fit_and_open", "run_of", "select_tested"]


@dataclass(frozen=True)
class Methods:
    """Opened methods.

    Attributes:
        describers: By label, in the order of the tables.
        sources: By label, what `open_describer` takes to open the method again.
        left_out: Methods that could not be opened, with the reason.
    """

    describers: dict[str, Describer]
    sources: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)


def select_tested(
    route: Route, methods: Sequence[str], selection: Selection, fit_frames: str, progress: Progress = quiet
) -> Route:
    """Restricts a route to the places to test on, and makes sure that no method is to be fitted on them.

    Args:
        route: The chosen traverses.
        methods: Run directories, or names of methods.
        selection: The places to test on.
        fit_frames: `A:B`, the places to fit on; they may not overlap the tested ones.
        progress: Told of the decoding that a filter needs.

    Raises:
        ConfigError: There is no method, or a model is to be fitted without --fit-frames or on tested places.
        RouteError: Nothing is left of the route.
    """
    if not methods:
        raise ConfigError("--methods names no method; give run directories, sad, hog, ..., separated by commas")
    if fit_frames:
        parse_frames(fit_frames)
    fitted = [method for method in methods if method in FITTED_METHODS]
    if route.matched_by_stem:
        tested = select_maps(route, selection, progress)
    else:
        # Training takes the shared places, and only the same numbering tells them apart from the tested ones.
        tested = select(route, selection, progress, only_shared=bool(fitted))
    if fitted:
        _require_apart(select(route, replace(selection, frames=None), progress), selection.frames, fit_frames, fitted)
    return tested


def fit_and_open(
    route: Route,
    methods: Sequence[str],
    fit_frames: str,
    out: Path,
    *,
    settings: Mapping[str, Any],
    progress: Progress = quiet,
) -> Methods:
    """Opens every method; those that are named and must be fitted are fitted first, into `out`/runs.

    Args:
        route: The chosen traverses, all of their places.
        methods: Run directories, or names of methods.
        fit_frames: `A:B`, the places to fit on, apart from the tested ones (see `select_tested`).
        out: The directory of the comparison.
        settings: Values of `TrainConfig` for the networks that are fitted; FAB-MAP takes its own of them, and looks
            at images as they are stored.
        progress: Told of decoding.

    Raises:
        ConfigError: A setting is wrong, an earlier call used others, or no method can run.
        MethodError: There is no such method.
    """
    describers: dict[str, Describer] = {}
    sources: dict[str, str] = {}
    left_out: dict[str, str] = {}
    opened: dict[str, Describer] = {}
    for method in methods:  # before anything is fitted, which takes long
        if method in FITTED_METHODS:
            continue
        try:
            opened[method] = open_describer(method, progress=progress)
        except MethodError as error:
            if method.partition(":")[0] not in method_names():
                raise
            left_out[method] = str(error)
    for method, label in _labels(methods).items():
        if method in FITTED_METHODS:
            own = {**_settings_of(method, settings), "model": method, "frames": fit_frames}
            describers[label] = fit(route, own, out, progress)
            sources[label] = str(run_of(out, method))
        elif method in opened:
            describers[label], sources[label] = opened[method], method
    if not describers:
        raise ConfigError(f"--methods {','.join(methods)}: none of them can run: {'; '.join(left_out.values())}")
    return Methods(describers, sources, left_out)


def run_of(out: Path, method: str) -> Path:
    """Where a study keeps the run of a method that it fitted."""
    return out / "runs" / method


def fit(
    route: Route, settings: Mapping[str, Any], out: Path, progress: Progress = quiet, *, name: str = ""
) -> Describer:
    """Fits a method into `out`/runs, or goes on where an earlier call with the same settings stood.

    Args:
        route: The route to train on.
        settings: The method as `model`, and values of its configuration.
        out: The directory of the study.
        progress: Told of decoding.
        name: Of the run; empty: the method's.

    Raises:
        ConfigError: A setting is wrong, or an earlier call used others.
    """
    run = run_of(out, name or str(settings["model"]))
    config = build_config(**settings)
    try:
        fit_method(route, config, run, resume=True, progress=progress, show=True)
    except ConfigError as error:
        if not run.exists():
            raise
        raise ConfigError(
            f"{readable(out)} holds a study with other settings; name another --out, or remove it ({error})"
        ) from None
    return open_describer(str(run))


def _settings_of(method: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """What of the settings of a study's networks a method has too."""
    shared = ("conditions", "drop_dark", "drop_stationary", "seed")
    return {name: value for name, value in settings.items() if method != "fabmap" or name in shared}


def _labels(methods: Sequence[str]) -> dict[str, str]:
    """By method, each counted once, a short name for the tables: of a run directory its last part, made unique."""
    labels: dict[str, str] = {}
    for method in dict.fromkeys(methods):
        # os.path answers False where pathlib raises: an argument too long for a path.
        is_run = method not in FITTED_METHODS and os.path.isdir(method)  # noqa: PTH112
        name = _directory_name(Path(method)) if is_run else method
        label, number = name, 2
        while label in labels.values():
            label, number = f"{name}-{number}", number + 1
        labels[method] = label
    return labels


def _directory_name(path: Path) -> str:
    """The last part of a directory's path; where that is no name, as of "." and "..", the one it stands for."""
    return readable(path.name if path.name not in ("", "..") else path.resolve().name or str(path))


def _require_apart(route: Route, frames: slice | None, fit_frames: str, fitted: Sequence[str]) -> None:
    if not fit_frames:
        raise ConfigError(f"{', '.join(fitted)} must be fitted: give --fit-frames A:B, places that --frames leaves out")
    total = min(len(traverse) for traverse in route.traverses)
    tested = range(total)[frames if frames is not None else slice(None)]
    both = set(tested).intersection(range(total)[parse_frames(fit_frames)])
    if both:
        raise ConfigError(
            f"--fit-frames {fit_frames} and --frames share {len(both)} places, from {min(both)} to {max(both)}; "
            "a method may not be fitted on the places it is tested on"
        )
