"""Polynomial moments of plane shapes by boundary integrals, their derivatives and their noise.

A shape is a set of directed edges a -> b that close into loops, its inside where the area gets positive.
The monomials `x^p y^q`, p + q <= order, come in the order of `exponents`.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy.special

from ..arrays import FloatArray, IndexArray

GAUSS_NODES, GAUSS_WEIGHTS = scipy.special.roots_legendre(3)
GAUSS_NODES, GAUSS_WEIGHTS = 0.5 * (GAUSS_NODES + 1.0), 0.5 * GAUSS_WEIGHTS  # on [0, 1], exact to degree 5

MOST_GRAM_EDGES = 300  # a pixel outline has thousands of alike edges; a sample of them weighs noise as well


@lru_cache(maxsize=16)
def exponents(order: int) -> tuple[IndexArray, IndexArray]:
    """Powers p and q of the monomials up to total degree `order`, by rising degree: two (N,) arrays."""
    pairs = [(degree - q, q) for degree in range(order + 1) for q in range(degree + 1)]
    p, q = np.array(pairs, dtype=np.int64).T
    return p, q


def monomials(points: FloatArray, order: int) -> FloatArray:
    """Values `x^p y^q`: (...,2) -> (...,N)."""
    x, y = points[..., 0], points[..., 1]
    out = np.empty((*points.shape[:-1], (order + 1) * (order + 2) // 2))
    out[..., 0] = 1.0
    start = 0
    for degree in range(1, order + 1):  # x times the block before, then y times its last entry
        here = start + degree
        out[..., here : here + degree] = out[..., start:here] * x[..., None]
        out[..., here + degree] = out[..., here - 1] * y
        start = here
    return out


def monomial_gradients(points: FloatArray, order: int) -> FloatArray:
    """Gradients of the monomials: (...,2) -> (...,N,2)."""
    p, q = exponents(order)
    values = monomials(points, order)
    index = {(int(a), int(b)): n for n, (a, b) in enumerate(zip(p, q, strict=True))}
    lower_p = np.array([index.get((int(a) - 1, int(b)), 0) for a, b in zip(p, q, strict=True)])
    lower_q = np.array([index.get((int(a), int(b) - 1), 0) for a, b in zip(p, q, strict=True)])
    gradient: FloatArray = np.stack([p * values[..., lower_p], q * values[..., lower_q]], axis=-1)
    return gradient


def edge_nodes(starts: FloatArray, ends: FloatArray) -> FloatArray:
    """Gauss nodes of edges: (...,E,2) twice -> (...,E,3,2)."""
    nodes: FloatArray = starts[..., None, :] + GAUSS_NODES[:, None] * (ends - starts)[..., None, :]
    return nodes


def edge_moments(starts: FloatArray, ends: FloatArray, order: int) -> FloatArray:
    """Moments `∫ x^p y^q dx dy` of the shape inside the edges: (...,E,2) twice -> (...,N), exact to order 5.

    Source: Green's theorem, `M_pq = 1/(p+q+2) Σ_edges (a×b) ∫₀¹ x^p y^q ds` (method.md 2.2).
    """
    values = monomials(edge_nodes(starts, ends), order)
    return moments_from_nodes(values, starts, ends, order)


def moments_from_nodes(values: FloatArray, starts: FloatArray, ends: FloatArray, order: int) -> FloatArray:
    """`edge_moments` from monomials already known at the Gauss nodes: values (...,E,3,N)."""
    cross = starts[..., 0] * ends[..., 1] - starts[..., 1] * ends[..., 0]
    weights = (cross[..., None] * GAUSS_WEIGHTS).reshape(*cross.shape[:-1], 1, -1)
    flat = values.reshape(*values.shape[:-3], -1, values.shape[-1])
    p, q = exponents(order)
    moments: FloatArray = (weights @ flat)[..., 0, :] / (p + q + 2)
    return moments


def moment_derivatives(
    values: FloatArray, starts: FloatArray, ends: FloatArray, start_rates: FloatArray, end_rates: FloatArray
) -> FloatArray:
    """Derivatives of the moments when the vertices move: `∮ w (V·n) ds`.

    `values` (...,E,3,N) are the monomials at the nodes, the rates (...,E,2,P) the vertices' derivatives with
    respect to P parameters; returns (...,N,P).
    """
    edge = (ends - starts)[..., None, :, None]
    rates = (
        start_rates[..., None, :, :] + GAUSS_NODES[:, None, None] * (end_rates - start_rates)[..., None, :, :]
    )
    swept = (rates[..., 0, :] * edge[..., 1, :] - rates[..., 1, :] * edge[..., 0, :]) * GAUSS_WEIGHTS[:, None]
    flat = values.reshape(*values.shape[:-3], -1, values.shape[-1])
    derivatives: FloatArray = np.swapaxes(flat, -1, -2) @ swept.reshape(*flat.shape[:-1], -1)
    return derivatives


def boundary_gram(starts: FloatArray, ends: FloatArray, order: int, smoothness: float) -> FloatArray:
    """Covariance (N,N) of the moments under white boundary noise: `∮ w wᵀ ds + α ∮ ∇w·∇wᵀ ds`.

    The second term (α = `smoothness`, in units of the shape) keeps polynomials that vanish on the boundary
    from being trusted without limit.
    """
    stride = max(1, len(starts) // MOST_GRAM_EDGES)
    starts, ends = starts[::stride], ends[::stride]
    nodes = edge_nodes(starts, ends)
    weights = stride * np.linalg.norm(ends - starts, axis=-1)[:, None] * GAUSS_WEIGHTS
    values = monomials(nodes, order).reshape(-1, (order + 1) * (order + 2) // 2)
    gram: FloatArray = values.T @ (values * weights.reshape(-1, 1))
    gradients = monomial_gradients(nodes, order).reshape(len(values), -1, 2)
    for axis in range(2):
        part = gradients[..., axis]
        gram += smoothness * (part.T @ (part * weights.reshape(-1, 1)))
    return gram


@lru_cache(maxsize=4)
def complex_basis(order: int) -> tuple[FloatArray, IndexArray]:
    """Matrix from moments to complex moments `∫ (x+iy)^j (x-iy)^k`, and j - k: (N,N) complex, (N,).

    Turning a shape by θ multiplies complex moment (j, k) by `exp(i (j-k) θ)`.
    """
    p, q = exponents(order)
    index = {(int(a), int(b)): n for n, (a, b) in enumerate(zip(p, q, strict=True))}
    matrix = np.zeros((len(p), len(p)), dtype=np.complex128)
    for row, (j, k) in enumerate(zip(p.tolist(), q.tolist(), strict=True)):
        plus = np.poly1d([1.0]) if j == 0 else np.poly1d([1j, 1.0]) ** j  # powers of y at x = 1
        minus = np.poly1d([1.0]) if k == 0 else np.poly1d([-1j, 1.0]) ** k
        for power, coefficient in enumerate((plus * minus).coeffs[::-1]):
            matrix[row, index[(j + k - power, power)]] += coefficient
    return matrix, p - q  # type: ignore[return-value]


def rotated_moments(moments: FloatArray, angles: FloatArray, order: int) -> FloatArray:
    """Moments of a shape turned by `angles` (rad) about the origin: (N,), (A,) -> (A,N)."""
    matrix, spin = complex_basis(order)
    turned = np.exp(1j * spin * angles[:, None]) * (matrix @ moments)
    result: FloatArray = np.linalg.solve(matrix, turned.T).T.real
    return result
