"""Photos drawn of rectangles at known places."""

import cv2
import numpy as np
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.rigid import exp_so3
from fresco.core.regions import SurfaceRegion

CAMERA = PerspectiveCamera(900, 600, [[800, 0, 449.5], [0, 800, 299.5], [0, 0, 1]])
TURN, SHIFT = exp_so3([0.05, -0.2, 0.02]), np.array([0.3, 0.1, 6.0])


def rectangle(u, v, width, height, depth=0.0, name=""):
    corners = np.array(
        [[u, v, depth], [u + width, v, depth], [u + width, v + height, depth], [u, v + height, depth]]
    )
    return SurfaceRegion(corners, [[0, 1, 2], [0, 2, 3]], name)


def photo_of(surfaces, camera=CAMERA, turn=TURN, shift=SHIFT):
    """Photo (H,W,3) with each rectangle in its own colour on a grey ground; drawn 4 times larger."""
    image = np.full((camera.height * 4, camera.width * 4, 3), 150, dtype=np.uint8)
    for number, surface in enumerate(surfaces):
        pixels = camera.project(surface.vertices @ turn.T + shift)
        corners = np.round((pixels + 0.5) * 4 - 0.5).astype(np.int32)
        cv2.fillPoly(image, [corners], (60 + 40 * number, 90, 200 - 50 * number))
    small = cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return np.clip(small + np.random.default_rng(0).normal(0, 2, small.shape), 0, 255).astype(np.uint8)


SURFACES = [rectangle(-2, -1, 1.2, 1.6, name="door"), rectangle(0.4, -1.2, 1.5, 0.8, name="panel")]
