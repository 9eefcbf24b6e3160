from __future__ import annotations

import random
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from everplace.route.natural_order import natural_key, natural_sorted

stems = st.lists(st.text("019ab-.²é", min_size=1, max_size=6), unique=True, max_size=12)
alike = st.lists(st.integers(0, 3000), unique=True, max_size=12)


@pytest.mark.parametrize(
    "ordered",
    [
        ["9", "10"],
        ["frame2", "frame10"],
        ["01", "1", "2"],
        ["a9b10", "a10b2"],
        ["1", "a", "b1"],
        ["x", "x0", "x00", "x1"],
        ["images-00990", "images-01000"],
        ["0", "1", "2", "10"],
        ["0", "00", "1", "10"],
        ["01", "1", "10"],
        ["a1", "a2", "a11.b", "a12"],
        ["cam1-9", "cam1-10", "cam1-100"],
        ["9.left", "10.left"],
        ["1\n", "2\n", "10\n"],
        ["1305031110.0", "1305031110.125", "1305031110.25", "1305031110.5"],
        ["9.75", "10", "10.0", "10.00", "10.25", "10.5", "11"],
        ["7.9", "7.95", "8.1", "8.15", "12.05"],
        ["0.00000000000000000001", "0.00000000000000000011", "0.1"],
        ["1.5", "1.25.left"],
        ["v1.9", "v1.10"],
        ["1.2.9", "1.2.10"],
    ],
)
def test_known_orders(ordered: list[str]) -> None:
    shuffled = ordered.copy()
    random.Random(1).shuffle(shuffled)
    assert natural_sorted(shuffled) == ordered
    assert natural_sorted(reversed(ordered)) == ordered


@given(stems, st.randoms())
@settings(max_examples=200, deadline=None)
def test_order_is_total_and_the_short_cuts_agree_with_the_key(names: list[str], rng: random.Random) -> None:
    expected = sorted(names, key=natural_key)
    shuffled = names.copy()
    rng.shuffle(shuffled)
    assert natural_sorted(shuffled) == expected
    assert len({natural_key(name) for name in names}) == len(names)


@given(st.lists(st.from_regex(r"[0-9]{1,3}\.[0-9]{1,25}", fullmatch=True), unique=True, max_size=12), st.randoms())
@settings(max_examples=200, deadline=None)
def test_decimal_numbers_are_in_the_order_of_numbers(names: list[str], rng: random.Random) -> None:
    rng.shuffle(names)
    numbers = [Fraction(name) for name in natural_sorted(names)]
    assert numbers == sorted(numbers)


@given(alike, st.sampled_from(["", "frame-", "a1b"]), st.sampled_from(["", "_left", "-2"]), st.booleans())
@settings(max_examples=100, deadline=None)
def test_names_built_alike(numbers: list[int], prefix: str, suffix: str, padded: bool) -> None:
    names = [f"{prefix}{number:{'06' if padded else ''}}{suffix}" for number in numbers]
    assert natural_sorted(names) == sorted(names, key=natural_key)
    assert natural_sorted(names) == [f"{prefix}{number:{'06' if padded else ''}}{suffix}" for number in sorted(numbers)]
