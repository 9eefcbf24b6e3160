from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from everplace.errors import ConfigError, ImageError, RouteError
from everplace.images.decoding import ImageSpec
from everplace.route.pack import pack
from everplace.route.route import Route, open_route
from everplace.route.selection import Selection, dark_places, parse_frames, select, select_maps, stationary_places

BOTH = Selection(drop_dark=True, drop_stationary=True)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0:1600", slice(0, 1600)),
        ("1620:", slice(1620, None)),
        (":500", slice(None, 500)),
        (":", slice(None, None)),
        (" 3:4 ", slice(3, 4)),
    ],
)
def test_parse_frames(text: str, expected: slice) -> None:
    assert parse_frames(text) == expected


@pytest.mark.parametrize("text", ["", "5", "-3:5", "0:-1", "a:b", "1:2:3", "5:5", "9:3", ":0", "1.5:2", "1 :2", "²:3"])
def test_nonsense_frames(text: str) -> None:
    with pytest.raises(ConfigError, match="`frames`"):
        parse_frames(text)


def test_a_number_longer_than_python_reads() -> None:
    with pytest.raises(ConfigError, match="`frames` holds a number of thousands of digits"):
        parse_frames("0:" + "9" * 10_000)


def flat(*levels: int) -> NDArray[np.uint8]:
    return np.repeat(np.array(levels, dtype=np.uint8), 32 * 64).reshape(-1, 32, 64, 1)


def test_dark_in_any_traverse_and_exactly_at_the_bound() -> None:
    assert dark_places([flat(24, 25, 200, 10), flat(200, 25, 24, 0)]).tolist() == [True, False, True, True]


def test_the_last_kept_place_counts_not_the_last_place() -> None:
    """A slow drift: each frame is like the one before, but not like the one three before."""
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 32 * 64))
    frames = np.stack([np.cos(t) * a + np.sin(t) * b for t in np.arange(8) * 0.2])
    pixels = np.clip(128 + 30 * frames, 0, 255).astype(np.uint8).reshape(8, 32, 64, 1)
    assert np.cos(0.2) > 0.95 > np.cos(0.4)
    assert stationary_places([pixels]).tolist() == [False, True] * 4


def test_stationary_only_where_every_traverse_stands() -> None:
    rng = np.random.default_rng(1)
    moving = rng.integers(0, 256, (4, 8, 8), dtype=np.uint8)
    standing = np.repeat(moving[:1], 4, axis=0)
    assert stationary_places([standing]).tolist() == [False, True, True, True]
    assert stationary_places([standing, moving]).tolist() == [False] * 4


def test_places_dropped_before_are_passed_over() -> None:
    rng = np.random.default_rng(2)
    one, two = rng.integers(0, 256, (2, 8, 8), dtype=np.uint8)
    pixels = np.stack([one, two, one, two, two])
    candidates = np.array([True, False, True, True, True])
    assert stationary_places([pixels], candidates).tolist() == [False, False, True, False, True]


def test_flat_pictures_are_like_nothing() -> None:
    assert not stationary_places([flat(0, 0, 90, 90)]).any()


def test_stationary_against_numpy_over_several_blocks() -> None:
    rng = np.random.default_rng(3)
    scenes = rng.integers(0, 256, (3, 6, 5), dtype=np.uint8)
    frames = [scenes[i] for i in rng.integers(0, 3, 1300)]
    noisy = np.stack([np.clip(f + rng.normal(0, 12, f.shape), 0, 255) for f in frames]).astype(np.uint8)
    last, expected = noisy[0], [False]
    for frame in noisy[1:]:
        expected.append(bool(np.corrcoef(frame.ravel(), last.ravel())[0, 1] > 0.95))
        last = last if expected[-1] else frame
    assert stationary_places([noisy]).tolist() == expected
    assert 200 < sum(expected) < 1100


def spoil(route: Path, name: str, level: int) -> None:
    Image.new("RGB", (64, 32), (level, level, level)).save(route / name)


def stems(route: Route) -> set[tuple[str, ...]]:
    return {traverse.stems for traverse in route.traverses}


def test_filters_then_slice(tiny_route: Path) -> None:
    spoil(tiny_route, "winter/3.png", 5)
    for condition in ("summer", "winter"):
        (tiny_route / condition / "8.png").write_bytes((tiny_route / condition / "7.png").read_bytes())
    route = open_route(tiny_route)

    kept = ("0", "1", "2", "4", "5", "6", "7", "9", "10", "11")
    assert stems(select(route, BOTH)) == {kept}
    assert stems(select(route, Selection(slice(3, 7), True, True))) == {("4", "5", "6", "7")}
    assert stems(select(route, Selection(slice(3, 5)))) == {("3", "4")}
    assert stems(select(route, Selection(drop_dark=True))) == {tuple(str(i) for i in range(12) if i != 3)}
    assert stems(select(route, Selection(drop_stationary=True))) == {tuple(str(i) for i in range(12) if i != 8)}


def test_positions_count_among_shared_stems(tiny_route: Path) -> None:
    (tiny_route / "summer" / "0.png").unlink()
    (tiny_route / "winter" / "5.png").unlink()
    route = open_route(tiny_route)
    assert stems(select(route, Selection())) == {("1", "2", "3", "4", "6", "7", "8", "9", "10", "11")}
    assert stems(select(route, Selection(slice(3, 6)))) == {("4", "6", "7")}


def test_traverses_without_shared_stems_are_filtered_alone(tiny_route: Path) -> None:
    for path in (tiny_route / "winter").iterdir():
        path.rename(path.with_name(f"w{path.name}"))
    spoil(tiny_route, "winter/w0.png", 0)
    summer, winter = select(open_route(tiny_route), Selection(slice(0, 2), drop_dark=True)).traverses
    assert summer.stems == ("0", "1")
    assert winter.stems == ("w1", "w2")


def test_nothing_left(tiny_route: Path) -> None:
    with pytest.raises(RouteError, match="has only 12 places left"):
        select(open_route(tiny_route), Selection(slice(12, None)))
    for place in range(12):
        spoil(tiny_route, f"summer/{place}.png", 0)
    with pytest.raises(RouteError, match="all 12 places of .* are dark"):
        select(open_route(tiny_route), BOTH)


def test_a_broken_frame_is_named_only_when_a_filter_needs_it(tiny_route: Path) -> None:
    (tiny_route / "winter" / "4.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    route = open_route(tiny_route)
    assert len(select(route, Selection(slice(0, 6))).traverses[0]) == 6
    with pytest.raises(ImageError, match=r"winter/4\.png"):
        select(route, BOTH)


@pytest.mark.parametrize(
    ("selection", "places"),
    [
        (BOTH, 2002),
        (Selection(), 2384),
        (Selection(slice(1620, None), True, True), 382),
    ],
)
def test_nordland_as_its_readme_says(shared_data: Path, selection: Selection, places: int) -> None:
    chosen = select(open_route(shared_data / "nordland64"), selection)
    assert [len(traverse) for traverse in chosen.traverses] == [places, places]


def test_nordland_filter_is_the_native_image(shared_data: Path) -> None:
    winter = open_route(shared_data / "nordland64")["winter"][:8]
    stored = np.stack([np.asarray(Image.open(path))[:, :, :1] for path in winter.paths])
    np.testing.assert_array_equal(pack(winter, ImageSpec(size=(32, 64), grey=True)).pixels, stored)


def with_map(root: Path, asked: set[int]) -> Route:
    """A route of 12 summer frames, the map, and only some winter frames."""
    for place in set(range(12)) - asked:
        (root / "winter" / f"{place}.png").unlink()
    return open_route(root)


@pytest.mark.parametrize(
    ("frames", "winter", "summer"),
    [
        (None, "2 5 9", "0 1 2 3 4 5 6 7 8 9 10 11"),
        (slice(0, 1), "2", "0 1 2 3 4"),
        (slice(1, 2), "5", "5 6 7 8"),
        (slice(1, None), "5 9", "5 6 7 8 9 10 11"),
        (slice(2, 9), "9", "9 10 11"),
    ],
)
def test_a_map_keeps_its_frames_between_the_chosen_places(
    tiny_route: Path, frames: slice | None, winter: str, summer: str
) -> None:
    chosen = select_maps(with_map(tiny_route, {2, 5, 9}), Selection(frames))
    assert chosen["winter"].stems == tuple(winter.split())
    assert chosen["summer"].stems == tuple(summer.split())


def test_filters_judge_frames_that_only_the_map_has_by_the_map_alone(tiny_route: Path) -> None:
    route = with_map(tiny_route, {2, 5, 9})
    black = Image.new("RGB", (64, 32))
    black.save(tiny_route / "summer" / "7.png")
    black.save(tiny_route / "winter" / "5.png")
    (tiny_route / "summer" / "3.png").write_bytes((tiny_route / "summer" / "2.png").read_bytes())
    chosen = select_maps(route, BOTH)
    assert chosen["winter"].stems == ("2", "9")
    assert chosen["summer"].stems == ("0", "1", "2", "4", "6", "8", "9", "10", "11")
    assert select_maps(route, Selection(slice(1, 2), True))["summer"].stems == ("9", "10", "11")


@pytest.mark.parametrize("asked", [set(range(12)), {3, 4, 40}])
def test_drives_that_are_not_nested_keep_what_they_share(tiny_route: Path, asked: set[int]) -> None:
    for place in asked - set(range(12)):
        (tiny_route / "winter" / f"{place}.png").write_bytes((tiny_route / "winter" / "0.png").read_bytes())
    route = with_map(tiny_route, asked)
    selection = Selection(slice(1, None), drop_stationary=True)
    stems = [traverse.stems for traverse in select_maps(route, selection).traverses]
    assert stems == [traverse.stems for traverse in select(route, selection).traverses]
    assert stems[0] == stems[1]


@pytest.mark.parametrize(("lacking", "kept"), [(1, [11, 11]), (5, [7, 7]), (6, [12, 6]), (9, [12, 3])])
def test_only_a_drive_with_twice_the_frames_is_a_map(tiny_route: Path, lacking: int, kept: list[int]) -> None:
    route = with_map(tiny_route, set(range(lacking, 12)))
    assert [len(traverse) for traverse in select_maps(route, Selection()).traverses] == kept


@pytest.mark.parametrize(
    ("frames", "says"),
    [
        (":800", "`frames` ends at 800, but .*tiny has only 12 places, so 12 take part"),
        ("4:13", "`frames` ends at 13, but .*tiny has only 12 places, so 8 take part"),
        ("11:9999", "`frames` ends at 9999, but .*tiny has only 12 places, so 1 take part"),
    ],
)
@pytest.mark.parametrize("shared", [True, False])
def test_a_slice_that_ends_behind_the_last_place_is_told(
    unchanged_tiny_route: Path, frames: str, says: str, shared: bool
) -> None:
    route = open_route(unchanged_tiny_route)
    with pytest.warns(UserWarning, match=says):
        select(route, Selection(parse_frames(frames)), only_shared=shared)


@pytest.mark.parametrize("frames", [":12", "3:", ":", "0:5"])
def test_a_slice_that_ends_on_the_route_is_not_told(unchanged_tiny_route: Path, frames: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        select(open_route(unchanged_tiny_route), Selection(parse_frames(frames)))
