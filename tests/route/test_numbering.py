from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from everplace.route.numbering import Gap, find_gaps


@pytest.mark.parametrize(
    ("stems", "gaps"),
    [
        ([], ()),
        (["7"], ()),
        (["1", "2", "3"], ()),
        (["8", "9", "12", "13", "14"], (Gap("9", "12", 2),)),
        (["i-00010_l", "i-00020_l", "i-00050_l", "i-00060_l"], (Gap("i-00020_l", "i-00050_l", 2),)),
        (["0", "10", "20", "25", "30", "40", "52", "62"], (Gap("40", "52", 1),)),
        (["a1", "b2"], None),
        (["1", "x"], None),
        (["x"], None),
        (["1000.10", "1000.21", "1000.30", "1000.42"], None),
        (["01", "1"], None),
    ],
)
def test_known_numberings(stems: list[str], gaps: tuple[Gap, ...] | None) -> None:
    assert find_gaps(stems) == gaps


@given(st.integers(1, 9), st.integers(8, 30), st.sets(st.integers(1, 6), max_size=2))
@settings(max_examples=50, deadline=None)
def test_what_is_left_out_of_even_steps_is_found(step: int, count: int, left_out: set[int]) -> None:
    """Of at least seven steps at most four are lengthened or lost, and the rest are the usual one."""
    numbers = [step * index for index in range(count + 6) if index not in left_out]
    gaps = find_gaps([f"f{number}" for number in numbers])
    assert gaps is not None
    assert sum(gap.missing for gap in gaps) == len(left_out)
    assert all(int(gap.before[1:]) - int(gap.after[1:]) == step * (gap.missing + 1) for gap in gaps)
