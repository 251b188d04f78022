import numpy as np
from fresco.core.geometry.rigid import camera_centre, exp_so3, log_so3, rotation_angle, rotation_between, skew
from hypothesis import given
from hypothesis import strategies as st

vectors = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)


@given(vectors, vectors)
def test_skew_is_the_cross_product(a, b):
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-12)


@given(vectors)
def test_exponential_is_a_rotation_and_log_inverts_it(w):
    r = exp_so3(w)
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(r) > 0
    if np.linalg.norm(w) < np.pi - 1e-3:
        np.testing.assert_allclose(log_so3(r), w, atol=1e-7)
    np.testing.assert_allclose(exp_so3(log_so3(r)), r, atol=1e-7)


def test_exponential_at_tiny_angles_is_exact_to_first_order():
    w = np.array([1e-9, -2e-9, 3e-9])
    np.testing.assert_allclose(exp_so3(w) - np.eye(3), skew(w), atol=1e-17)


def test_exponential_is_vectorised():
    w = np.random.default_rng(0).normal(size=(4, 5, 3))
    np.testing.assert_allclose(exp_so3(w)[2, 3], exp_so3(w[2, 3]))
    np.testing.assert_allclose(rotation_angle(exp_so3(0.1 * w)), np.linalg.norm(0.1 * w, axis=-1))


@given(vectors, vectors)
def test_rotation_between_turns_one_direction_into_the_other(a, b):
    if min(np.linalg.norm(a), np.linalg.norm(b)) < 1e-3:
        return
    r = rotation_between(a, b)
    np.testing.assert_allclose(r @ a / np.linalg.norm(a), b / np.linalg.norm(b), atol=1e-9)
    np.testing.assert_allclose(rotation_between(a, -a) @ a, -a, atol=1e-9)


def test_camera_centre_is_what_maps_to_the_origin():
    r, t = exp_so3([0.3, -1.0, 2.0]), np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(r @ camera_centre(r, t) + t, 0, atol=1e-12)
