"""Whether the map of today answers a drive better."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.mapping.drives import copied, images_of, write_drive

from everplace.errors import MapError, RouteError
from everplace.mapping.route_map import Map
from everplace.mapping.version_comparison import compare_versions


def test_a_drive_of_the_map_is_left_out_of_its_own_search(unchanged_three_map: Path) -> None:
    compared = compare_versions(unchanged_three_map, 1, "winter")
    assert (compared.drive, compared.frames, compared.known) == ("winter", 60, 60)
    earlier, newest = compared.versions
    assert (earlier.version, earlier.drives, earlier.taught) == (1, ("summer",), False)
    assert (newest.version, newest.drives, newest.taught) == (3, ("summer", "autumn", "winter"), True)
    assert earlier.recall is not None
    assert newest.recall is not None
    assert newest.recall >= earlier.recall >= 0.7
    assert newest.probability > 0
    assert 0 <= newest.sure <= 1


def test_a_new_drive_with_the_names_of_the_map(unchanged_three_map: Path, unchanged_rendered_route: Path) -> None:
    compared = compare_versions(unchanged_three_map, 1, str(unchanged_rendered_route / "summer"))
    assert compared.drive == "summer"
    other = compare_versions(unchanged_three_map, 2, "summer")
    assert other.known == 60
    assert other.versions[0].recall is not None
    assert other.versions[0].recall >= 0.9  # by autumn


def test_without_names_or_poses_there_is_no_recall(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    drive = write_drive(tmp_path / "drive", images_of(unchanged_rendered_route / "autumn")[:20], first=900)
    compared = compare_versions(unchanged_three_map, 2, str(drive))
    assert (compared.known, compared.frames) == (0, 20)
    assert [one.recall for one in compared.versions] == [None, None]
    assert [one.taught for one in compared.versions] == [False, False]


def test_a_new_drive_whose_places_are_known_by_names(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    drive = copied(unchanged_rendered_route / "autumn", tmp_path / "later", slice(20, 60))
    compared = compare_versions(unchanged_three_map, 1, str(drive))
    assert compared.known == 40
    assert all(one.recall is not None and one.recall >= 0.9 for one in compared.versions)


def test_what_is_not_there_is_told(unchanged_three_map: Path) -> None:
    with pytest.raises(MapError, match="has no version 9"):
        compare_versions(unchanged_three_map, 9, "winter")
    with pytest.raises(RouteError, match="spring"):
        compare_versions(unchanged_three_map, 1, "spring")
    assert Map.open(unchanged_three_map).version == 3
