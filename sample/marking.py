"""What the surveyor brings: the scan as a scanner delivers it, and regions as a person marks them."""

import cv2
import numpy as np
from chapel import REGIONS, on_wall
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from photography import HEIGHT, WIDTH
from surfaces import compact

STATIONS = ((1.7, -3.3, 1.55), (4.1, -3.1, 1.6), (3.0, -1.7, 1.4))
NOISE = 0.001


class Occluders:
    """The sample as an obstacle to sight."""

    def __init__(self, vertices, faces):
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, vertices.astype(np.float32), faces.astype(np.int32))

    def sees(self, eye, points, tolerance=0.004):
        """Whether nothing stands more than `tolerance` metres before points: (3,), (N,3) -> (N,)."""
        rays = points - np.asarray(eye)
        far = np.linalg.norm(rays, axis=1)
        origins = np.tile(np.asarray(eye, np.float32), (len(points), 1))
        hit = self._scene.run(origins, (rays / far[:, None]).astype(np.float32), query="DISTANCE")
        return hit > far - tolerance


def scan(vertices, faces, labels, rng):
    """What the scanner stations see of the model, with range noise: vertices, faces, labels."""
    occluders = Occluders(vertices, faces)
    centre = vertices[faces].mean(axis=1)
    normal = np.cross(
        vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    )
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    seen = np.zeros(len(faces), dtype=bool)
    for station in STATIONS:
        ray = station - centre
        facing = np.sum(ray * normal, axis=1) / np.linalg.norm(ray, axis=1) > np.cos(np.radians(84))
        seen |= facing & occluders.sees(station, centre)
    ray = vertices - np.asarray(STATIONS[0])
    noisy = vertices + rng.normal(0, NOISE, (len(vertices), 1)) * ray / np.linalg.norm(
        ray, axis=1, keepdims=True
    )
    return *compact(noisy, faces[seen]), labels[seen]


def face_labels(name, plane_points, faces, rng):
    """Region number of one wall's faces as a person would paint them: a few at the border are wrong."""
    labels = np.zeros(len(faces), dtype=np.int32)
    middle = plane_points[faces].mean(axis=1)
    for number, (_, outline) in enumerate(REGIONS.items(), start=1):
        if outline.wall == name:
            distance = outline.shape.distance(middle) - outline.offset
            slip = np.where(rng.random(len(faces)) < 0.06, rng.normal(0, 0.012, len(faces)), 0.0)
            labels[distance + slip < 0] = number
    return labels


def outline_in_space(name, spacing=0.01):
    """A region's true outline: (N,3) metres."""
    outline = REGIONS[name]
    points = outline.shape.outline(outline.offset, spacing)
    points[:, 1] = np.maximum(points[:, 1], 0.0)
    return on_wall(outline.wall, points)


def drawn_outline(shot, name, rng):
    """Corners that a person would click around a region, a pixel or so beside it: (N,2) pixels."""
    true = shot.pixels(outline_in_space(name)).astype(np.float32)
    corners = cv2.approxPolyDP(true[:, None], 0.8, closed=True)[:, 0].astype(np.float64)
    return corners + rng.normal(0, 0.9, corners.shape)


def wholly_visible(shot, name, occluders, surface_points):
    """Whether a region's outline is in the frame and nothing hides its `surface_points` (N,3)."""
    inside = outline_in_space(name)
    pixels = shot.pixels(inside)
    local = inside @ shot.rotation.T + shot.translation
    margin = 6
    framed = (pixels > margin).all() and (pixels < (WIDTH - 1 - margin, HEIGHT - 1 - margin)).all()
    if not framed or local[:, 2].min() < 0.5:
        return False
    return bool(np.mean(occluders.sees(shot.position, surface_points)) > 0.995)


def mask(outline):
    """Pixels whose centre lies in a polygon, by the even-odd rule: (N,2) -> (HEIGHT, WIDTH) bool."""
    out = np.zeros((HEIGHT, WIDTH), dtype=bool)
    a, b = outline, np.roll(outline, -1, axis=0)
    columns = np.arange(WIDTH)
    for row in range(max(0, int(outline[:, 1].min())), min(HEIGHT, int(outline[:, 1].max()) + 2)):
        crossing = (a[:, 1] > row) != (b[:, 1] > row)
        p, q = a[crossing], b[crossing]
        at = p[:, 0] + (row - p[:, 1]) * (q[:, 0] - p[:, 0]) / (q[:, 1] - p[:, 1])
        out[row] = np.sum(at[None, :] < columns[:, None], axis=1) % 2 == 1
    return out
