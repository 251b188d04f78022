"""Adjusting cameras and planes together: to homographies, to the moments of regions, to their outlines."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..arrays import BoolArray, FloatArray
from ..pose.regions.contour import lock_ratio
from .estimate import LOCKED, NEAR, outline_step
from .network import Link, Network
from .starts import Maps, carried_rays
from .views import moment_residuals, outline_distances, overlap_error, sampled_rays

_SCALES = (8.0, 6.0, 4.5, 3.4, 2.5, 1.9, 1.4, 1.0, 1.0, 1.0)  # pixels, of the steps on outlines
_ROUNDS_BY_MAPS = 60
_MOST_DAMPED = 1e6

Equations = tuple[FloatArray, FloatArray]
"""Residuals (e,) of a link and their derivatives (e,15) to the link's parameters."""

Terms = Callable[[Network, Link], Equations]


def by_maps(network: Network, maps: Maps) -> tuple[Network, dict[Link, float]]:
    """The network that carries rays of regions nearest to where homographies do; how far off (rad) each is.

    Of several homographies of a link the nearest counts.
    """
    samples = {link: sampled_rays(link.views[0]) for link in maps}
    targets = {link: [carried_rays(samples[link], matrix) for matrix in maps[link]] for link in maps}

    def terms(current: Network, link: Link) -> Equations:
        rays, rates = current.carried(link, samples[link])
        length = np.linalg.norm(rays, axis=1, keepdims=True)
        unit = rays / length
        target = min(targets[link], key=lambda each: float(np.sum((unit - each) ** 2)))
        along = np.einsum("ni,nip->np", unit, rates)
        slope = (rates - unit[:, :, None] * along[:, None]) / length[:, :, None]
        return (unit - target).ravel(), slope.reshape(-1, slope.shape[2])

    found = _descended(network, list(maps), terms, _ROUNDS_BY_MAPS)[0]
    return found, {link: float(np.sqrt(3 * np.mean(terms(found, link)[0] ** 2))) for link in maps}


def by_moments(network: Network, links: Sequence[Link], order: int, rounds: int) -> Network:
    """The network at which the moments up to an order agree best, both ways."""

    def terms(current: Network, link: Link) -> Equations:
        return moment_residuals(link.views[1], *current.carried(link), link.views[0].following, order)

    return _descended(network, _both_ways(links), terms, rounds)[0]


def by_outlines(network: Network, links: Sequence[Link]) -> tuple[Network, bool]:
    """The network moved until the outlines coincide, and whether they do; otherwise it stays."""
    used = _used(network, links)
    moved = network
    for scale in _SCALES:
        for _ in range(2):
            distances, jacobian = _distances(moved, links)
            step = np.zeros(network.size)
            step[used] = outline_step(distances, jacobian[:, used], scale)
            moved = moved.stepped(step)
    distances = _distances(moved, links)[0]
    known = distances[np.isfinite(distances)]
    before, after = (np.mean([overlap(each, link) for link in links]) for each in (network, moved))
    if lock_ratio(known, NEAR) < LOCKED or after > 1.5 * before + 1.0:
        return network, False
    return moved, True


def overlap(network: Network, link: Link) -> float:
    """Overlap error δ of a link in percent, mean of both ways."""
    return 0.5 * sum(
        overlap_error(way.views[1], network.carried(way)[0], way.views[0].following)
        for way in (link, link.reversed)
    )


def _both_ways(links: Sequence[Link]) -> list[Link]:
    return [way for link in links for way in (link, link.reversed)]


def _descended(network: Network, ways: Sequence[Link], terms: Terms, rounds: int) -> tuple[Network, float]:
    """Levenberg-Marquardt: the network with the least sum of squared terms, and that sum."""
    used = _used(network, ways)
    normal, gradient, cost = _normal_equations(network, ways, terms)
    damping = 1e-3
    for _ in range(rounds):
        moved = network.stepped(_step(normal, gradient, used, damping))
        found = _normal_equations(moved, ways, terms)
        if found[2] < cost:
            small = cost - found[2] < 1e-8 * cost
            network, (normal, gradient, cost), damping = moved, found, damping * 0.1
            if small:
                break
        elif damping > _MOST_DAMPED:
            break
        else:
            damping *= 10
    return network, cost


def _normal_equations(
    network: Network, ways: Sequence[Link], terms: Terms
) -> tuple[FloatArray, FloatArray, float]:
    """`JᵀJ` (P,P), `Jᵀr` (P,) and cost; infinite where a plane comes to lie behind a camera."""
    normal, gradient, cost = np.zeros((network.size, network.size)), np.zeros(network.size), 0.0
    for way in ways:
        residual, jacobian = terms(network, way)
        if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(jacobian))):
            return normal, gradient, np.inf
        place = network.columns(way)
        normal[np.ix_(place, place)] += jacobian.T @ jacobian
        gradient[place] += jacobian.T @ residual
        cost += float(residual @ residual)
    return normal, gradient, cost


def _used(network: Network, ways: Sequence[Link]) -> BoolArray:
    """Which parameters (P,) the links say something about."""
    used = np.zeros(network.size, dtype=np.bool_)
    for way in ways:
        used[network.columns(way)] = True
    return used & network.free


def _step(normal: FloatArray, gradient: FloatArray, used: BoolArray, damping: float) -> FloatArray:
    """Damped step (P,); the scale, which nothing decides, stays by the damping."""
    step = np.zeros(len(gradient))
    inner = normal[np.ix_(used, used)]
    diagonal = np.diag(inner)
    damped = inner + np.diag(damping * diagonal + 1e-9 * diagonal.max() + 1e-300)
    step[used] = -np.linalg.solve(damped, gradient[used])
    return step


def _distances(network: Network, links: Sequence[Link]) -> Equations:
    """Distances (n,) px of all outlines both ways, and derivatives (n,P)."""
    rows, slopes = [], []
    for way in _both_ways(links):
        distances, slope = outline_distances(way.views[1], *network.carried(way), way.views[0].following)
        spread = np.zeros((len(distances), network.size))
        spread[:, network.columns(way)] = slope
        rows.append(distances)
        slopes.append(spread)
    return np.concatenate(rows), np.concatenate(slopes)
