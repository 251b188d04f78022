"""The shipped sample fits together: scan, photos, masks, labels, cameras and the truth agree."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from fresco.core.geometry.rigid import rotation_angle
from fresco.core.photos.image import check_complete
from fresco.core.photos.marks import touches_frame
from fresco.core.project.file.load import load_project
from fresco.core.project.stages.poses import solve_poses
from fresco.core.project.stages.refinement import RefineSettings, refine_poses
from fresco.core.project.stages.surfaces import check_partners, region_faces, surface_regions
from fresco.core.regions import ImageRegion
from fresco.core.scans.read import read_scan

SAMPLE = Path(__file__).resolve().parents[2] / "sample"


@pytest.fixture(scope="module")
def project():
    return load_project(SAMPLE / "project.toml")


@pytest.fixture(scope="module")
def scan(project):
    return read_scan(project.scan.path)


@pytest.fixture(scope="module")
def surfaces(project, scan):
    found = surface_regions(scan, region_faces(project, scan))
    check_partners(project, found)
    return found


@pytest.fixture(scope="module")
def truth():
    poses = json.loads((SAMPLE / "truth.json").read_text(encoding="utf-8"))
    return {
        Path(name).stem: (np.array(p["rotation"]), np.array(p["translation"])) for name, p in poses.items()
    }


def test_the_sample_is_small():
    files = [path for path in SAMPLE.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    assert sum(path.stat().st_size for path in files) < 8e6
    assert max(path.stat().st_size for path in files) < 2e6


def test_photos_differ_in_lens_and_exposure_and_show_enough_regions(project):
    photos = [entry.photo for entry in project.photos]
    assert 6 <= len(photos) <= 8
    assert {photo.exif.focal_length for photo in photos} == {24.0, 35.0, 50.0}
    assert len({photo.exif.exposure_time for photo in photos}) > 3
    for photo in photos:
        check_complete(photo.path)
        assert 2 <= len(photo.regions) <= 4, photo.name
        assert np.any(photo.camera.distortion.radial)
        focal = photo.camera.K[0, 0]
        assert photo.exif.focal_length == pytest.approx(focal * 36 / 1500, abs=0.01)


def test_the_scan_has_no_colour_and_needs_no_repair(scan):
    assert scan.vertex_colors is None and scan.intensity is None
    assert 60_000 < len(scan.faces) < 200_000
    assert len(scan.faces) == scan.file_face_count
    assert not scan.report


def test_masks_show_the_regions_where_the_true_cameras_see_them(project, surfaces, truth):
    for entry in project.photos:
        photo = entry.photo
        rotation, translation = truth[photo.name]
        for mark in photo.regions:
            mask = mark.read_mask(photo.camera.width, photo.camera.height)
            assert not touches_frame(mask)
            pixels = [
                photo.camera.project(loop @ rotation.T + translation) for loop in surfaces[mark.name].loops
            ]
            seen = ImageRegion.from_polygon(max(pixels, key=len)).to_mask(
                photo.camera.width, photo.camera.height
            )
            overlap = np.count_nonzero(mask & seen) / np.count_nonzero(mask | seen)
            assert 0.95 < overlap < 0.999, (photo.name, mark.name)  # drawn by hand: good, not perfect


def test_every_photo_is_solved_close_to_the_truth(project, surfaces, truth):
    results = solve_poses([entry.photo for entry in project.photos], surfaces)
    angles, distances = [], []
    for result in results:
        assert result.solved, f"{result.photo}: {result.failure}"
        rotation, translation = truth[result.photo]
        angles.append(np.degrees(rotation_angle(result.pose.rotation @ rotation.T)))
        distances.append(np.linalg.norm(result.pose.centre + rotation.T @ translation))
    assert np.median(angles) < 0.3 and max(angles) < 0.8
    assert np.median(distances) < 0.025 and max(distances) < 0.07


def test_refined_together_the_photos_stand_right_to_millimetres(project, scan, surfaces, truth):
    photos = [entry.photo for entry in project.photos]
    rough = solve_poses(photos, surfaces)
    fewer = dataclasses.replace(project.refine.joint, features=1200, first_features=1000)
    refined = refine_poses(scan, photos, rough, RefineSettings(joint=fewer))
    angles, distances = [], []
    for result in refined:
        assert result.refinements[-1].moved, result.refinements[-1].note
        rotation, translation = truth[result.photo]
        angles.append(np.degrees(rotation_angle(result.pose.rotation @ rotation.T)))
        distances.append(np.linalg.norm(result.pose.centre + rotation.T @ translation))
    assert np.median(angles) < 0.05 and max(angles) < 0.1
    assert np.median(distances) < 0.005 and max(distances) < 0.01
