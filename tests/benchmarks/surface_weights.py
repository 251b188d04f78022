"""Learn the weights of the surface wand from made-up fronts: `python tests/benchmarks/surface_weights.py`.

One click in the middle of every region of `surface_fronts`; all that the wand finds there is measured, and
each has its overlap (IoU by area) with the region. A logistic choice, which goes to candidates of high
overlap, gives the weights. Printed are the overlaps that three-fold cross-validation by front reaches with
several doubts (`evidence.DOUBT`), and the weights as `evidence.WEIGHTS` has them. Seeds of other fronts:
`--seeds FIRST COUNT`; `--keep FILE` keeps what was measured, or takes it from there.
"""

import argparse
import os
import pickle
from multiprocessing import Pool
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from fresco.core.regions.photo.choice import expected_overlaps
from fresco.core.regions.surface import evidence
from fresco.core.regions.surface.framed import within
from fresco.core.regions.surface.index import index_surface
from fresco.core.regions.surface.wand import clicked_candidates
from region_scans import centre_face, facade, palace
from scipy.optimize import minimize
from surface_fronts import front

FOLDS = 3
DOUBTS = (0.01, 0.5, 1.0, 1.5, 2.0, 3.0)  # the first takes the best score
REGULARISATION = 3e-3
SAMPLE = 12_000  # faces that tell how far candidates overlap
OFFERED = 0.75  # overlap that some candidate has to reach: else there is nothing to choose
NAMES = list(evidence.NAMES)
POSITIVE = {
    "clear border (log)",
    "clear border on the least clear side (log)",
    "share of the least clear side that is clear",
    "share of the gradient that runs straight across the sides (log)",
    "straight creases cover the sides (mean log)",
    "surface differs across the least distinct side",
    "the click is central (log odds)",
    "score of growing",
}
NEGATIVE = {
    "creases go on beyond the corners",
    "surface turns from the sides to the middle",
    "surface steps from the sides to the middle",
    "share inside that has turned away",
    "share inside where there is no surface",
    "opposite sides are not parallel",
    "outline is dented (log)",
    "smaller than regions are (log2)",
}


def scan_of(seed):
    """Made-up scan of a seed: every fourth is like one of `region_scans`, with other places and noise."""
    if seed % 8 == 3:
        return facade(noise=0.001 + 0.001 * (seed % 5), seed=seed)
    if seed % 8 == 7:
        return palace(noise=0.002 + 0.001 * (seed % 3), seed=seed)
    return front(seed)


def choices(seed):
    """One (evidence (N,k), IoU (N,), loops, levels (N,)) for every region of a front."""
    vertices, faces, sets, weight = scan_of(seed)
    index = index_surface(vertices, faces)
    found = []
    for truth in sets.values():
        if np.count_nonzero(truth) < 60:
            continue
        face = centre_face(vertices, faces, truth)
        levels, candidates = clicked_candidates(index, face)
        shares = overlaps(index, candidates, levels, truth, weight)  # faces are of like size
        found.append((candidates.evidence, shares, candidates.loops, candidates.level))
    return found


def overlaps(index, candidates, levels, truth, weight):
    """IoU (N,) by weight of faces (F,) of all candidates with a set of faces (F,)."""
    plane = candidates.plane
    local = (index.middle - plane.centre) @ plane.axes.T
    front = np.flatnonzero(
        (np.abs(local[:, 2]) < 0.5) & (index.smooth_normal @ plane.normal > 0) & (weight > 0)
    )
    front = np.random.default_rng(0).permutation(front)[:SAMPLE]
    place, label, truth = local[front, :2], index.patches.label[front], truth[front]
    whole = np.count_nonzero(truth)
    chosen = np.zeros(len(index.patches.area), dtype=bool)
    shares = []
    for loop, number in zip(candidates.loops, candidates.level, strict=True):
        if number < 0:
            low, high = loop.min(axis=0), loop.max(axis=0)
            near = np.flatnonzero(np.all((place > low) & (place < high), axis=1))
            found = near[within(place[near], loop)]
        else:
            chosen[:] = False
            chosen[levels[number].patches] = True
            found = np.flatnonzero(chosen[label])
        both = np.count_nonzero(truth[found])
        shares.append(both / (whole + len(found) - both))
    return np.array(shares)


def loss(weights, clicks):
    """Mean log loss of the choice, regularised, and its gradient."""
    total, slope = 0.0, np.zeros_like(weights)
    for values, good in clicks:
        score = values @ weights
        chance = np.exp(score - score.max())
        chance /= chance.sum()
        chosen = chance * good
        total -= np.log(chosen.sum())
        slope -= values.T @ (chosen / chosen.sum() - chance)
    count = len(clicks)
    return total / count + REGULARISATION * weights @ weights, slope / count + 2 * REGULARISATION * weights


def learned(clicks):
    """Weights (k,) from clicks; each has the sign that its evidence must have."""
    values = np.concatenate([click[0] for click in clicks])
    scale = values.std(axis=0) + 1e-9
    bounds = [(0, None) if n in POSITIVE else (None, 0) if n in NEGATIVE else (None, None) for n in NAMES]
    scaled = []
    for value, shares, *_ in clicks:
        top = shares.max()
        scaled.append((value / scale, np.clip((shares - top + 0.2) / 0.2, 0, 1) ** 2 + 1e-9))
    found = minimize(loss, np.zeros(len(NAMES)), (scaled,), jac=True, method="L-BFGS-B", bounds=bounds)
    return found.x / scale


def chosen(weights, doubt, clicks):
    """IoU of the candidate that the wand would choose, for every click."""
    return np.array(
        [
            shares[np.argmax(expected_overlaps(loops, values @ weights, doubt))]
            for values, shares, loops, _ in clicks
        ]
    )


def teachable(click):
    return click[1].max() > OFFERED


def validated(fronts):
    """IoU (D,n) of the choice on every click for all doubts, by weights from the other fronts."""
    fold = np.arange(len(fronts)) % FOLDS
    reached = []
    for k in range(FOLDS):
        others = [c for f, clicks in zip(fold, fronts, strict=True) if f != k for c in clicks if teachable(c)]
        held = [c for f, clicks in zip(fold, fronts, strict=True) if f == k for c in clicks]
        weights = learned(others)
        reached.append([chosen(weights, doubt, held) for doubt in DOUBTS])
    return np.concatenate(reached, axis=1)


def summary(name, shares):
    print(
        f"{name}: IoU median {np.median(shares):.3f}, mean {shares.mean():.3f}, "
        f"over 0.8 {np.mean(shares > 0.8):.3f}, below 0.5 {np.mean(shares < 0.5):.3f}",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=(1000, 40), metavar="N")
    parser.add_argument("--keep", type=Path)
    arguments = parser.parse_args()
    first, count = arguments.seeds
    if arguments.keep and arguments.keep.exists():
        fronts = pickle.loads(arguments.keep.read_bytes())
    else:
        with Pool(2) as pool:
            fronts = pool.map(choices, range(first, first + count), 1)
        if arguments.keep:
            arguments.keep.write_bytes(pickle.dumps(fronts))
    clicks = [click for found in fronts for click in found]
    usable = [click for click in clicks if teachable(click)]
    summary(f"best candidate of {len(clicks)} clicks", np.array([click[1].max() for click in clicks]))
    grown = [click[1][click[3] >= 0] for click in clicks]
    summary("best grown level", np.array([shares.max(initial=0) for shares in grown]))
    summary("present weights", chosen(np.array(list(evidence.WEIGHTS.values())), evidence.DOUBT, clicks))
    for doubt, reached in zip(DOUBTS, validated(fronts), strict=True):
        summary(f"cross-validated, DOUBT {doubt}", reached)
    print(f"WEIGHTS from {len(usable)} clicks")
    for name, value in zip(NAMES, learned(usable), strict=True):
        print(f'    "{name}": {value:.2f},')


if __name__ == "__main__":
    main()
