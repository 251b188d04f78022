"""Outlines as segmentation gets them wrong: a side beside the true one, scraps, lines, everything."""

import math

import cv2
import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.errors import FrescoError
from fresco.core.geometry.outlines import mask_loops
from fresco.core.geometry.rigid import rotation_angle
from fresco.core.pose import estimate_pose
from fresco.core.regions import ImageRegion
from hypothesis import given, settings
from hypothesis import strategies as st
from region_scenes import Scene

CAMERA = PerspectiveCamera(1200, 800, [[800, 0, 599.5], [0, 800, 399.5], [0, 0, 1]])
SMALL = PerspectiveCamera(300, 200, [[200, 0, 149.5], [0, 200, 99.5], [0, 0, 1]])


def displaced(mask, first, share, pixels):
    """Mask with a stretch of its outline, from `first` (0-1) over `share`, moved out (or in) by pixels."""
    loop = max(mask_loops(mask), key=len)
    stretch = (int(first * len(loop)) + np.arange(int(share * len(loop)))) % len(loop)
    band = np.zeros(mask.shape, np.uint8)
    cv2.polylines(band, [np.rint(loop[stretch]).astype(np.int32)], False, 1, 2 * abs(pixels) + 1)
    return mask | (band > 0) if pixels > 0 else mask & (band == 0)


@pytest.mark.parametrize("pixels", [4, 9, -6])
@pytest.mark.parametrize("first", [0.1, 0.4, 0.8])
def test_side_beside_the_true_one_does_not_give_a_sure_wrong_pose(first, pixels):
    scene = Scene(CAMERA, ["ell", "prow"])
    masks = [displaced(mask, first, 0.3, pixels) for mask in scene.masks]
    images = [ImageRegion.from_mask(mask) for mask in masks]
    pose = estimate_pose(CAMERA, images, scene.surfaces)
    turn = np.degrees(rotation_angle(pose.rotation @ scene.rotation.T))
    off = np.linalg.norm(pose.centre - scene.centre)
    assert pose.ambiguous or (turn < 3 * pose.rotation_sigma and off < 3 * pose.centre_sigma)


def scrap(kind, corners, size):
    """Mask (200, 300) of a polygon, a line, a dot, speckles or a band at the frame."""
    mask = np.zeros((200, 300), np.uint8)
    points = np.array(corners, dtype=np.int32)
    if kind == "polygon":
        cv2.fillPoly(mask, [points], 1)
    elif kind == "line":
        cv2.line(mask, corners[0], corners[1], 1, size)
    elif kind == "dot":
        cv2.circle(mask, corners[0], size, 1, -1)
    elif kind == "speckles":
        u, v = np.clip(points.T, size, 199 - size)
        for shift in range(0, 2 * size, 2):
            mask[v + shift - size, u] = 1
        mask[10:20, 10:20] = 1
    else:
        mask[:, : 8 * size] = 1
    return mask > 0


corners = st.lists(st.tuples(st.integers(0, 299), st.integers(0, 199)), min_size=3, max_size=7)
kinds = st.sampled_from(["polygon", "line", "dot", "speckles", "band"])
scraps_drawn = st.tuples(kinds, corners, st.integers(1, 12))


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(kinds, corners, st.integers(1, 12)), min_size=1, max_size=2),
    st.booleans(),
    st.booleans(),
)
def test_whatever_is_marked_gives_a_pose_in_numbers_or_a_sentence(scraps, beside, paired):
    names = ["ell", "prow", "gable"][: len(scraps) + beside]
    scene = Scene(SMALL, names)
    masks = [scrap(*what) for what in scraps] + scene.masks[len(scraps) :]
    try:
        images = [ImageRegion.from_mask(mask, name) for mask, name in zip(masks, names, strict=True)]
        pose = estimate_pose(SMALL, images, scene.surfaces, paired=paired)
    except FrescoError as refusal:
        assert str(refusal).endswith(".")
        return
    assert np.all(np.isfinite(pose.rotation)) and np.all(np.isfinite(pose.covariance))
    assert math.isfinite(pose.rotation_sigma) and math.isfinite(pose.centre_sigma)


def test_two_regions_swapped_are_no_sure_pose():
    scene = Scene(CAMERA, ["ell", "prow"])
    try:
        pose = estimate_pose(CAMERA, scene.images[::-1], scene.surfaces)
    except FrescoError:
        return
    assert pose.ambiguous
