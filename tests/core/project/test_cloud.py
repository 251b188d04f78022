"""A project whose scan is a point cloud: photos placed by regions of points, points coloured by them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from fresco.core.errors import ProjectError
from fresco.core.project.file.load import load_project
from fresco.core.project.run import run_project
from fresco.core.report import write_report
from fresco.core.scans import read_scan


def to_cloud(path):
    """Replace the corner's mesh by points on it, some 15 mm apart, with a label each."""
    folder = path.parent
    mesh, labels = read_scan(folder / "scan.ply"), np.load(folder / "labels.npy")
    steps = (np.arange(12) + 0.5) / 12
    a, b = (grid.ravel() for grid in np.meshgrid(steps, steps))
    inside = a + b < 1
    corners = mesh.vertices[mesh.faces]
    weights = np.stack([1 - a - b, a, b], axis=1)[inside]
    points = np.einsum("nk,fkc->fnc", weights, corners).reshape(-1, 3) + mesh.offset
    np.save(folder / "labels.npy", np.repeat(labels[mesh.file_faces], len(weights)))
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
    (folder / "scan.ply").write_bytes(header.encode() + points.astype("<f8").tobytes())
    return points


def test_points_are_coloured_by_photos_that_their_regions_place(corner):
    path, truth = corner()
    points = to_cloud(path)
    result = run_project(load_project(path))
    solved = [pose for pose in result.poses if pose.solved]
    assert result.textured is None and len(solved) >= 2, [pose.failure for pose in result.poses]
    for pose in solved:
        rotation, translation = truth[pose.photo]
        assert np.linalg.norm(pose.pose.centre + rotation.T @ translation) < 0.15
    assert result.clouds[""].coverage > 0.6
    written = path.parent / "out" / "project_colours.ply"
    cloud = read_scan(written)
    assert cloud.is_cloud and len(cloud.vertices) == len(points)
    np.testing.assert_allclose(cloud.vertices + cloud.offset, points, atol=1e-9)
    header = written.read_bytes()[:800].decode("latin1")
    assert f"comment photo 0 {solved[0].photo}" in header and "property int photo" in header
    # the walls are painted by a wave that every photo shows alike: the mean colour is the paint's
    seen = result.clouds[""].selection.view >= 0
    assert np.abs(cloud.vertex_colors[seen].mean(axis=0) - 130).max() < 25
    assert cloud.vertex_colors[seen].std() > 20, "not one colour"
    record = json.loads((path.parent / "out" / "project_provenance.json").read_text(encoding="utf-8"))
    assert record["clouds"][""]["coverage"] == result.clouds[""].coverage
    assert "Photos and their regions" in write_report(result, path.parent / "r.html").read_text()


@pytest.mark.parametrize(
    "text, key",
    [("[refine]\nedges = true", "refine"), ("[atlas]", "atlas"), ("[simplify]\nfaces = 9", "simplify")],
)
def test_what_needs_faces_is_refused(corner, text, key):
    path, _ = corner()
    to_cloud(path)
    content = path.read_text(encoding="utf-8")
    path.write_text(content.replace("[output]", f"{text}\n[output]"), encoding="utf-8")
    with pytest.raises(ProjectError, match=f"{key}: needs the faces of a mesh"):
        run_project(load_project(path))
    assert not (path.parent / "out").exists()


def test_labels_of_another_number_of_points_are_refused(corner):
    path, _ = corner()
    to_cloud(path)
    np.save(path.parent / "labels.npy", np.zeros(10, dtype=np.int16))
    with pytest.raises(ProjectError, match=r"labels of shape \(10,\), but the scan's file has \d+ points"):
        run_project(load_project(path))
