"""Which methods are fitted, and by what: networks by the training loop, FAB-MAP by counting."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from everplace.errors import ConfigError
from everplace.model.model_config import MODEL_KINDS
from everplace.progress import Progress, quiet
from everplace.route.route import Route
from everplace.settings import explained_toml
from everplace.training.config import DEFAULT_EPOCHS, FitConfig, TrainConfig
from everplace.training.select_route import select_route

if TYPE_CHECKING:
    from everplace.training.fit import TrainSummary
    from everplace.training.fit_fabmap import FabMapSummary

__all__ = ["FITTED_METHODS", "build_config", "fit_method", "require_fittable", "settings_toml", "train"]

FITTED_METHODS: tuple[str, ...] = (*MODEL_KINDS, "fabmap")
"""What `everplace train --model` takes."""

_NOT_FOR_FABMAP = ("epochs", "minutes", "recipe", "grey")


def build_config(**values: Any) -> FitConfig:
    """The configuration of a fitted method; a network without a length gets the default one.

    Args:
        values: `model`, one of `FITTED_METHODS`, and fields of its configuration.

    Raises:
        ConfigError: A key does not exist or a value is out of its range; the message names it.
    """
    if values.get("model") == "fabmap":
        from everplace.training.fit_fabmap import FabMapTrainConfig

        for name in _NOT_FOR_FABMAP:
            if name in values:
                raise ConfigError(f"`{name}` does not apply to fabmap, which is fitted in two passes; leave it out")
        return FabMapTrainConfig.build(**values)
    if "epochs" not in values and "minutes" not in values:
        values["epochs"] = DEFAULT_EPOCHS
    return TrainConfig.build(**values)


def train(
    route: Route,
    model: str,
    out: str | os.PathLike[str],
    *,
    resume: bool = False,
    show: bool = False,
    progress: Progress = quiet,
    **settings: Any,
) -> TrainSummary | FabMapSummary:
    """Fits a method on a route into a run directory, which `everplace.load` opens.

    Args:
        route: An opened route.
        model: One of `FITTED_METHODS`, such as "cp-vae".
        out: The run directory.
        resume: Continue where the run stands.
        show: Show the training on stderr.
        progress: Told of decoding.
        settings: Everything that `everplace train --settings MODEL` prints, such as `recipe="best"`, `epochs=20`,
            `frames=":800"` or `image_size=(64, 128)`.

    Raises:
        ConfigError: There is no such model, a setting is wrong, or `out` holds another run.
        RouteError: The route does not have what the method needs.
        ImageError: A frame cannot be decoded.
        StorageError: The run directory cannot be written to.
    """
    if model not in FITTED_METHODS:
        raise ConfigError(f"model {model!r} is not known; choose {' or '.join(FITTED_METHODS)}")
    config = build_config(model=model, **settings)
    return fit_method(route, config, Path(out), resume=resume, show=show, progress=progress)


def settings_toml(model: str) -> str:
    """All settings of a fitted method with their explanations and defaults, as a file that `--config` takes.

    Args:
        model: One of `FITTED_METHODS`, or `best` for the recipe of that name.
    """
    given = {"model": "cp-vae", "recipe": "best"} if model == "best" else {"model": model}
    return explained_toml(build_config(**given))


def require_fittable(route: Route, config: FitConfig, progress: Progress = quiet) -> None:
    """Makes sure of what can be known before a method is fitted; what SIFT finds in the images cannot.

    Args:
        route: An opened route; the configuration chooses from it.
        config: As `build_config` made it.
        progress: Told of the decoding that a filter needs.

    Raises:
        RouteError: The route does not have what the method needs.
        ConfigError: The conditions do not suit the method.
        ImageError: A filter needs a frame that cannot be decoded.
    """
    if isinstance(config, TrainConfig):
        from everplace.training.fit import require_trainable

        require_trainable(route, config, progress)
    else:
        select_route(route, config, progress)


def fit_method(
    route: Route,
    config: FitConfig,
    out: Path,
    *,
    resume: bool = False,
    devices: int = 1,
    nodes: int = 1,
    save_every: float = 60.0,
    progress: Progress = quiet,
    show: bool | str = False,
) -> TrainSummary | FabMapSummary:
    """Fits a method into a run directory; see `everplace.training.fit.train` and `everplace.training.fit_fabmap`.

    Args:
        route: An opened route; the configuration chooses from it.
        config: As `build_config` made it.
        out: The run directory.
        resume: Continue where the run stands.
        devices: Devices on this machine, for networks.
        nodes: Machines, for networks.
        save_every: Seconds between two states of a network to resume from.
        progress: Told of decoding.
        show: Show the training on stderr; text: under this name.

    Raises:
        ConfigError: FAB-MAP is to be fitted on several devices, or as the two say.
    """
    if isinstance(config, TrainConfig):
        from everplace.training.fit import train

        return train(
            route, config, out, resume=resume, devices=devices, nodes=nodes, save_every=save_every, progress=progress,
            show=show,
        )  # fmt: skip
    from everplace.training.fit_fabmap import FabMapTrainConfig, fit_fabmap

    assert isinstance(config, FabMapTrainConfig)
    if devices * nodes > 1:
        raise ConfigError(
            "`devices` and `nodes` do not apply to fabmap, which is fitted by one process; leave them out"
        )
    return fit_fabmap(route, config, out, resume=resume, progress=progress)
