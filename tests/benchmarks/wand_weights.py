"""Learn the weights of the photo wand from drawn facades: `python tests/benchmarks/wand_weights.py`.

Two clicks on every region of `wand_facades`, one near its middle and one anywhere inside; the wand's own
candidates there are measured, and each has its overlap (IoU) with the region. A logistic choice among the
candidates of a click, which goes to those of high overlap, gives the weights. Printed are the overlaps that
three-fold cross-validation by facade reaches with several doubts (`evidence.DOUBT`), and the weights as
`evidence.WEIGHTS` has them. Seeds of other facades: `--seeds FIRST COUNT ...`.
"""

import argparse
import os
from multiprocessing import Pool

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
from fresco.core.geometry.polygons import polygon_moments
from fresco.core.regions.photo import edges, evidence
from fresco.core.regions.photo.choice import expected_overlaps
from fresco.core.regions.photo.wand import prepare_wand
from scipy.optimize import minimize
from wand_facades import facade

SEEDS = (1000, 90)  # first and count
FOLDS = 3
DOUBTS = (0.01, 1.0, 1.5, 2.0, 3.0, 5.0)  # the first takes the best score
REGULARISATION = 3e-3
AIMED = 0.08  # standard deviations of the region that an aimed click is off its middle
FARTHEST = 1.0  # and one that is not, at most
OFFERED = 0.8  # overlap that some candidate has to reach: else there is nothing to choose
FREE = {
    "strength of the gradient across the sides (log)",
    "strength of the gradient across the faintest side (log)",
    "rival edge outwards of the sides",
    "outline of like colour, not of straight lines",
    "outline is arched",
}  # of any sign
NEGATIVE = {
    "edges go on beyond the corners",
    "colour differs between sides and middle",
    "texture differs between sides and middle",
    "opposite sides are not parallel",
    "outline is dented (log)",
    "smaller than regions are (log2)",
    "larger than regions are (log2)",
}
NAMES = list(evidence.WEIGHTS)


def overlaps(loops, truth):
    """IoU (N,) of closed loops with an outline, at half size."""
    points = np.concatenate([*loops, truth])
    low = points.min(axis=0)
    size = ((points.max(axis=0) - low) / 2).astype(int) + 2

    def drawn(loop):
        mask = np.zeros((size[1], size[0]), np.uint8)
        cv2.fillPoly(mask, [np.round((loop - low) / 2).astype(np.int32)], 1)
        return mask > 0

    inside = drawn(truth)
    masks = [drawn(loop) for loop in loops]
    return np.array([np.count_nonzero(m & inside) / np.count_nonzero(m | inside) for m in masks])


def choices(seed):
    """One (evidence (N,18), IoU (N,), outlines) for every region of a facade that can be chosen."""
    image, regions = facade(seed)
    wand = prepare_wand(np.ascontiguousarray(image[:, :, ::-1]))
    rng = np.random.default_rng(seed + 1000)
    found = []
    for _, outline in regions:
        truth = edges.to_reduced(outline, wand.factor)
        middle, spread = polygon_moments(truth[None])
        if np.linalg.eigvalsh(spread[0])[0] < 4:
            continue
        for off in (rng.normal(0, AIMED, 2), anywhere(rng, truth, middle[0], spread[0])):
            click = middle[0] + np.linalg.cholesky(spread[0]) @ off
            loops, outlines, straight = wand.candidates(click)
            values, bounds = evidence.measured(wand.gradient, wand.look, outlines, click, straight)
            usable = bounds & ~wand.cut_off(outlines)
            if usable.any():
                shares = overlaps(loops, truth)
                left = [loops[k] for k in np.flatnonzero(usable)]
                found.append((np.nan_to_num(values[usable]), shares[usable], left))
    return found


def anywhere(rng, outline, middle, spread):
    """Place (2,) inside an outline, in standard deviations off its middle, at most FARTHEST."""
    root = np.linalg.cholesky(spread)
    while True:
        off = rng.uniform(-FARTHEST, FARTHEST, 2)
        place = middle + root @ off
        inside = cv2.pointPolygonTest(outline.astype(np.float32)[:, None], place.tolist(), True)
        if np.hypot(*off) < FARTHEST and inside > 3:
            return off


def teachable(choice):
    """Whether a good candidate is there."""
    return choice[1].max() > OFFERED


def loss(weights, clicks):
    """Mean log loss of the choice, regularised, and its gradient."""
    total, slope = 0.0, np.zeros_like(weights)
    for values, shares in clicks:
        score = values @ weights
        chance = np.exp(score - score.max())
        chance /= chance.sum()
        good = chance * (np.clip((shares - 0.75) / 0.2, 0, 1) ** 2 + 1e-9)
        total -= np.log(good.sum())
        slope -= values.T @ (good / good.sum() - chance)
    count = len(clicks)
    return (
        total / count + REGULARISATION * weights @ weights,
        slope / count + 2 * REGULARISATION * weights,
    )


def learned(clicks):
    """Weights (18,) from clicks; each has the sign that its evidence must have."""
    values = np.concatenate([values for values, _, _ in clicks])
    scale = values.std(axis=0) + 1e-9
    bounds = [(None, None) if n in FREE else (None, 0) if n in NEGATIVE else (0, None) for n in NAMES]
    scaled = [(v / scale, shares) for v, shares, _ in clicks]
    found = minimize(loss, np.zeros(len(NAMES)), (scaled,), jac=True, method="L-BFGS-B", bounds=bounds)
    return found.x / scale


def chosen(weights, doubt, clicks):
    """IoU of the candidate that the wand would choose, for every click."""
    return np.array(
        [
            shares[np.argmax(expected_overlaps(loops, values @ weights, doubt))]
            for values, shares, loops in clicks
        ]
    )


def validated(facades):
    """IoU (D,n) of the choice on every usable click for all doubts, by weights from the other facades."""
    fold = np.arange(len(facades)) * FOLDS // len(facades)
    reached = []
    for k in range(FOLDS):
        others = [
            c for f, clicks in zip(fold, facades, strict=True) if f != k for c in clicks if teachable(c)
        ]
        held = [c for f, clicks in zip(fold, facades, strict=True) if f == k for c in clicks]
        weights = learned(others)
        reached.append([chosen(weights, doubt, held) for doubt in DOUBTS])
    return np.concatenate(reached, axis=1)


def summary(name, shares):
    print(
        f"{name}: IoU median {np.median(shares):.3f}, mean {shares.mean():.3f}, "
        f"over 0.8 {np.mean(shares > 0.8):.3f}",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS, metavar="N")
    seeds = parser.parse_args().seeds
    spans = zip(seeds[::2], seeds[1::2], strict=True)
    with Pool() as pool:
        facades = pool.map(choices, [first + k for first, count in spans for k in range(count)], 1)
    clicks = [choice for found in facades for choice in found]
    usable = [choice for choice in clicks if teachable(choice)]
    summary(f"best candidate of {len(clicks)} clicks", np.array([shares.max() for _, shares, _ in clicks]))
    summary("present weights", chosen(np.array(list(evidence.WEIGHTS.values())), evidence.DOUBT, clicks))
    for doubt, reached in zip(DOUBTS, validated(facades), strict=True):
        summary(f"cross-validated, DOUBT {doubt}", reached)
    print(f"WEIGHTS from {len(usable)} clicks")
    for name, value in zip(NAMES, learned(usable), strict=True):
        print(f'    "{name}": {value:.2f},')


if __name__ == "__main__":
    main()
