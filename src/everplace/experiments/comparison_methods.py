"""The methods of a comparison: opened, or first fitted on places that are not tested."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from everplace.describe.describer import Describer
from everplace.describe.registry import method_names, open_describer
from everplace.errors import CheckpointError, ConfigError, ImageError, InputError, MethodError, OtherRunError
from everplace.files import readable
from everplace.locking import locked
from everplace.progress import Progress, quiet
from everplace.route.route import Route
from everplace.route.selection import Selection, parse_frames, select, select_maps
from everplace.training.config import FitConfig
from everplace.training.fitted_methods import FITTED_METHODS, build_config, fit_method, require_fittable
from everplace.training.run_directory import require_usable

__all__ = ["Methods", "fit", "fit_and_open", "require_fit_settings", "run_of", "select_tested"]

_FIT_FRAMES = "`fit_frames`"


@dataclass(frozen=True)
class Methods:
    """Opened methods.

    Attributes:
        describers: By label, in the order of the tables.
        sources: By label, what `open_describer` takes to open the method again.
        left_out: By label, methods that could not be opened or fitted, with the reason.
        fit: With what some of them were fitted, as plain values for manifest.json; empty if none was.
    """

    describers: dict[str, Describer]
    sources: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    fit: dict[str, Any] = field(default_factory=dict)


def require_fit_settings(settings: Mapping[str, Any]) -> None:
    """Makes sure that values of `TrainConfig` are in their ranges, whether a method that takes them is chosen or not.

    Raises:
        ConfigError: One is not; the message names it.
    """
    build_config(**settings, model="vae")  # which takes every setting that a comparison gives


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
        ConfigError: There is no method, or a model is to be fitted without --fit-frames, on tested places or on none.
        RouteError: Nothing is left of the route.
    """
    if not methods:
        raise ConfigError("`methods` names no method; give run directories, sad, hog, ..., separated by commas")
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
        out: The directory of the comparison; made when something is fitted.
        settings: Values of `TrainConfig` for the networks that are fitted; FAB-MAP takes its own of them, and looks
            at images as they are stored.
        progress: Told of decoding.

    Raises:
        ConfigError: A setting is wrong, an earlier call used others, no method can run, or `out` is in use.
        MethodError: There is no such method.
        CheckpointError: A run directory is damaged.
        ImageError: An image to fit on cannot be decoded.
        MachineError: Fitting failed, and not by its input.
    """
    labels = _labels(methods)
    opened, left_out = _open([method for method in labels if method not in FITTED_METHODS], progress)
    configs: dict[str, FitConfig] = {
        method: build_config(**_settings_of(method, settings), model=method, frames=fit_frames)
        for method in labels
        if method in FITTED_METHODS
    }
    for method, config in configs.items():
        _require_same_run(out, method, config)
    for method, config in configs.items():  # before anything is fitted, which takes long
        try:
            require_fittable(route, config, progress)
        except InputError as error:
            left_out[method] = str(error)
    if fittable := [method for method in configs if method not in left_out]:
        # Another process that fits here is waited for, and then refused: its methods are no left-out ones.
        with locked(out):
            for method in fittable:
                try:
                    opened[method] = fit(route, configs[method], out, method, progress)
                except (OtherRunError, CheckpointError, ImageError):
                    # The first two are wrong with `out`; a damaged image is to be repaired for all methods.
                    raise
                except InputError as error:
                    left_out[method] = str(error)
    reasons = {label: left_out[method] for method, label in labels.items() if method in left_out}
    if not opened:
        raise ConfigError(f"`methods` {','.join(methods)}: none of them can run: {'; '.join(reasons.values())}")
    found = {method: label for method, label in labels.items() if method in opened}
    return Methods(
        {label: opened[method] for method, label in found.items()},
        {label: str(run_of(out, method)) if method in configs else method for method, label in found.items()},
        reasons,
        {"seed": 0, **settings, "frames": fit_frames} if set(configs) & set(found) else {},
    )


def _open(methods: Sequence[str], progress: Progress) -> tuple[dict[str, Describer], dict[str, str]]:
    """Opens methods that need no fitting; the reasons of those that cannot run beside them."""
    opened: dict[str, Describer] = {}
    left_out: dict[str, str] = {}
    for method in methods:
        try:
            opened[method] = open_describer(method, progress=progress)
        except MethodError as error:
            if method.partition(":")[0] not in method_names():
                raise
            left_out[method] = str(error)
    return opened, left_out


def run_of(out: Path, method: str) -> Path:
    """Where a study keeps the run of a method that it fitted."""
    return out / "runs" / method


def fit(route: Route, config: FitConfig, out: Path, name: str, progress: Progress = quiet) -> Describer:
    """Fits a method into `out`/runs, or goes on where an earlier call with the same settings stood.

    Args:
        route: The route to train on.
        config: The method and how it is fitted.
        out: The directory of the study.
        name: Of the run.
        progress: Told of decoding.

    Raises:
        OtherRunError: An earlier call used other settings or images.
        InputError: The method cannot be fitted to this route; see `everplace.training.fitted_methods.fit_method`.
    """
    run = run_of(out, name)
    _require_same_run(out, name, config)
    is_new = not run.exists()
    try:
        fit_method(route, config, run, resume=True, progress=progress, show=name)
    except OtherRunError as error:
        raise _other_study(out, name, error) from None
    except InputError:
        if is_new:  # what it began would refuse other settings, which may be the remedy
            shutil.rmtree(run, ignore_errors=True)
        raise
    return open_describer(str(run))


def _require_same_run(out: Path, name: str, config: FitConfig) -> None:
    try:
        require_usable(run_of(out, name), config, resume=True)
    except OtherRunError as error:
        raise _other_study(out, name, error) from None


def _other_study(out: Path, name: str, error: OtherRunError) -> OtherRunError:
    return OtherRunError(
        f"{readable(out)} holds a study with other settings ({name}: {error.difference}); name another `out`, or "
        "remove it",
        error.difference,
    )


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
        raise ConfigError(f"{', '.join(fitted)} must be fitted: give `fit_frames` A:B, places that `frames` leaves out")
    total = min(len(traverse) for traverse in route.traverses)
    tested = range(total)[frames if frames is not None else slice(None)]
    fitted_on = range(total)[parse_frames(fit_frames, _FIT_FRAMES)]
    if not fitted_on:
        raise ConfigError(
            f"{_FIT_FRAMES} {fit_frames} holds no place, as {readable(route.root)} has only {total}; begin lower"
        )
    both = set(tested).intersection(fitted_on)
    if both:
        raise ConfigError(
            f"`fit_frames` {fit_frames} and `frames` share {len(both)} places, from {min(both)} to {max(both)}; "
            "a method may not be fitted on the places it is tested on"
        )
