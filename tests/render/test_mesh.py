from __future__ import annotations

import numpy as np

from everplace.render.buildings import box
from everplace.render.mesh import Material, Mesh, MeshBuilder, Site


def _mesh(*sites: Site) -> Mesh:
    for site in sites:
        box(site, (0, 0), (3.0, 2.0), (0.0, 4.0), Material.BRICK)
    return sites[0].mesh.build(np.random.default_rng(0))


def test_the_faces_of_a_box_look_outwards() -> None:
    mesh = _mesh(Site(MeshBuilder(), 10.0, 5.0, 1.0, 0.7))
    assert len(mesh.corners) == 6
    middles = mesh.corners.mean(axis=1)
    outwards = middles - np.array([10.0, 5.0, 3.0])
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1)
    np.testing.assert_allclose((mesh.normals * outwards).sum(axis=1), np.linalg.norm(outwards, axis=1))


def test_a_site_turns_and_lifts_what_is_built_on_it() -> None:
    site = Site(MeshBuilder(), 10.0, 5.0, 1.0, np.pi / 2)
    np.testing.assert_allclose(site.point(2.0, 0.5, 3.0), (9.5, 7.0, 4.0))


def test_a_stroke_has_two_ends_and_shows_from_all_sides() -> None:
    site = Site(MeshBuilder(), 0.0, 0.0, 0.0, 0.0)
    site.stroke((0, 0, 0), (0, 0, 6), 0.2, Material.WOOD)
    mesh = site.mesh.build(np.random.default_rng(0))
    np.testing.assert_array_equal(mesh.corners[0, :2], [[0, 0, 0], [0, 0, 6]])
    assert mesh.thickness[0] == 0.2
    assert not mesh.normals.any()


def test_faces_are_found_by_the_place_of_their_object() -> None:
    builder = MeshBuilder()
    mesh = _mesh(*(Site(builder, x, 0.0, 0.0, 0.0) for x in (50.0, -20.0, 10.0)))
    assert (np.diff(mesh.anchors[:, 0]) >= 0).all()
    assert set(mesh.between(0, 20).anchors[:, 0]) == {10.0}
    assert len(mesh.between(0, 20).corners) == 6
