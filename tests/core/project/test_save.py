"""Whatever a project asks of its stages is asked again by the file it is saved to."""

from dataclasses import replace

import numpy as np
import pytest
from fresco.core.jobs import drain
from fresco.core.project.load import load_project
from fresco.core.project.save import save_project_job

STAGES = """
[pose]
up = [0.0, 0.0, 1.0]

[refine]
edges = { centre_sigma = 0.03 }
joint = true
lenses = true

[texture]
max_angle = 71.0

[atlas]
texel_size = 0.004
charts = "surface"
level = false

[simplify]
tolerance_mm = 2.5

[[colour_chart]]
photo = "képek/kép 1.png"
corners = [[1.5, 2.0], [30.0, 2.5], [29.0, 20.0], [2.0, 19.5]]
method = "root-polynomial"
"""


@pytest.fixture
def saved(folder):
    """Return a project with all stages, and the same one after it was saved and read again."""
    path = folder / "terv.toml"
    path.write_text(path.read_text(encoding="utf-8") + STAGES, encoding="utf-8")
    before = load_project(path)
    copy = folder / "másik.toml"
    drain(save_project_job(replace(before, path=copy)))
    return before, load_project(copy)


def test_settings_of_every_stage_come_back(saved):
    before, after = saved
    for stage in ("pose", "refine", "texture", "atlas", "simplify", "charts", "output"):
        assert getattr(after, stage) == getattr(before, stage), stage
    np.testing.assert_array_equal(after.up, before.up)


def test_photos_and_regions_come_back(saved):
    before, after = saved
    assert after.scan == before.scan and numbered(after) == numbered(before)
    for old, new in zip(before.photos, after.photos, strict=True):
        assert new.photo.path == old.photo.path and new.refine == old.refine
        assert [m.name for m in new.photo.regions] == [m.name for m in old.photo.regions]
        np.testing.assert_allclose(new.photo.camera.K, old.photo.camera.K)


def numbered(project):
    """Return the numbers and names of the regions, from one label file or several entries."""
    return {(n, name) for source in project.regions.labels for n, name in source.names.items()}
