import numpy as np
from fresco.core.geometry.moments import (
    boundary_gram,
    edge_moments,
    edge_nodes,
    exponents,
    moment_derivatives,
    monomial_gradients,
    monomials,
    rotated_moments,
)
from hypothesis import given
from hypothesis import strategies as st

POLYGON = np.array([(0.0, 0.0), (1.3, 0.2), (0.9, 1.1), (0.2, 0.7)])
ORDER = 4


def edges(polygon):
    return polygon, np.roll(polygon, -1, axis=0)


def triangle_moments(a, b, c):
    """Moments of a triangle by the recursions of method.md 2.2."""
    from math import factorial

    def coefficient(i, j, points):
        if i < 0 or j < 0:
            return 0.0
        if i == j == 0:
            return 1.0
        (x, y), *rest = points
        value = x * coefficient(i - 1, j, points) + y * coefficient(i, j - 1, points)
        return value + (coefficient(i, j, rest) if rest else 0.0)

    area2 = np.cross(b - a, c - a)
    return [
        area2 * factorial(i) * factorial(j) / factorial(i + j + 2) * coefficient(i, j, [a, b, c])
        for i, j in zip(*exponents(ORDER), strict=True)
    ]


def test_polygon_moments_are_the_sum_of_its_triangles():
    a, b, c, d = POLYGON
    expected = np.add(triangle_moments(a, b, c), triangle_moments(a, c, d))
    np.testing.assert_allclose(edge_moments(*edges(POLYGON), ORDER), expected, rtol=1e-12)


def test_monomial_gradients():
    points = np.random.default_rng(0).normal(size=(7, 2))
    step = 1e-6
    numeric = np.stack(
        [
            (monomials(points + d, ORDER) - monomials(points - d, ORDER)) / (2 * step)
            for d in np.eye(2) * step
        ],
        axis=-1,
    )
    np.testing.assert_allclose(monomial_gradients(points, ORDER), numeric, atol=1e-7)


def test_moment_derivatives_against_finite_differences():
    rates = np.random.default_rng(1).normal(size=(4, 2, 3))
    start, end = edges(POLYGON)
    values = monomials(edge_nodes(start, end), ORDER)
    derivatives = moment_derivatives(values, start, end, rates, np.roll(rates, -1, axis=0))
    for k in range(3):
        step = 1e-6 * rates[..., k]
        numeric = edge_moments(*edges(POLYGON + step), ORDER) - edge_moments(*edges(POLYGON - step), ORDER)
        np.testing.assert_allclose(derivatives[:, k], numeric / 2e-6, atol=1e-8)


@given(st.floats(-7, 7))
def test_rotated_moments(angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    expected = edge_moments(*edges(POLYGON @ turn.T), ORDER)
    found = rotated_moments(edge_moments(*edges(POLYGON), ORDER), np.array([angle]), ORDER)[0]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_gram_is_the_covariance_of_moments_under_boundary_noise():
    generator = np.random.default_rng(2)
    fine = (
        POLYGON[np.repeat(np.arange(4), 100)]
        + (np.roll(POLYGON, -1, axis=0) - POLYGON)[np.repeat(np.arange(4), 100)]
        * np.tile(np.arange(100) / 100, 4)[:, None]
    )
    start, end = edges(fine)
    middle, length = 0.5 * (start + end), np.linalg.norm(end - start, axis=1)
    # Each short edge moves outwards by white noise of unit density.
    noise = generator.normal(size=(20000, len(fine))) / np.sqrt(length)
    change = (noise * length) @ monomials(middle, 2)
    gram = boundary_gram(start, end, 2, 0.0)
    np.testing.assert_allclose(np.cov(change.T), gram, rtol=0.1, atol=0.05)
