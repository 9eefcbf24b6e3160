"""The Gaussian projection: the same numbers everywhere, and cosines that survive it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.nn import functional

from everplace.describe.pretrained import gaussian_projection as projection
from everplace.describe.pretrained.gaussian_projection import GaussianProjection


def test_the_numbers_are_fixed_by_the_seed() -> None:
    # Drawn once from PCG64([0, 0]) and written down: descriptors on disk rest on them.
    known = [1.117622, -1.3871249, -0.4265716, -0.80358726, 0.60142773, -0.07499325, 0.05969319, -0.03200609]
    matrix = GaussianProjection(8, 130).matrix.numpy()
    assert np.allclose(matrix[0], known, atol=1e-6)
    assert np.array_equal(GaussianProjection(8, 130).matrix.numpy(), matrix)
    assert not np.isclose(GaussianProjection(8, 130, seed=1).matrix.numpy(), matrix).any()
    assert len(np.unique(matrix)) == matrix.size  # no stream is used twice


@pytest.mark.parametrize("threads", [1, 3])
def test_threads_do_not_change_it(monkeypatch: pytest.MonkeyPatch, threads: int) -> None:
    expected = GaussianProjection(50, 200).matrix
    monkeypatch.setattr(projection, "usable_cores", lambda: threads)
    assert torch.equal(GaussianProjection(50, 200).matrix, expected)


def test_it_is_the_scaled_matrix_product() -> None:
    project = GaussianProjection(40, 16)
    x = np.random.default_rng(0).normal(size=(3, 40)).astype(np.float32)
    expected = x.astype(np.float64) @ project.matrix.numpy().astype(np.float64).T / 4
    assert np.allclose(project(torch.from_numpy(x)).numpy(), expected, atol=1e-5)
    assert not list(project.parameters())
    assert not project.state_dict()


def test_the_numbers_are_standard_normal() -> None:
    matrix = GaussianProjection(500, 400).matrix.numpy().astype(np.float64)
    n = matrix.size
    assert abs(matrix.mean()) < 4 / n**0.5
    assert abs(matrix.var() - 1) < 4 * (2 / n) ** 0.5
    assert abs((matrix**4).mean() - 3) < 4 * (96 / n) ** 0.5


def test_cosines_survive() -> None:
    # Johnson and Lindenstrauss: an error of about (1 - cosine²) / √K; five times that is never reached by chance.
    project = GaussianProjection(3000, 1024)
    rng = torch.Generator().manual_seed(0)
    a, noise = torch.randn(20, 3000, generator=rng), torch.randn(20, 3000, generator=rng)
    for share in (0.0, 0.5, 2.0):
        b = share * a + noise
        cosine = functional.cosine_similarity(a, b)
        error = functional.cosine_similarity(project(a), project(b)) - cosine
        assert (error.abs() < 5 * (1 - cosine**2) / 32).all()
