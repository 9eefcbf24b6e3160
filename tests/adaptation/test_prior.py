"""The prior: the best of low rank, whole on disk, and refused where it is damaged or of another method."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from safetensors.numpy import save

from everplace.adaptation import prior as module
from everplace.adaptation.prior import Prior, load_prior, require_fitting, save_prior, shipped_prior
from everplace.describe.registry import open_describer
from everplace.errors import CheckpointError, ConfigError


def covariance(features: int, seed: int = 0) -> NDArray[np.float64]:
    mixing = np.random.default_rng(seed).normal(size=(features, features)) * 0.8 ** np.arange(features)
    found: NDArray[np.float64] = mixing @ mixing.T + 0.01 * np.eye(features)
    return found


def small(features: int = 12, **changed: Any) -> Prior:
    made = Prior.of(covariance(features), "hog16", {"cell": 8})
    return Prior(**{**vars(made), **changed})


def test_it_is_the_best_of_its_rank(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "RANK", 5)
    within = covariance(40)
    found = Prior.of(within, "hog16", {}).within()
    values, vectors = np.linalg.eigh(within)
    values[:-5] = values[:-5].mean()
    np.testing.assert_allclose(found, (vectors * values) @ vectors.T, atol=2e-3 * values[-1])
    assert np.trace(found) == pytest.approx(np.trace(within), rel=2e-3)


def test_of_few_numbers_hardly_anything_is_lost() -> None:
    within = covariance(12)
    np.testing.assert_allclose(small().within(), within, atol=2e-3 * within.max())


def test_what_is_written_is_read(tmp_path: Path) -> None:
    prior = small(method="hog16+efficientnet", settings={"0.cell": 8, "1.weights": "ab", "x": 0.5})
    save_prior(tmp_path / "prior.safetensors", prior)
    found = load_prior(tmp_path / "prior.safetensors")
    np.testing.assert_array_equal(found.directions, prior.directions)
    np.testing.assert_array_equal(found.variances, prior.variances)
    assert (found.rest, found.method, found.settings) == (prior.rest, prior.method, prior.settings)
    assert [path.name for path in tmp_path.iterdir()] == ["prior.safetensors"]


def metadata(**changed: str) -> dict[str, str]:
    return {"method": "hog16", "settings": "{}", "rest": "0.1", **changed}


def tensors(**changed: Any) -> dict[str, Any]:
    return {"directions": small().directions, "variances": small().variances, **changed}


def altered(numbers: NDArray[Any], value: float) -> NDArray[Any]:
    found = numbers.copy()
    found.flat[3] = value
    return found


D, S = small().directions, small().variances


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"no safetensors at all",
        save(tensors(), metadata())[:-7],
        save(tensors()),
        save({"weight": D}, metadata()),
        save(tensors(variances=S[:-1]), metadata()),
        save(tensors(directions=D[0]), metadata()),
        save(tensors(directions=D.T.copy()), metadata()),
        save(tensors(directions=altered(D, np.nan)), metadata()),
        save(tensors(directions=altered(D, 30.0)), metadata()),
        save(tensors(variances=altered(S, np.inf)), metadata()),
        save(tensors(variances=altered(S, np.nan)), metadata()),
        save(tensors(variances=altered(S, -1.0)), metadata()),
        save(tensors(), metadata(rest="-1")),
        save(tensors(), metadata(rest="nan")),
        save(tensors(), metadata(rest="inf")),
        save(tensors(), metadata(rest="much")),
        save(tensors(), metadata(settings="[1, 2]")),
        save(tensors(), metadata(settings='[["cell", 8]]')),
        save(tensors(), metadata(settings="{")),
        save(tensors(), metadata(settings="[" * 100_000)),
    ],
)  # fmt: skip
def test_a_damaged_file_is_one_sentence(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "prior").write_bytes(data)
    with pytest.raises(CheckpointError, match="prior is no prior that everplace wrote, or it is damaged; restore it"):
        load_prior(tmp_path / "prior")


@given(at=st.floats(0, 1, exclude_max=True), value=st.integers(0, 255))
@settings(max_examples=60, deadline=None)
def test_whatever_byte_is_altered_numbers_stay_numbers(tmp_path_factory: Any, at: float, value: int) -> None:
    data = bytearray(save(tensors(), metadata()))
    data[int(at * len(data))] = value
    path = tmp_path_factory.mktemp("prior") / "prior"
    path.write_bytes(data)
    try:
        found = load_prior(path)
    except CheckpointError:
        return
    assert np.isfinite(found.within()).all()


@pytest.mark.parametrize("missing", [True, False])
def test_a_file_that_is_none_is_one_sentence(tmp_path: Path, missing: bool) -> None:
    path = tmp_path / "missing" if missing else tmp_path
    with pytest.raises(CheckpointError, match=r"the prior .* cannot be read \((No such|Is a).*\); correct --prior"):
        load_prior(path)


def test_it_fits_its_own_method_alone() -> None:
    prior = small()
    require_fitting(prior, "hog16", {"cell": 8}, 12)
    for other in (("hog", {"cell": 8}, 12), ("hog16", {"cell": 4}, 12), ("hog16", {"cell": 8}, 13)):
        with pytest.raises(ConfigError, match="the prior is of the method hog16 .* --save-prior, or give --prior none"):
            require_fitting(prior, *other)


def test_the_shipped_one_is_of_the_gradients_as_they_are() -> None:
    describer = open_describer("hog16")
    prior = shipped_prior("hog16", describer.settings())
    assert prior is not None
    require_fitting(prior, "hog16", describer.settings(), describer.dimension)
    assert prior.directions.shape == (256, 2048)
    assert np.linalg.eigvalsh(prior.variances[:, None] * (prior.directions @ prior.directions.T.astype(float))).all()
    assert shipped_prior("hog16", {**describer.settings(), "cell": 4}) is None
    assert shipped_prior("hog", {}) is None


def test_the_settings_are_readable_json(tmp_path: Path) -> None:
    save_prior(tmp_path / "prior", small())
    data = (tmp_path / "prior").read_bytes()
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    assert header["__metadata__"]["settings"] == '{"cell": 8}'
