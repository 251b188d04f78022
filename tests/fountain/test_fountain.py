"""A real fountain from masks and mesh to a textured model; the solved cameras against those of the survey."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from fresco.core.geometry.rigid import rotation_angle
from fresco.core.project import load_project, run_project

FOLDER = Path(__file__).parent
DATA = FOLDER.parents[2] / "shared" / "data" / "fountain-P11"

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
    rotation, centre = [], []
    for found in result.poses:
        if found.photo not in marked:
            continue
        assert found.solved, f"{found.photo}: {found.failure}"
        true_rotation, true_centre = survey[found.photo]
        rotation.append(float(np.degrees(rotation_angle(found.pose.rotation @ true_rotation.T))))
        centre.append(float(np.linalg.norm(found.pose.centre + result.scan.offset - true_centre)))
        print(
            f"{found.photo}: {rotation[-1]:.3f} deg (sigma {found.pose.rotation_sigma:.3f}), "
            f"{100 * centre[-1]:.1f} cm (sigma {100 * found.pose.centre_sigma:.1f}), "
            f"overlap error {found.overlap_error:.2f} %, {len(found.regions)} regions"
        )
    print(f"median {np.median(rotation):.3f} deg, {100 * np.median(centre):.2f} cm")
    assert np.median(rotation) < 0.2
    assert np.median(centre) < 0.025


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
