"""A real fountain from masks and mesh to a textured model; the solved cameras against those of the survey."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from fresco.core.geometry.rigid import log_so3
from fresco.core.project import load_project, run_project

FOLDER = Path(__file__).parent
DATA = FOLDER.parents[2] / "shared" / "data" / "fountain-P11"

WITHIN_THREE_SIGMA = 20.06  # chi-squared with 6 degrees of freedom, 99.73 %

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the photos and the mesh of fountain-P11 are not at ../shared/data"
)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    project = load_project(FOLDER / "project.toml")
    output = dataclasses.replace(project.output, folder=tmp_path_factory.mktemp("fountain"))
    return run_project(dataclasses.replace(project, output=output))


@pytest.fixture(scope="module")
def survey():
    """Rotation and centre of every photo, by name."""
    cameras = json.loads((DATA / "cameras.json").read_text(encoding="utf-8"))["cameras"]
    return {Path(c["image"]).stem: (np.array(c["R"]), np.array(c["center"])) for c in cameras}


def test_every_photo_with_two_regions_stands_where_the_survey_saw_it(result, survey):
    marked = {photo.name for photo in result.photos if len(photo.regions) >= 2}
    assert len(marked) == 10
    rotation, share = [], []
    middle = result.scan.vertices.mean(axis=0) + result.scan.offset
    for found in result.poses:
        if found.photo not in marked:
            continue
        assert found.solved, f"{found.photo}: {found.failure}"
        true_rotation, true_centre = survey[found.photo]
        off = found.pose.centre + result.scan.offset - true_centre
        turn = log_so3(found.pose.rotation @ true_rotation.T)
        rotation.append(float(np.degrees(np.linalg.norm(turn))))
        share.append(100 * float(np.linalg.norm(off) / np.linalg.norm(middle - true_centre)))
        print(
            f"{found.photo}: {rotation[-1]:.3f} deg (sigma {found.pose.rotation_sigma:.3f}), "
            f"{100 * np.linalg.norm(off):.1f} cm (sigma {100 * found.pose.centre_sigma:.1f}), "
            f"overlap error {found.overlap_error:.2f} %, {len(found.regions)} regions"
        )
        assert rotation[-1] < 3 * found.pose.rotation_sigma
        assert np.linalg.norm(off) < 3 * found.pose.centre_sigma
        error = np.concatenate([turn, off])
        assert error @ np.linalg.solve(found.pose.covariance, error) < WITHIN_THREE_SIGMA
    print(f"median {np.median(rotation):.3f} deg, {np.median(share):.3f} % of the distance")
    assert np.median(rotation) <= 0.12
    assert np.median(share) <= 0.18


def test_photo_without_regions_says_so(result):
    without = [pose for pose in result.poses if not pose.solved]
    assert [pose.photo for pose in without] == ["0000"]
    assert "No region is marked" in without[0].failure


def test_the_model_is_textured(result):
    assert result.textured.coverage > 0.95
    used = np.unique(result.textured.selection.view[result.textured.selection.view >= 0])
    assert len(result.textured.views) == 10
    assert len(used) >= 8  # a photo whose pose disagrees with the others may be left out
    folder = result.project.output.folder
    library = (folder / "project.mtl").read_text(encoding="utf-8")
    assert library.count("map_Kd") >= len(used)
    record = json.loads((folder / "project_provenance.json").read_text(encoding="utf-8"))
    assert sum(photo["faces"] for photo in record["photos"]) == (result.textured.selection.view >= 0).sum()
