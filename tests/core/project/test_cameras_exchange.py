"""Cameras from and to other programs in a project: matched, placed on the scan, written, read back."""

import json
from pathlib import Path

import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.cameras.exchange import (
    PosedCamera,
    Reconstruction,
    read_reconstruction,
    write_reconstruction,
)
from fresco.core.errors import OutputError, PoseNotFound, ProjectError
from fresco.core.geometry.rigid import exp_so3
from fresco.core.project import load_project, run_project
from fresco.core.project.imported import match_names
from fresco.core.project.stages.exported import FORMATS, cameras_path, recorded_cameras
from hypothesis import given
from hypothesis import strategies as st

SCALE, TURN, SHIFT = 0.37, exp_so3(np.array([0.4, -1.1, 0.7])), np.array([12.0, -3.0, 5.0])
CAMERA = PerspectiveCamera(480, 360, np.array([[390.0, 0, 239.5], [0, 390, 179.5], [0, 0, 1]]))


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def wall_points():
    rng = np.random.default_rng(5)
    along, up = rng.uniform(0.1, 3.9, 400), rng.uniform(0.1, 2.9, 400)
    wall, flat = rng.integers(0, 2, 400), np.zeros(400)
    points = np.where(wall[:, None] == 0, np.stack([along, flat, up], 1), np.stack([flat, along, up], 1))
    return points + rng.normal(0, 0.002, points.shape)


def elsewhere(truth, offset=(0.0, 0.0, 0.0)):
    """The true cameras as another program would have them: in a world of its own."""
    cameras = tuple(PosedCamera(f"shots/{n}.png", CAMERA, *pose) for n, pose in truth.items())
    at_home = Reconstruction(cameras, wall_points() + offset, np.zeros((400, 3), np.uint8))
    inverse = TURN.T
    return at_home.transformed(1 / SCALE, inverse, -inverse @ SHIFT / SCALE)


def errors(result, truth):
    offset = result.scan.offset
    return [
        np.linalg.norm(p.pose.centre + offset + truth[p.photo][0].T @ truth[p.photo][1]) for p in result.poses
    ]


@pytest.mark.parametrize("offset", [(0, 0, 0), (5_012_300.0, 423_400.0, 0.0)], ids=["near", "national grid"])
def test_a_given_similarity_brings_them_onto_the_scan(corner, offset):
    path, truth = corner(offset)
    write_reconstruction(path.parent / "sparse" / "0", elsewhere(truth), "colmap")
    numbers = f"scale = {SCALE}, rotation = {TURN.tolist()}, translation = {SHIFT.tolist()}"
    edit(path, "[output]", f'[cameras]\nimport = "sparse/0"\nsimilarity = {{ {numbers} }}\n[output]')
    project = load_project(path)
    assert all(entry.imported is not None and entry.refine for entry in project.photos)
    result = run_project(project)
    assert max(errors(result, truth)) < 1e-6
    assert all(pose.given and pose.solved for pose in result.poses)
    record = json.loads((path.parent / "out" / "project_provenance.json").read_text())
    assert "sparse/0/images.txt" in record["inputs"]


def test_poses_from_regions_bring_them_onto_the_scan(corner):
    path, truth = corner()
    write_reconstruction(path.parent / "their.xml", elsewhere(truth), "metashape")
    edit(path, "[output]", '[cameras]\nimport = "their.xml"\nsimilarity = "poses"\n[output]')
    result = run_project(load_project(path))
    assert max(errors(result, truth)) < 0.05
    assert "Placed on the scan by 3 of 3 photos that have a pose" in result.poses[0].notes[0]
    for mask in (path.parent / "masks" / "B").iterdir():
        mask.unlink()
    with pytest.raises(PoseNotFound, match="Only 2 of the imported photos found their place"):
        run_project(load_project(path))


def test_points_known_in_both_worlds_bring_them_onto_the_scan(corner):
    path, truth = corner((5_012_300.0, 423_400.0, 0.0))
    write_reconstruction(path.parent / "sparse", elsewhere(truth), "colmap-binary")
    ours = np.add([[0.0, 0, 0], [3, 0, 0], [0, 2, 1], [1, 0, 2.5]], (5_012_300.0, 423_400.0, 0.0))
    theirs = (ours - SHIFT) @ TURN / SCALE
    for name, points in (("theirs.csv", theirs), ("ours.csv", ours)):
        rows = [f"P{n},{','.join(f'{x:.6f}' for x in point)}" for n, point in enumerate(points)]
        (path.parent / name).write_text("\n".join(rows))
    table = 'import = "sparse"\nsimilarity = "points"\npoints = "theirs.csv"\nscan_points = "ours.csv"'
    edit(path, "[output]", f"[cameras]\n{table}\n[output]")
    result = run_project(load_project(path))
    assert max(errors(result, truth)) < 1e-4
    (path.parent / "theirs.csv").write_text("Q1,0,0,0\nQ2,1,0,0\n")
    with pytest.raises(PoseNotFound, match="have 0 names in common"):
        run_project(load_project(path))


def test_sparse_points_are_laid_onto_the_surface(corner):
    path, truth = corner()
    small = exp_so3(np.array([0.01, -0.015, 0.008]))
    off = elsewhere(truth).transformed(SCALE, TURN, SHIFT).transformed(1.02, small, (0.02, 0.03, -0.02))
    write_reconstruction(path.parent / "off", off, "colmap")
    edit(path, "[output]", '[cameras]\nimport = "off"\nsimilarity = "surface"\n[output]')
    with pytest.raises(PoseNotFound, match="leaves open how the cameras lie on it"):
        run_project(load_project(path))  # two walls without floor: free to move up and down


def test_what_cannot_be_meant_is_refused(corner):
    path, truth = corner()
    write_reconstruction(path.parent / "sparse", elsewhere(truth), "colmap")
    edit(path, "[output]", '[cameras]\nimport = "sparsely"\n[output]')
    with pytest.raises(ProjectError, match=r"cameras.import: there is no file or folder"):
        load_project(path)
    edit(path, "sparsely", "photos")
    with pytest.raises(ProjectError, match=r"cameras.import: .* neither a COLMAP model nor XMP"):
        load_project(path)
    edit(
        path, '"photos"\n', '"sparse"\nsimilarity = { matrix = [[1,0,0,0],[0,2,0,0],[0,0,1,0],[0,0,0,1]] }\n'
    )
    with pytest.raises(ProjectError, match=r"similarity.matrix: .* not a rotation"):
        load_project(path)
    edit(path, "photos/*", "photos/A")
    edit(path, "similarity =", "# similarity =")
    (path.parent / "photos" / "A.png").rename(path.parent / "photos" / "other.png")
    edit(path, "photos/A", "photos/other")
    with pytest.raises(ProjectError, match="none of its photos is one of this project; its names are shots/"):
        load_project(path)


def test_a_lens_that_a_program_cannot_hold_is_refused_before_anything_is_computed(corner):
    path, _ = corner()
    edit(path, "focal = 390", "focal = 390\nprincipal = [230.0, 179.5]")
    edit(path, "[output]", '[output]\ncameras = ["colmap", "bundler"]')
    with pytest.raises(
        ProjectError, match=r"output.cameras: A.png: Bundler needs the principal point in the"
    ):
        run_project(load_project(path))
    assert not (path.parent / "out").exists()


@pytest.mark.parametrize("file_format", FORMATS)
def test_a_run_writes_cameras_that_come_back_the_same(corner, file_format):
    path, truth = corner((5_012_300.0, 423_400.0, 0.0))
    write_reconstruction(path.parent / "sparse", elsewhere(truth), "colmap")
    numbers = f"scale = {SCALE}, rotation = {TURN.tolist()}, translation = {SHIFT.tolist()}"
    edit(
        path, "[output]", f'[cameras]\nimport = "sparse"\nsimilarity = {{ {numbers} }}\n[output]\nobj = false'
    )
    edit(path, "obj = false", f'obj = false\ncameras = ["{file_format}"]')
    project = load_project(path)
    result = run_project(project)
    written = cameras_path(project.output.folder, "project", file_format)
    assert written.exists()
    edit(path, "[cameras]", f'[cameras]\nimport = "{written.relative_to(path.parent).as_posix()}" #')
    edit(path, '\nimport = "sparse"', "")
    edit(path, "similarity = {", "# similarity = {")
    again = run_project(load_project(path))
    world = np.add(result.scan.offset, [[0.5, 0.0, 1.0], [0.0, 1.0, 2.0], [1.5, 0.0, 0.3]])
    for one, other, photo in zip(result.poses, again.poses, again.photos, strict=True):
        pixels = [
            camera.project((world - result.scan.offset - pose.pose.centre) @ pose.pose.rotation.T)
            for camera, pose in ((CAMERA, one), (photo.camera, other))
        ]
        np.testing.assert_allclose(pixels[0], pixels[1], atol=1e-4)


def test_cameras_of_a_run_are_recorded(corner, tmp_path):
    path, truth = corner()
    with pytest.raises(OutputError, match="run the project first"):
        recorded_cameras(path.parent / "out" / "project_provenance.json")
    run_project(load_project(path))
    found = recorded_cameras(path.parent / "out" / "project_provenance.json")
    assert [camera.name for camera in found.cameras] == ["A.png", "B.png", "C.png"]
    for camera in found.cameras:
        rotation, translation = truth[camera.name[0]]
        np.testing.assert_allclose(camera.centre, -rotation.T @ translation, atol=0.05)
    write_reconstruction(tmp_path / "colmap", found, "colmap-binary")
    again = read_reconstruction(tmp_path / "colmap")
    for one, other in zip(found.cameras, again.cameras, strict=True):
        np.testing.assert_allclose(one.centre, other.centre, atol=1e-9)


@given(
    st.lists(st.sampled_from(["a/x.jpg", "b/x.jpg", "x.png", "y.JPG", "c.v2.jpg"]), unique=True, min_size=1)
)
def test_full_paths_find_their_photos(names):
    photos = [Path("/p") / name for name in names]
    assert match_names([str(photo) for photo in photos], photos) == {str(p): i for i, p in enumerate(photos)}


def test_names_may_lack_folder_or_ending_and_doubtful_ones_match_nothing():
    photos = [Path("/p/a/x.jpg"), Path("/p/b/x.jpg"), Path("/p/c/Hall 1.tif"), Path("/p/c/v1.2.jpg")]
    found = match_names(["x.jpg", "B\\X.JPG", "hall 1", "v1.2", "other"], photos)
    assert found == {"B\\X.JPG": 1, "hall 1": 2, "v1.2": 3}
