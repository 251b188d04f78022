from __future__ import annotations

import numpy as np
from fresco.core.geometry.meshes import (
    barycentric,
    edge_pairs,
    face_blocks,
    face_normals,
    morton_order,
    vertex_normals,
)
from hypothesis import given
from hypothesis import strategies as st


def test_normals_and_areas_of_known_triangles():
    vertices = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 1], [5, 5, 5]])
    normal, area = face_normals(vertices, [[0, 1, 2], [0, 3, 1], [4, 4, 0]])
    np.testing.assert_allclose(normal, [[0, 0, 1], [0, 1, 0], [0, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(area, [3, 1, 0])


def test_vertex_normals_weigh_faces_by_area():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2]])
    normal = vertex_normals(vertices, [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_allclose(normal[0], np.array([2, 0, 1]) / np.sqrt(5), atol=1e-12)
    np.testing.assert_allclose(normal[1], [0, 0, 1])


def test_weights_of_corners_give_the_points_back():
    rng = np.random.default_rng(0)
    triangles, weights = rng.normal(size=(20, 3, 3)), rng.dirichlet(np.ones(3), (20, 5))
    points = weights @ triangles
    np.testing.assert_allclose(barycentric(points, triangles[:, None]), weights, atol=1e-9)
    np.testing.assert_allclose(barycentric(points[:, 0], triangles), weights[:, 0], atol=1e-9)


def test_edge_pairs_find_every_shared_edge_once():
    pairs = edge_pairs([[0, 1, 2], [2, 1, 3], [3, 1, 4], [5, 5, 6]], 7)
    found = {
        (*sorted(face), *edge) for face, edge in zip(pairs.face.tolist(), pairs.vertex.tolist(), strict=True)
    }
    assert found == {(0, 1, 1, 2), (1, 2, 1, 3)}


def test_three_faces_on_one_edge_are_chained():
    pairs = edge_pairs([[0, 1, 2], [0, 1, 3], [0, 1, 4]], 5)
    assert len(pairs.face) == 2
    assert np.unique(pairs.face).tolist() == [0, 1, 2]


@given(st.integers(1, 300), st.integers(0, 2**31))
def test_morton_order_is_a_permutation_that_keeps_neighbours_near(count, seed):
    points = np.random.default_rng(seed).uniform(size=(count, 3)) + 1e6
    order = morton_order(points)
    assert np.array_equal(np.sort(order), np.arange(count))
    if count > 100:
        step = np.linalg.norm(np.diff(points, axis=0), axis=1).mean()
        assert np.linalg.norm(np.diff(points[order], axis=0), axis=1).mean() < 0.7 * step


@given(st.integers(1, 200), st.integers(1, 40), st.integers(0, 2**31))
def test_blocks_enclose_their_faces_and_normals(count, size, seed):
    random = np.random.default_rng(seed)
    corners = random.normal(size=(count, 3, 3)).astype(np.float32)
    normals = random.normal((0, 0, 2), size=(count, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    blocks = face_blocks(corners, normals, size)
    block = np.arange(count) // size
    distance = np.linalg.norm(corners - blocks.centre[block][:, None], axis=2)
    assert np.all(distance <= blocks.radius[block][:, None] * (1 + 1e-5) + 1e-6)
    cosine = np.einsum("fk,fk->f", normals, blocks.axis[block])
    assert np.all(np.arccos(np.clip(cosine, -1, 1)) <= blocks.spread[block] + 1e-3)
