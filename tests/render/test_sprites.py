from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.render.look import LOOKS
from everplace.render.sprites import LEVELS, SPRITE_SIZE, VARIANTS, Nursery, Plant


def _alpha(look: str, plant: Plant, variant: int, from_left: bool = True) -> NDArray[np.uint8]:
    return Nursery(LOOKS[look]).picture(plant, variant, from_left)[0][..., 3]


@pytest.mark.parametrize("plant", list(Plant))
def test_every_plant_has_its_pictures(plant: Plant) -> None:
    pictures = Nursery(LOOKS["summer"]).picture(plant, 0, False)
    sides = [picture.shape for picture in pictures]
    assert sides == [(SPRITE_SIZE[0] >> i, SPRITE_SIZE[1] >> i, 4) for i in range(LEVELS)]
    full = pictures[0]
    assert (full[..., :3].max(axis=2) <= full[..., 3]).all()  # premultiplied
    assert 0.05 < (full[..., 3] > 128).mean() < 0.9


def test_a_plant_is_grown_once() -> None:
    nursery = Nursery(LOOKS["summer"])
    assert nursery.picture(Plant.BUSH, 1, True) is nursery.picture(Plant.BUSH, 1, True)


def test_variants_differ() -> None:
    assert (_alpha("summer", Plant.BIRCH, 0) != _alpha("summer", Plant.BIRCH, 1)).any()


@pytest.mark.parametrize("variant", range(VARIANTS))
def test_shapes_of_evergreens_do_not_depend_on_season_or_light(variant: int) -> None:
    shape = _alpha("summer", Plant.CONIFER, variant)
    for look in LOOKS:
        np.testing.assert_array_equal(_alpha(look, Plant.CONIFER, variant, False), shape)


@pytest.mark.parametrize("plant", [plant for plant in Plant if plant != Plant.CONIFER])
def test_crowns_are_thin_in_winter_and_grow_from_the_same_branches(plant: Plant) -> None:
    bare, full = (_alpha(look, plant, 2) > 128 for look in ("winter", "summer"))
    assert bare.sum() < full.sum()
    assert not (bare & ~full).any()  # leaves hide branches, they do not move them
