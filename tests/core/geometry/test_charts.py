import numpy as np
import pytest
from fresco.core.geometry.charts import chart_around


def rays_about(axis, half_angle, count=60):
    generator = np.random.default_rng(3)
    axis = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    side = np.cross(axis, [0.3, 0.5, 0.8])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    turn = generator.uniform(0, 2 * np.pi, count)
    away = np.concatenate([[half_angle] * (count // 2), generator.uniform(0, half_angle, count - count // 2)])
    rim = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other
    return np.cos(away)[:, None] * axis + np.sin(away)[:, None] * rim


@pytest.mark.parametrize(("half_angle", "equal_area"), [(20, False), (50, False), (80, True), (120, True)])
def test_chart_and_its_derivative(half_angle, equal_area):
    rays = rays_about([-0.4, 0.7, -0.5], np.radians(half_angle))
    chart = chart_around(rays)
    assert chart.equal_area is equal_area
    points = rays * 3.0
    flat, jacobian = chart.flatten_with_jacobian(points)
    np.testing.assert_allclose(flat, chart.flatten(points), atol=1e-12)
    assert np.sqrt(np.mean(np.sum(flat**2, axis=1))) == pytest.approx(1.0, abs=0.6)
    step = 1e-6
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        numeric = (chart.flatten(points + shift) - chart.flatten(points - shift)) / (2 * step)
        np.testing.assert_allclose(jacobian[..., axis], numeric, atol=1e-6)


def test_gnomonic_chart_has_no_back():
    chart = chart_around(rays_about([0, 0, 1], 0.3))
    assert np.all(np.isnan(chart.flatten(np.array([[0.0, 0.0, -1.0]]))))
