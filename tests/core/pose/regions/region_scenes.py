"""Small scenes with a known pose for the tests of poses from regions."""

import numpy as np
from fresco.core.geometry.boundary import subdivided
from fresco.core.geometry.outlines import fill_loops
from fresco.core.geometry.rigid import exp_so3
from fresco.core.regions import ImageRegion, SurfaceRegion

ELL = [(0, 0), (1, 0), (1, 0.3), (0.35, 0.3), (0.35, 0.8), (0, 0.8)]
PROW = [(0, 0.2), (0.7, 0), (1, 0.4), (0.5, 0.9), (0.45, 0.5), (0.1, 0.65)]
GABLE = [(0, 0.4), (0.35, 0), (0.9, 0.35), (0.9, 0.9), (0, 0.9)]
KITE = [(0, 0.1), (0.8, 0), (1, 0.75), (0.15, 0.95)]
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
TRIANGLES = {
    6: {
        "ell": [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)],
        "prow": [(0, 1, 4), (1, 2, 4), (2, 3, 4), (4, 5, 0)],
    },
    5: {"gable": [(0, 1, 2), (0, 2, 3), (0, 3, 4)]},
    4: {"square": [(0, 1, 2), (0, 2, 3)], "kite": [(0, 1, 2), (0, 2, 3)]},
}
SHAPES = {
    "ell": (ELL, TRIANGLES[6]["ell"]),
    "prow": (PROW, TRIANGLES[6]["prow"]),
    "gable": (GABLE, TRIANGLES[5]["gable"]),
    "kite": (KITE, TRIANGLES[4]["kite"]),
    "square": (SQUARE, TRIANGLES[4]["square"]),
}
PLACES = {
    "ell": ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    "prow": ([0.4, 0.3, 0.2], [1.3, 0.4, 0.3]),
    "gable": ([-0.35, 0.25, 0.1], [0.2, -1.2, -0.4]),
    "kite": ([0.2, -0.3, 0.1], [-0.9, 0.9, 0.2]),
    "square": ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
}
LOCAL = exp_so3([0.3, -0.25, 0.6])
SHIFT = np.array([-0.5, 0.1, 3.4])


class Scene:
    """Regions by name, seen by a camera from a pose, in a world that is turned and shifted."""

    def __init__(
        self, camera, names, world=(0.4, -0.9, 1.3), offset=(0.0, 0.0, 0.0), shift=SHIFT, local=LOCAL
    ):
        turn = exp_so3(world)
        self.camera, self.names = camera, names
        self.rotation = local @ turn.T
        self.translation = np.asarray(shift) - self.rotation @ offset
        self.masks, self.surfaces = [], []
        for name in names:
            corners, faces = SHAPES[name]
            spin, place = PLACES[name]
            points = np.column_stack([np.array(corners) - 0.5, np.zeros(len(corners))])
            points = points @ exp_so3(spin).T + place
            fine = subdivided(points, 0.01) @ local.T + shift
            self.masks.append(fill_loops([camera.project(fine)], camera.width, camera.height))
            self.surfaces.append(SurfaceRegion(points @ turn.T + offset, faces, name))

    @property
    def images(self):
        return [ImageRegion.from_mask(m, n) for m, n in zip(self.masks, self.names, strict=True)]

    @property
    def centre(self):
        return -self.rotation.T @ self.translation
