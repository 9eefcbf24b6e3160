"""What is known of how places change before a second drive: the scatter within places on other routes, low rank."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from everplace.errors import CheckpointError, ConfigError
from everplace.files import readable, whole_file
from everplace.regular_files import read_regular

__all__ = ["Prior", "load_prior", "save_prior", "shipped_prior"]

RANK = 256


@dataclass(frozen=True, eq=False)
class Prior:
    """A covariance within places: V diag(s) Vᵀ, and the same variance in all directions beside.

    Attributes:
        directions: V, (R, F) float16, rows of length 1.
        variances: s, (R,) float32, beyond `rest`.
        rest: Variance of every other direction.
        method: Method whose descriptors it is of.
        settings: That method's settings.
    """

    directions: NDArray[np.float16]
    variances: NDArray[np.float32]
    rest: float
    method: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, within: NDArray[np.float64], method: str, settings: Mapping[str, Any]) -> Prior:
        """The best of rank 256 of a covariance F×F."""
        features = len(within)
        rank = min(RANK, features - 1)
        values, vectors = scipy.linalg.eigh(within, subset_by_index=[features - rank, features - 1])
        rest = max(0.0, float(np.trace(within) - values.sum()) / (features - rank))
        return cls(
            vectors.T.astype(np.float16), np.maximum(values - rest, 0).astype(np.float32), rest, method, dict(settings)
        )

    def within(self) -> NDArray[np.float64]:
        """F×F."""
        directions = self.directions.astype(np.float64)
        covariance: NDArray[np.float64] = (directions.T * self.variances) @ directions
        covariance[np.diag_indices(len(covariance))] += self.rest
        return covariance


def save_prior(path: Path, prior: Prior) -> None:
    """Writes a prior as one safetensors file, whole or not at all.

    Raises:
        StorageError: The place cannot be written to.
    """
    import json

    from safetensors.numpy import save

    about = {
        "method": prior.method,
        "settings": json.dumps(dict(prior.settings), sort_keys=True),
        "rest": repr(prior.rest),
    }
    data = save({"directions": prior.directions, "variances": prior.variances}, {"everplace": "prior", **about})
    with whole_file(path) as temporary:
        temporary.write_bytes(data)


def load_prior(path: Path) -> Prior:
    """Reads what `save_prior` wrote.

    Raises:
        CheckpointError: It is missing, or no such file.
    """
    try:
        data = read_regular(path)
    except OSError as error:
        raise CheckpointError(
            f"the prior {readable(path)} cannot be read ({error.strerror}); correct --prior"
        ) from None
    return _parse(data, readable(path))


def shipped_prior(method: str, settings: Mapping[str, Any]) -> Prior | None:
    """The prior that comes with the package for a method of these settings; None: there is none."""
    file = resources.files("everplace.adaptation").joinpath("priors", f"{method}.safetensors")
    if not file.is_file():
        return None
    prior = _parse(file.read_bytes(), f"the shipped prior of {method}")
    return prior if dict(prior.settings) == dict(settings) else None


def require_fitting(prior: Prior, method: str, settings: Mapping[str, Any], features: int) -> None:
    """Makes sure that a prior is of this method.

    Raises:
        ConfigError: It is of another method, or of other settings of it.
    """
    if prior.method != method or dict(prior.settings) != dict(settings) or prior.directions.shape[1] != features:
        raise ConfigError(
            f"the prior is of the method {prior.method} with its settings, not of {method} as it is here; make one "
            "with --save-prior, or give --prior none"
        )


def _parse(data: bytes, name: str) -> Prior:
    import json
    import struct

    from safetensors import SafetensorError
    from safetensors.numpy import load

    broken = f"{name} is no prior that everplace wrote, or it is damaged; restore it, or make one anew"
    try:
        tensors = load(data)
        (length,) = struct.unpack_from("<Q", data)
        about = json.loads(data[8 : 8 + length])["__metadata__"]
        prior = Prior(
            tensors["directions"],
            tensors["variances"],
            float(about["rest"]),
            about["method"],
            json.loads(about["settings"]),
        )
        sound = _is_sound(prior)
    except (SafetensorError, ValueError, LookupError, TypeError, struct.error, RecursionError):
        raise CheckpointError(broken) from None
    if not sound:
        raise CheckpointError(broken)
    return prior


def _is_sound(prior: Prior) -> bool:
    """Whether these are directions of length 1 and variances."""
    rank, _ = prior.directions.shape
    numbers = (*prior.variances.tolist(), prior.rest)
    return (
        isinstance(prior.settings, dict)
        and prior.variances.shape == (rank,)
        and all(0 <= number < np.inf for number in numbers)
        and bool(np.isfinite(prior.directions).all())
        # Half precision keeps three digits.
        and bool((np.abs(np.linalg.norm(prior.directions.astype(np.float64), axis=1) - 1) < 0.01).all())
    )
