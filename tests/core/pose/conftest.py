"""A small church wall in relief and photos of it, rendered by ray casting: the truth is known."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.rays import RayCaster
from fresco.core.geometry.rigid import exp_so3
from fresco.core.photos.view import View

STEP = 0.015


@dataclass(frozen=True, eq=False)
class ReliefWall:
    """A wall in the plane y = 0 (x right, z up, metres) with blocks towards the camera (-y)."""

    vertices: np.ndarray
    faces: np.ndarray
    seed: int

    def albedo(self, points):
        """Paint and stone texture of the wall: (N,3) -> (N,) in [0.2, 1]."""
        rng = np.random.default_rng(self.seed)
        value = np.zeros(len(points))
        for octave in range(5):
            frequency = 3.0 * 2.2**octave
            for _ in range(6):
                direction, phase = rng.normal(size=3), rng.uniform(0, 2 * np.pi)
                value += np.sin(frequency * points @ direction + phase) / (octave + 1.5)
        return np.clip(0.6 + 0.09 * value, 0.2, 1.0)

    def photo(self, camera, rotation, centre, texture=1.0, light=(0.4, -0.7, 0.6), noise=1.5, fill=0.0):
        """Photo (H,W,3) bytes: Lambert shading, `texture` 0: plain stone, `fill`: light from around."""
        caster = RayCaster(self.vertices, self.faces)
        rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
        total = np.zeros(rows.size)
        for du, dv in ((-0.25, -0.12), (0.25, 0.12)):
            rays = camera.unproject(np.stack([columns.ravel() + du, rows.ravel() + dv], axis=1).astype(float))
            directions = np.nan_to_num(rays) @ rotation
            hits = caster.first_hit(centre, directions)
            struck = hits.face >= 0
            corner = self.vertices[self.faces[hits.face[struck]]]
            normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            normal *= -np.sign(np.einsum("nk,nk->n", normal, directions[struck]))[:, None]
            points = centre + directions[struck] * hits.distance[struck, None]
            towards_sun = np.array(light) / np.linalg.norm(light)
            sunny = caster.first_hit(points + 0.002 * normal, np.tile(towards_sun, (len(points), 1))).face < 0
            around = 1 + fill * (normal @ [0.35, -0.2, 0.8])
            shade = 0.45 * around + 0.55 * np.clip(normal @ towards_sun, 0, None) * sunny
            # blocks are of a lighter stone than the wall
            stone = 0.5 + 0.4 * (self.offset[1] - points[:, 1] > 0.05)
            paint = stone * (1 + texture * (self.albedo(points - self.offset) / 0.6 - 1))
            total[struck] += shade * paint / 2
        rng = np.random.default_rng(self.seed + 1)
        grey = 230 * total.reshape(rows.shape) + 12 + rng.normal(0, noise, rows.shape)
        return np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2)

    def view(self, centre, target=(0.0, 0.0, 0.0), camera=None, roll=0.0, name="", **photo):
        """View from `centre` towards `target`, both relative to the middle of the wall."""
        origin = np.array([0.0, 0.0, 0.0]) + self.offset
        camera = camera or PerspectiveCamera(720, 540, [[640, 0, 359.5], [0, 640, 269.5], [0, 0, 1]])
        centre = np.asarray(centre, dtype=float) + origin
        forward = np.asarray(target) + origin - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        rotation = exp_so3([0, 0, roll]) @ np.stack([right, np.cross(forward, right), forward])
        image = self.photo(camera, rotation, centre, **photo)
        return View(camera, rotation, -rotation @ centre, image, name)

    @property
    def offset(self):
        return np.array(
            [self.vertices[:, 0].min() + 2.4, self.vertices[:, 1].max(), self.vertices[:, 2].min() + 1.8]
        )


def build_wall(blocks=True, offset=(0.0, 0.0, 0.0), seed=5):
    x, z = np.meshgrid(np.arange(-2.4, 2.4001, STEP), np.arange(-1.8, 1.8001, STEP))
    height = np.zeros_like(x)
    if blocks:
        for left, low, right, top, out in (
            (-1.7, -1.5, -1.2, 1.0, 0.35),
            (1.0, -1.2, 1.6, 0.9, 0.5),
            (-0.6, -0.9, 0.5, -0.2, 0.8),
            (-1.9, 1.15, 1.9, 1.45, 0.25),
            (-0.4, 0.2, 0.3, 0.8, 0.15),
        ):
            height[(x > left) & (x < right) & (z > low) & (z < top)] = out
    vertices = np.stack([x, -height, z], axis=-1).reshape(-1, 3) + np.asarray(offset)
    rows, columns = x.shape
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
    return ReliefWall(vertices, np.concatenate([lower, upper]).astype(np.int32), seed)


def disturbed(view, degrees, metres, seed):
    """The view turned by `degrees` and moved by `metres` in random directions."""
    rng = np.random.default_rng(seed)
    turn, move = rng.normal(size=3), rng.normal(size=3)
    rotation = exp_so3(np.radians(degrees) * turn / np.linalg.norm(turn)) @ view.rotation
    centre = view.centre + metres * move / np.linalg.norm(move)
    return replace(view, rotation=rotation, translation=-rotation @ centre)


@pytest.fixture(scope="session")
def wall():
    return build_wall()


@pytest.fixture(scope="session")
def make_wall():
    return build_wall


@pytest.fixture(scope="session")
def disturb():
    return disturbed
