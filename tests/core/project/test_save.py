"""Whatever a project asks of its stages is asked again by the file it is saved to."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fresco.core.jobs import drain
from fresco.core.photos import read_polygons
from fresco.core.project.file.load import load_project
from fresco.core.project.file.save import save_project_job

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


def test_polygons_stay_polygons_unless_a_part_is_hidden(folder):
    text = (folder / "terv.toml").read_text(encoding="utf-8")
    (folder / "terv.toml").write_text(text.replace("maszkok/{photo}/{region}.png", "{photo}.json"))
    ring = [[10.25, 10.0], [40.5, 12.0], [30.0, 30.75], [10.25, 10.0]]
    shape = {"type": "Polygon", "coordinates": [ring, [[20, 14], [24, 14], [22, 18]]]}
    feature = {"type": "Feature", "properties": {"name": "ablak"}, "geometry": shape}
    content = {"width": 96, "height": 64, "features": [feature]}
    (folder / "kép 1.json").write_text(json.dumps(content))
    feature["hidden"] = [[[10, 10], [20, 10], [20, 20]]]
    (folder / "kép 2.json").write_text(json.dumps(content))

    before = load_project(folder / "terv.toml")
    drain(save_project_job(replace(before, path=folder / "másik.toml")))
    after = load_project(folder / "másik.toml")

    (old,), (new,) = before.photos[0].photo.regions, after.photos[0].photo.regions
    np.testing.assert_array_equal(new.outline, old.outline)
    np.testing.assert_array_equal(new.holes[0], old.holes[0])
    assert "ablak" in read_polygons(folder / "másik_files" / "polygons" / "kép 1.geojson")
    (old,), (new,) = before.photos[1].photo.regions, after.photos[1].photo.regions
    assert new.read_mask(96, 64).any()
    np.testing.assert_array_equal(new.read_hidden(96, 64), old.hidden)
