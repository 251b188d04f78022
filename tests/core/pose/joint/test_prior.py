"""What regions and edges told enters as a pose with its covariance: the same as their residuals matched anew.

The joint solution is compared with one whose outlines and edges are matched again at its own poses and
linearised there, with the weights they had.
"""

from dataclasses import replace

import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.boundary import subdivided
from fresco.core.geometry.outlines import fill_loops
from fresco.core.geometry.rigid import exp_so3, log_so3, skew
from fresco.core.pose import estimate_pose, refine_pose_by_edges, refine_poses_jointly
from fresco.core.pose.edges.alignment import Photo, PosePrior, align_edges
from fresco.core.pose.edges.photo_edges import photo_edge_field
from fresco.core.pose.edges.rendering import EdgeScan
from fresco.core.pose.edges.scan_edges import find_scan_edges
from fresco.core.pose.points.perturbation import invert_scaled
from fresco.core.pose.regions.contour import match, robust_weights
from fresco.core.pose.regions.fitting import LEVELS, SCALES, Contours
from fresco.core.pose.regions.problem import make_problem
from fresco.core.regions import ImageRegion, SurfaceRegion
from fresco.core.settings import EdgeSettings, JointSettings

SMALL = PerspectiveCamera(640, 480, [[560, 0, 319.5], [0, 560, 239.5], [0, 0, 1]])
FEW = JointSettings(features=1500)
DRAWN = LEVELS[1]
"""The level at which outlines drawn by hand coincide."""


@pytest.fixture(scope="module")
def views(wall):
    places = ((-0.9, -5.0, 0.1), (0.0, -5.2, 0.4), (0.9, -5.0, -0.2))
    return [wall.view(place, camera=SMALL) for place in places]


def jointly(views, wall):
    return refine_poses_jointly(views, wall.vertices, wall.faces, FEW)


def told_by(view, pose):
    """View that starts at a pose and knows its covariance."""
    return replace(
        view, rotation=pose.rotation, translation=pose.translation, covariance=pose.covariance, mask=None
    )


def moved(view, pose, step, covariance):
    rotation, centre = exp_so3(step[:3]) @ pose.rotation, pose.centre + step[3:]
    return replace(view, rotation=rotation, translation=-rotation @ centre, covariance=covariance)


def apart(poses, others):
    """Distances of poses in standard deviations, root mean square over the unknowns."""
    steps = [
        np.r_[log_so3(p.rotation @ q.rotation.T), p.centre - q.centre]
        for p, q in zip(poses, others, strict=True)
    ]
    return [np.sqrt(s @ np.linalg.solve(q.covariance, s) / 6) for s, q in zip(steps, others, strict=True)]


def block_fronts(wall):
    """Fronts of the wall's blocks: regions of the scan, and their corners."""
    height = -wall.vertices[:, 1]
    for out in (0.25, 0.35, 0.5, 0.8):
        faces = wall.faces[np.isclose(height[wall.faces], out).all(axis=1)]
        kept, numbers = np.unique(faces, return_inverse=True)
        points = wall.vertices[kept]
        (left, _, low), (right, _, top) = points.min(axis=0), points.max(axis=0)
        corners = [(left, -out, low), (right, -out, low), (right, -out, top), (left, -out, top)]
        yield SurfaceRegion(points, numbers.reshape(-1, 3), f"{out}"), np.array(corners)


def drawn_by_hand(view, corners, name, rng):
    """Region of a photo whose outline strays by about two pixels."""
    line = view.camera.project(subdivided(corners, 0.01) @ view.rotation.T + view.translation)
    turn = np.linspace(0, 2 * np.pi, len(line), endpoint=False)
    for waves in range(2, 20, 2):
        line += rng.normal(0, 0.6, 2) * np.sin(waves * turn[:, None] + rng.uniform(0, 6.3, 2))
    return ImageRegion.from_mask(fill_loops([line], view.camera.width, view.camera.height), name)


def outline_term(camera, contours, pose):
    """Normal equations (6,6), (6,) of outlines matched at a pose, by turn and camera centre."""
    shift = pose.translation + pose.rotation @ contours.problem.origin
    matrix, gradient = np.zeros((6, 6)), np.zeros(6)
    for pair in contours.pairs(DRAWN, pose.rotation, shift):
        found = match(camera, pair, pose.rotation, shift)
        weighted = found.jacobian * robust_weights(found.distances, SCALES[-1] * DRAWN.near)[:, None]
        matrix += weighted.T @ found.jacobian
        gradient += weighted.T @ np.nan_to_num(found.distances)
    change = np.eye(6)
    change[3:, :3], change[3:, 3:] = -pose.rotation.T @ skew(shift), -pose.rotation.T
    back = np.linalg.inv(change)
    return back.T @ matrix @ back, back.T @ gradient


def test_outlines_matched_anew_change_nothing(wall, views):
    rng = np.random.default_rng(1)
    surfaces, corners = zip(*block_fronts(wall), strict=True)
    drawn = [
        [drawn_by_hand(v, c, s.name, rng) for c, s in zip(corners, surfaces, strict=True)] for v in views
    ]
    regions = [estimate_pose(SMALL, images, surfaces) for images in drawn]
    before = jointly([told_by(v, p) for v, p in zip(views, regions, strict=True)], wall)
    anew = []
    for view, images, region, pose in zip(views, drawn, regions, before, strict=True):
        contours = Contours(make_problem(SMALL, images, surfaces, True))
        # errors hang together along the outline: the region's own covariance says by how much
        share = np.trace(region.covariance @ outline_term(SMALL, contours, region)[0]) / 6
        matrix, gradient = outline_term(SMALL, contours, pose)
        anew.append(moved(view, pose, -np.linalg.solve(matrix, gradient), share * invert_scaled(matrix)))
    assert max(apart(regions, before)) > 0.3, "the ties moved the poses"
    assert max(apart(jointly(anew, wall), before)) < 0.2


def test_edges_matched_anew_stay_within_the_doubt(wall, views):
    rng, settings = np.random.default_rng(3), EdgeSettings()
    sigma = np.repeat([np.radians(0.1), 0.01], 3)
    starts = [moved(view, view, rng.normal(0, sigma), np.diag(sigma**2)) for view in views]
    edges = [refine_pose_by_edges(start, wall.vertices, wall.faces) for start in starts]
    assert sum(pose.refined for pose in edges) >= 2
    before = jointly([told_by(v, p) for v, p in zip(starts, edges, strict=True)], wall)
    origin = wall.vertices.mean(axis=0)
    scan = EdgeScan.of_mesh(wall.vertices - origin, wall.faces, None)
    anew = []
    for start, by_edges, pose in zip(starts, edges, before, strict=True):
        if not by_edges.refined:
            anew.append(start)
            continue
        prior = PosePrior(start.rotation, start.centre - origin, start.covariance)
        photo = Photo(SMALL, photo_edge_field(start.image, None), settings.search, 0.0)
        here = pose.rotation, pose.centre - origin
        seen = find_scan_edges(photo.camera, *here, scan, settings)
        found = align_edges(photo, seen, *here, prior, (1.0,))
        translation = -found.rotation @ (found.centre + origin)
        anew.append(
            replace(start, rotation=found.rotation, translation=translation, covariance=found.covariance)
        )
    assert max(apart(jointly(anew, wall), before)) < 1.5
