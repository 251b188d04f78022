"""Sightings placed by what the photos show around them: they lie where the reference's point is seen."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from fresco.core.cameras import FisheyeCamera
from fresco.core.geometry.rays import RayCaster
from fresco.core.jobs import drain
from fresco.core.pose.joint.adjustment import Network, Noise, Prior, Problem, ScanTies
from fresco.core.pose.joint.lens import shared_lenses
from fresco.core.pose.joint.templates import UNPLACED, place_sightings_job
from fresco.core.pose.joint.tracks import Tracks
from fresco.core.settings import JointSettings

PLACES = ((-1.2, -4.2, 0.1), (0.0, -4.6, 0.3), (1.1, -4.0, -0.2))
FISHEYE = FisheyeCamera(720, 560, [[330, 0, 359.5], [0, 330, 279.5], [0, 0, 1]], [0.02, -0.01])


@pytest.fixture(scope="module")
def views(wall):
    roll = (0.0, 0.4, -0.2)
    cameras = (None, None, FISHEYE)
    return [
        wall.view(place, camera=camera, roll=turn, noise=0.2)
        for place, camera, turn in zip(PLACES, cameras, roll, strict=True)
    ]


def seen_by_all(wall, views, count=250):
    """Points (T,3) of the scan, normals (T,3), and where each photo shows them (V,T,2)."""
    rng, caster = np.random.default_rng(4), RayCaster(wall.vertices, wall.faces)
    faces = rng.choice(len(wall.faces), 16 * count, replace=False)
    corner = wall.vertices[wall.faces[faces]]
    points, normals = corner.mean(axis=1), np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    flat = np.abs(normals[:, 1]) > 0.99
    pixels = []
    for view in views:
        at = view.camera.project(points @ view.rotation.T + view.translation)
        inside = (np.abs(at - [view.camera.width / 2, view.camera.height / 2]) < [340, 250]).all(axis=1)
        flat &= inside & ~caster.occluded(view.centre, points, 0.01)
        pixels.append(at)
    # features lie where there is something to see in both directions
    corners = cv2.cornerMinEigenVal(cv2.cvtColor(views[0].image, cv2.COLOR_RGB2GRAY), 13)
    column, row = np.round(pixels[0][flat]).astype(int).T
    flat[flat] = corners[row, column] > np.median(corners)
    return points[flat][:count], normals[flat][:count], np.array(pixels)[:, flat][:, :count]


def problem_of(views, points, normals, pixels):
    """Network at the truth with sightings at `pixels` (V,T,2)."""
    count, photos = len(points), len(views)
    view, track = np.tile(np.arange(photos), count), np.repeat(np.arange(count), photos)
    at = pixels[view, track]
    rays, to_pixels = np.zeros((len(view), 3)), np.zeros((len(view), 2, 3))
    for number, photo in enumerate(views):
        rays[view == number] = photo.camera.unproject(at[view == number])
        to_pixels[view == number] = photo.camera.project_with_jacobian(rays[view == number])[1]
    tracks = Tracks(view, track, track, at, rays, to_pixels, np.ones(len(view)))
    rotations = np.array([v.rotation for v in views])
    centres = np.array([v.centre for v in views])
    return Problem(
        tracks,
        ScanTies(points, normals, np.ones(count)),
        Prior(rotations, centres, np.tile(np.eye(6), (photos, 1, 1))),
        Noise(0.3, 0.003),
        shared_lenses(views, False, JointSettings()),
    ), Network(rotations, centres, points)


def placed(views, problem, network, size=2400):
    return drain(place_sightings_job(views, [v.camera for v in views], problem, network, size))


@pytest.mark.parametrize("size", [2400, 560], ids=["full size", "reduced"])
def test_disturbed_sightings_return(wall, views, size):
    points, normals, pixels = seen_by_all(wall, views)
    assert len(points) == 250
    exact, network = problem_of(views, points, normals, pixels)
    rng = np.random.default_rng(0)
    # the references stay where they are: they say which point is meant
    untouched = placed(views, exact, network, size).pixels == exact.tracks.pixels
    shift = np.where(untouched, 0.0, rng.uniform(-0.5, 0.5, exact.tracks.pixels.shape))
    moved = pixels.copy()
    moved[exact.tracks.view, exact.tracks.track] += shift
    problem, _ = problem_of(views, points, normals, moved)
    tracks = placed(views, problem, network, size)
    off = (tracks.pixels - exact.tracks.pixels)[~untouched[:, 0]]
    assert (tracks.size == 1.0).mean() > 0.85
    assert np.abs(np.median(off, axis=0)).max() < 0.03
    assert np.median(np.linalg.norm(off, axis=1)) < 0.4 * np.median(
        np.linalg.norm(shift[shift[:, 0] != 0], axis=1)
    )
    for number, view in enumerate(views):
        mine = tracks.view == number
        assert tracks.rays[mine] == pytest.approx(view.camera.unproject(tracks.pixels[mine]))


def test_darker_photo_is_no_other_place(wall, views):
    points, normals, pixels = seen_by_all(wall, views)
    problem, network = problem_of(views, points, normals, pixels)
    dark = replace(views[1], image=(0.45 * views[1].image + 40).astype(np.uint8))
    a, b = placed(views, problem, network), placed([views[0], dark, views[2]], problem, network)
    assert np.median(np.linalg.norm(a.pixels - b.pixels, axis=1)) < 0.02


def test_what_is_not_found_keeps_its_place_and_counts_less(wall, views):
    points, normals, pixels = seen_by_all(wall, views)
    problem, network = problem_of(views, points, normals, pixels)
    noise = np.random.default_rng(1).integers(0, 255, views[2].image.shape).astype(np.uint8)
    tracks = placed([*views[:2], replace(views[2], image=noise)], problem, network)
    there = tracks.view == 2
    # a template taken from the noise is found in neither of the others
    assert (tracks.size[there] == UNPLACED).sum() > 100
    lost = tracks.size == UNPLACED
    assert np.array_equal(tracks.pixels[lost], problem.tracks.pixels[lost])
