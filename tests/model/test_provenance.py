"""What a trained model says of its making, also where its file holds something else than was written."""

from __future__ import annotations

from everplace.model.provenance import plain_values, stems_seen


def test_plain_values_leave_the_lists_out() -> None:
    about = {"recipe": "best", "epoch": 3, "value": 0.5, "grey": True, "trained_stems": ["a"], "weights": {"z": 1}}
    assert plain_values(about) == {"recipe": "best", "epoch": 3, "value": 0.5, "grey": True}


def test_stems_of_both_lists_are_seen() -> None:
    assert stems_seen({"trained_stems": ("a", "b"), "held_out_stems": ["c", "a"]}) == {"a", "b", "c"}


def test_what_is_no_list_of_stems_is_none() -> None:
    assert stems_seen({}) == frozenset()
    assert stems_seen({"trained_stems": "abc", "held_out_stems": [1, "d", None]}) == {"d"}
