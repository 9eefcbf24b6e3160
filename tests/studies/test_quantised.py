"""Descriptors in fewer bytes: each form is as large as it says, and loses more the smaller it is."""

from __future__ import annotations

import numpy as np
import pytest
from studies.quantised import Form, forms

from everplace.match.similarity import directions

RNG = np.random.default_rng(0)
KNOWN = directions(RNG.normal(size=(600, 96)).astype(np.float32))
FORMS = list(forms(KNOWN))


def error(form: Form) -> float:
    return float(np.abs(form.coded(KNOWN) - KNOWN).mean())


def test_every_form_gives_descriptors_of_the_same_size() -> None:
    assert len(FORMS) > 5
    for form in FORMS:
        assert form.coded(KNOWN[:5]).shape == (5, 96)
        assert form.queries_too == form.name.startswith("binary")


@pytest.mark.parametrize("kind", [("float32", "float16", "int8", "int4"), ("product-quantised",)])
def test_fewer_bytes_lose_more(kind: tuple[str, ...]) -> None:
    errors = {form.bytes: error(form) for form in FORMS if form.name in kind}
    assert len(errors) > 3
    ordered = [errors[size] for size in sorted(errors)]
    assert ordered == sorted(ordered, reverse=True)
    assert len(set(ordered)) == len(ordered)


def test_binary_descriptors_are_bits_around_the_map_s_mean() -> None:
    shifted = KNOWN + np.float32(3)
    for form in forms(shifted):
        if form.queries_too:
            bits = form.coded(shifted)
            assert set(np.unique(bits)) == {-1.0, 1.0}
            assert np.abs(bits.mean()) < 0.2, "each bit parts the map"
            assert form.bytes == 12
