"""Frames of several drives, place by place."""

from __future__ import annotations

import numpy as np

from everplace.mapping.place_scores import PlaceFrames


def test_places_lie_in_the_order_of_travel_and_their_frames_in_that_of_the_drives() -> None:
    order = PlaceFrames(np.array([7, 3, -1, 3, 9, 7]), np.array([0.0, 2.0, np.nan, 2.0, 1.0, 0.0]))
    assert order.places.tolist() == [7, 9, 3]
    assert order.rows.tolist() == [0, 5, 4, 1, 3]
    assert order.first.tolist() == [0, 4, 1]
    assert order.positions.tolist() == [0.0, 1.0, 2.0]
    assert len(order) == 3


def test_a_place_is_as_good_as_its_best_frame() -> None:
    order = PlaceFrames(np.array([7, 3, -1, 3, 9, 7]), np.array([0.0, 2.0, np.nan, 2.0, 1.0, 0.0]))
    scores = np.array([[0.1, 0.9, 0.2, 0.3, -0.5], [0.4, 0.0, 0.2, -0.9, -0.8]], np.float32)
    np.testing.assert_array_equal(order.fuse(scores), np.array([[0.9, 0.2, 0.3], [0.4, 0.2, -0.8]], np.float32))


def test_two_places_at_one_position_stay_two() -> None:
    order = PlaceFrames(np.array([5, 2, 5, 2]), np.zeros(4))
    assert order.places.tolist() == [2, 5]
    assert order.fuse(np.array([4, 1, 3, 2], np.float32)).tolist() == [4, 3]


def test_a_condition_that_covers_half_the_route_does_not_hide_the_other_half() -> None:
    """Each place is scored by its best frame, so another frame of it never lowers it."""
    rng = np.random.default_rng(0)
    places = np.concatenate([np.arange(20), np.arange(10)])
    scores = rng.normal(size=(1, 30)).astype(np.float32)
    whole = PlaceFrames(places, places.astype(float))
    half = PlaceFrames(places[:20], places[:20].astype(float))
    fused, before = whole.fuse(scores[:, whole.rows]), half.fuse(scores[:, half.rows])
    assert (fused >= before).all()
    np.testing.assert_array_equal(fused[:, 10:], before[:, 10:])
