"""Arched outlines: what votes find, and that a click takes them."""

import cv2
import numpy as np
import pytest
from fresco.core.geometry.polygons import polygon_moments
from fresco.core.regions.photo.arches import find_arches
from fresco.core.regions.photo.choice import overlaps
from fresco.core.regions.photo.frames import find_frames
from fresco.core.regions.photo.wand import prepare_wand

RISES = {"round": (0.5, 0.0), "pointed": (0.9, 0.5), "segmental": (0.25, 0.0)}
VIEW = cv2.getPerspectiveTransform(
    np.float32([[0, 0], [900, 0], [900, 600], [0, 600]]),
    np.float32([[10, 40], [880, 0], [900, 590], [0, 560]]),
)


def outline(shape, left=340, top=120, width=220, height=360):
    """Outline (n,2) of an arched opening on the wall; the head by circles that meet at the apex."""
    rise, narrow = RISES[shape]
    rise *= width
    half = width / 2
    across = half * np.sin(np.linspace(-np.pi / 2, np.pi / 2, 61))
    radius = width if narrow else (half**2 + rise**2) / (2 * rise)  # of the circles the head is cut from
    centre = half if narrow else 0.0
    drop = radius - rise if not narrow else 0.0
    up = np.sqrt(np.maximum(radius**2 - (np.abs(across) + centre) ** 2, 0)) - drop
    head = np.stack([left + half + across, top + up.max() - up], axis=1)
    foot = [[left + width, top + height], [left, top + height]]
    return np.concatenate([head, foot])


def wall(shape):
    """Photo (H,W,3) of a rough wall with an arched opening in a painted band, and the opening's outline."""
    rng = np.random.default_rng(3)
    large = np.full((1200, 1800, 3), (160, 140, 120), np.float32)
    large += cv2.GaussianBlur(rng.normal(0, 40, large.shape[:2]).astype(np.float32), (0, 0), 3)[..., None]
    inner, outer = outline(shape), outline(shape, 315, 95, 270, 385)
    for loop, tone in ((outer, (205, 195, 180)), (inner, (60, 70, 90))):
        cv2.fillPoly(large, [np.round(2 * loop).astype(np.int32)], tone)
    cv2.line(large, (680, 600), (1120, 600), (150, 150, 140), 6)  # a bar across the opening
    seen = cv2.warpPerspective(cv2.resize(large, (900, 600), interpolation=cv2.INTER_AREA), VIEW, (900, 600))
    noisy = np.clip(seen + rng.normal(0, 3, seen.shape), 0, 255).astype(np.uint8)
    return noisy, cv2.perspectiveTransform(inner[None].astype(np.float32), VIEW)[0].astype(float)


def overlap(first, second):
    return overlaps([first, second])[0, 1]


@pytest.mark.parametrize("shape", RISES)
def test_votes_find_heads_in_perspective(shape):
    photo, truth = wall(shape)
    wand = prepare_wand(photo)
    click = polygon_moments(truth[None])[0][0]
    strips = find_frames(wand.lines, click, 0.3, 100).strips
    arches = find_arches(wand.gradient, wand.lines, wand.segments, strips, click)
    assert max(overlap(truth, loop) for loop in arches.loops) > 0.96
    assert np.all((arches.support >= 0) & (arches.support <= 1))
    assert np.all(np.diff(np.log(np.maximum(arches.support, 0.05)).sum(axis=1)) <= 1e-9)


@pytest.mark.parametrize("shape", RISES)
def test_one_click_takes_an_arched_opening(shape):
    photo, truth = wall(shape)
    wand = prepare_wand(photo)
    level = wand.click(polygon_moments(truth[None])[0][0], "frame").level()
    (loop,) = wand.finished(level)
    assert not level.straight
    assert overlap(truth, loop) > 0.96


@pytest.mark.parametrize("shape", RISES)
def test_a_click_off_the_middle_offers_it_too(shape):
    photo, truth = wall(shape)
    click = prepare_wand(photo).click(polygon_moments(truth[None])[0][0] + (-40, 50), "frame")
    assert max(overlap(truth, level.outline) for level in click.levels) > 0.96


def test_a_photo_without_edges_has_no_arches():
    wand = prepare_wand(np.full((300, 400, 3), 128, dtype=np.uint8))
    strips = find_frames(wand.lines, (200, 150), 0.3, 100).strips
    arches = find_arches(wand.gradient, wand.lines, wand.segments, strips, np.array([200.0, 150.0]))
    assert arches.loops.shape == (0, 27, 2)
