from __future__ import annotations

from dataclasses import asdict

import numpy as np

from everplace.render.look import LOOKS, look_of_drive
from everplace.render.render_config import CONDITIONS


def test_every_condition_has_a_look() -> None:
    assert set(LOOKS) == set(CONDITIONS)


def test_a_condition_is_like_summer_in_what_it_does_not_name() -> None:
    summer, night = asdict(LOOKS["summer"]), asdict(LOOKS["night"])
    assert night["dark"]
    assert not summer["dark"]
    for name in ("grass", "crops", "foliage", "water", "sun_azimuth"):
        assert night[name] == summer[name]


def test_two_drives_under_a_condition_differ_in_light_and_weather_alone() -> None:
    first, second = (asdict(look_of_drive("autumn", np.random.default_rng(seed))) for seed in (1, 2))
    differ = {name for name in first if first[name] != second[name]}
    assert differ == {"sun_azimuth", "sun_elevation", "clouds", "cloud_offset", "exposure", "warmth"}
