import numpy as np
import pytest
from fresco.core.errors import ScanError
from fresco.core.jobs import drain
from fresco.core.scans.check import Mesh, check_mesh_job
from fresco.core.scans.winding import faces_to_turn, shared_edges
from fresco.core.settings import ScanSettings
from hypothesis import given
from hypothesis import strategies as st


def grid(n=8):
    x, y = np.meshgrid(np.arange(n) * 0.5, np.arange(n) * 0.5)
    vertices = np.stack([x.ravel(), y.ravel(), 0.1 * np.sin(x.ravel())], axis=1)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + n], 1), np.stack([i + 1, i + n + 1, i + n], 1)])
    return vertices, faces.astype(np.int32)


def checked(vertices, faces, sets=None, **settings):
    sets = {name: np.asarray(chosen, dtype=np.int32) for name, chosen in (sets or {}).items()}
    faces = np.asarray(faces, dtype=np.int32)
    mesh = Mesh(
        np.array(vertices, dtype=float), faces, np.arange(len(faces), dtype=np.int32), None, None, sets
    )
    drain(check_mesh_job(mesh, ScanSettings(**settings), "wall.ply"))
    return mesh


def test_clean_mesh_is_left_alone():
    vertices, faces = grid()
    mesh = checked(vertices, faces)
    np.testing.assert_array_equal(mesh.vertices, vertices)
    np.testing.assert_array_equal(mesh.faces, faces)
    assert mesh.report == []


def test_every_defect_is_mended_told_and_followed_by_face_sets():
    vertices, faces = grid()
    count = len(vertices)
    vertices = np.vstack([vertices, [[np.nan, 0, 0], [9, 9, 9], vertices[5], [np.inf, 1, 1]]])
    bad = [[0, 1, count], [3, 3, 4], faces[7], faces[9][::-1], [1, 2, count + 3]]
    order = np.random.default_rng(1).permutation(len(faces) + len(bad))
    soup = np.vstack([faces, bad])[order]
    middle = np.flatnonzero(np.isin(order, np.arange(10, 20)))
    mesh = checked(vertices, soup, {"panel": middle, "ruin": np.flatnonzero(order >= len(faces))})
    assert len(mesh.faces) == len(faces)
    assert sorted(map(tuple, np.sort(mesh.faces, axis=1))) == sorted(map(tuple, np.sort(faces, axis=1)))
    panel = np.sort(mesh.faces[mesh.face_sets["panel"]], axis=1)
    assert sorted(map(tuple, panel)) == sorted(map(tuple, np.sort(faces[10:20], axis=1)))
    np.testing.assert_array_equal(order[mesh.file_faces[mesh.face_sets["panel"]]], order[np.sort(middle)])
    told = " ".join(mesh.report)
    for sentence in (
        "Found 2 vertices with undefined coordinates (NaN or infinite); dropped the 2 faces that use them.",
        "Joined 1 vertices at the same place.",
        "Dropped 1 faces without area.",
        "Dropped 2 faces that were there twice.",
        "Dropped 3 vertices that no face uses.",
    ):
        assert sentence in told


def test_collinear_face_has_no_area_even_far_from_zero():
    vertices, faces = grid()
    line = np.array([[4, 4, 0], [5, 5, 0], [6, 6, 0]]) + 4321.1
    mesh = checked(np.vstack([vertices, line]), np.vstack([faces, [[64, 65, 66]]]))
    assert len(mesh.faces) == len(faces)


@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.45))
def test_turned_faces_are_turned_back(seed, share):
    vertices, faces = grid()
    rng = np.random.default_rng(seed)
    turned = rng.random(len(faces)) < share
    if turned.mean() >= 0.47:
        return
    mesh = checked(vertices, np.where(turned[:, None], faces[:, ::-1], faces))
    normals = np.cross(
        mesh.vertices[mesh.faces[:, 1]] - mesh.vertices[mesh.faces[:, 0]],
        mesh.vertices[mesh.faces[:, 2]] - mesh.vertices[mesh.faces[:, 0]],
    )
    assert (normals[:, 2] > 0).all()
    if turned.any():
        assert mesh.report == [f"Turned over {turned.sum()} faces that looked against their neighbours."]


def test_moebius_strip_is_left_and_told():
    n = 20
    angle = np.arange(n) * 2 * np.pi / n
    rim = lambda s: np.stack(  # noqa: E731
        [
            (1 + s * np.cos(angle / 2)) * np.cos(angle),
            (1 + s * np.cos(angle / 2)) * np.sin(angle),
            s * np.sin(angle / 2),
        ],
        1,
    )
    vertices = np.vstack([rim(-0.3), rim(0.3)])
    i, j = np.arange(n - 1), np.arange(1, n)
    faces = np.vstack(
        [np.c_[i, j, i + n], np.c_[j, j + n, i + n], [[n - 1, n, 2 * n - 1], [n, 0, 2 * n - 1]]]
    )
    mesh = checked(vertices, faces)
    np.testing.assert_array_equal(mesh.faces, faces)
    assert mesh.report == ["1 pieces have only one side (Möbius strip) and were left as they are."]


def test_two_pieces_are_decided_each_for_itself():
    vertices, faces = grid()
    soup = np.vstack([faces, (faces + len(vertices))[:, ::-1]])
    soup[3] = soup[3][::-1]
    soup[-3] = soup[-3][::-1]
    mesh = checked(np.vstack([vertices, vertices + np.array([0, 0, 3])]), soup)
    np.testing.assert_array_equal(np.sort(mesh.faces, axis=1), np.sort(soup, axis=1))
    pairs, same, _ = shared_edges(mesh.faces, len(mesh.vertices))
    assert not same.any() and len(pairs) == 2 * (3 * len(faces) - 28) // 2
    assert mesh.report == ["Turned over 2 faces that looked against their neighbours."]


def test_equal_halves_are_decided_the_same_way_for_both_faces():
    turn, one_sided = faces_to_turn(np.ones(2), np.array([[0, 1]]), np.array([True]))
    assert turn.sum() == 1 and one_sided == 0


def test_weld_distance_joins_a_cut_and_keeps_the_rest():
    vertices, faces = grid()
    cut = faces.copy()
    cut[20:] += len(vertices)
    mesh = checked(np.vstack([vertices, vertices + 0.0004]), cut, weld_distance=0.001)
    assert len(mesh.vertices) == len(vertices)
    assert "less than 1 mm apart" in mesh.report[0]


def test_turn_over_setting():
    vertices, faces = grid()
    np.testing.assert_array_equal(checked(vertices, faces, turn_over=True).faces, faces[:, ::-1])


def test_index_out_of_range_names_face_and_vertex():
    vertices, faces = grid()
    faces[11, 1] = 64
    with pytest.raises(ScanError, match=r"wall\.ply: face 11 refers to vertex 64, but there are only 64"):
        checked(vertices, faces)


def test_nothing_left_says_why():
    with pytest.raises(ScanError, match=r"no usable face is left .*without area"):
        checked([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    with pytest.raises(ScanError, match="no points"):
        checked(np.empty((0, 3)), np.empty((0, 3)))
    with pytest.raises(ScanError, match="all points have undefined"):
        checked([[np.nan, 0, 0]], np.empty((0, 3)))
