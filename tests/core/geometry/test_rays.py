from __future__ import annotations

import numpy as np
import pytest
from fresco.core.geometry.rays import RayCaster

SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("offset", [0.0, 5_000_000.0])
def test_first_hit_gives_face_and_distance_far_from_the_origin(offset):
    shift = np.array([offset, -offset, 200.0])
    caster = RayCaster(SQUARE + shift, FACES)
    origins = np.array([[0.5, -0.25, 3], [-0.5, 0.25, 3], [3, 0, 3]]) + shift
    hits = caster.first_hit(origins, np.tile([0.0, 0, -2], (3, 1)))
    assert hits.face.tolist() == [0, 1, -1]
    np.testing.assert_allclose(hits.distance[:2], 3.0, atol=1e-5)
    assert np.isinf(hits.distance[2])


def test_rays_without_direction_hit_nothing():
    hits = RayCaster(SQUARE, FACES).first_hit([0, 0, 1.0], [[np.nan, 0, 0], [0, 0, 0], [0, 0, -1]])
    assert hits.face[:2].tolist() == [-1, -1]
    assert hits.face[2] >= 0


@pytest.mark.parametrize("offset", [0.0, 5_000_000.0])
def test_a_surface_hides_what_lies_behind_but_not_itself(offset):
    caster = RayCaster(SQUARE + offset, FACES)
    targets = np.array([[0.2, 0.3, 0], [0.2, 0.3, -0.01], [0.2, 0.3, 0.01], [5, 5, -1]]) + offset
    blocked = caster.occluded(np.array([0.0, 0, 4]) + offset, targets)
    assert blocked.tolist() == [False, True, False, False]


def test_tolerance_lets_near_layers_pass():
    caster = RayCaster(SQUARE, FACES)
    target = [[0.2, 0.3, -0.01]]
    assert caster.occluded([0, 0, 4], target)[0]
    assert not caster.occluded([0, 0, 4], target, tolerance=0.02)[0]


def test_an_empty_mesh_hides_nothing():
    caster = RayCaster(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))
    assert not caster.occluded([0, 0, 0], [[1, 0, 0]])[0]
    assert caster.first_hit([0, 0, 0], [[1, 0, 0]]).face[0] == -1


def test_a_sphere_is_hit_where_geometry_says():
    trimesh = pytest.importorskip("trimesh")
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=2.0)
    directions = np.random.default_rng(1).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = RayCaster(sphere.vertices, sphere.faces).first_hit(-5 * directions, directions)
    np.testing.assert_allclose(hits.distance, 3.0, atol=5e-3)
    centres = sphere.vertices[sphere.faces[hits.face]].mean(axis=1)
    assert np.all(np.linalg.norm(centres + 2 * directions, axis=1) < 0.15)
