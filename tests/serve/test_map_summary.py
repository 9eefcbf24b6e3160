"""What is shown of a map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from everplace.mapping.localizer import Localizer
from everplace.mapping.route_map import Map
from everplace.serve.map_summary import MOST_BINS, binned_most, map_summary, places_per_bin


def summary(address: Path) -> dict[str, Any]:
    opened = Map.open(address)
    shown: dict[str, Any] = json.loads(
        json.dumps(map_summary(opened, Localizer(opened).places, decodes=False), allow_nan=False)
    )
    return shown


@pytest.mark.parametrize(("places", "per_bin", "bins"), [(1, 1, 1), (512, 1, 512), (513, 2, 257), (36_000, 71, 508)])
def test_there_are_never_too_many_bins(places: int, per_bin: int, bins: int) -> None:
    assert places_per_bin(places) == per_bin
    values = np.arange(places, dtype=np.float32)
    most = binned_most(values)
    assert len(most) == bins <= MOST_BINS
    assert most[0] == per_bin - 1
    assert most[-1] == places - 1


def test_the_table_counts_frames_and_shows_holes(
    summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    part = tmp_path / "winter"
    part.mkdir()
    for path in sorted((unchanged_rendered_route / "winter").glob("*.png"))[20:40]:
        (part / path.name).write_bytes(path.read_bytes())
    Map.open(summer_map).add(part, align="names")
    shown = summary(summer_map)
    table = shown["table"]
    assert table["conditions"] == ["summer", "winter"]
    assert table["drives"] == [{"name": name, "condition": name} for name in ("summer", "winter")]
    assert table["cells"] == [[1, int(20 <= place < 40)] for place in range(60)]
    assert shown["frames"] == {"summer": list(range(60)), "winter": list(range(60, 80))}
    learned = shown["learned"]
    assert [(one["placed"], one["new_places"], one["sure"]) for one in learned["drives"]] == [(60, 60, 0), (20, 0, 20)]
    assert learned["pairs"] > 0


def test_poses_are_those_of_the_places(unchanged_three_map: Path) -> None:
    poses = np.array(summary(unchanged_three_map)["poses"])
    table = Map.open(unchanged_three_map).frames("x", "y", "place")
    places, x = np.asarray(table["place"]), np.asarray(table["x"])
    assert poses.shape == (60, 2)
    for place in (0, 30, 59):
        assert poses[place, 0] == pytest.approx(x[places == place].mean())


def test_without_poses_there_are_none(unchanged_tiny_route: Path, tmp_path: Path) -> None:
    Map.create(tmp_path / "map", unchanged_tiny_route / "summer", method="hog16")
    shown = summary(tmp_path / "map")
    assert (shown["poses"], shown["precision"], shown["provisional"]) == (None, None, True)


def test_precision_is_that_of_the_held_out_answers(unchanged_three_map: Path) -> None:
    held_out = Map.open(unchanged_three_map).held_out_answers
    probability, right, on_map = held_out.probability, held_out.right, held_out.on_map
    assert 0 < on_map.sum() < len(on_map)
    rows = summary(unchanged_three_map)["precision"]
    assert len(rows) <= 200
    thresholds = [row["threshold"] for row in rows]
    assert thresholds == sorted(thresholds, reverse=True)
    for row in rows:
        accepted = probability >= np.float32(row["threshold"])
        assert row["precision"] == pytest.approx(right[accepted].mean())
        assert row["recall"] == pytest.approx((right & accepted)[on_map].sum() / on_map.sum())
    assert rows[-1]["recall"] == pytest.approx(right[on_map].mean())
    assert rows[-1]["precision"] == pytest.approx(right.mean())
