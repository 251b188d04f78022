import json

import numpy as np
import pytest
from fresco.core.errors import OutputError, RegionError
from fresco.core.photos.marks import read_mask, read_polygons
from fresco.core.regions import ImageRegion
from fresco.core.regions.files import read_polygon_regions, write_mask, write_polygons


def ring_mask():
    mask = np.zeros((60, 80), dtype=bool)
    mask[10:50, 10:60] = True
    mask[20:30, 20:30] = False
    mask[5:8, 70:78] = True
    return mask


def test_masks_survive_as_png(tmp_path):
    write_mask(tmp_path / "new" / "wall.png", ring_mask())
    assert np.array_equal(read_mask(tmp_path / "new" / "wall.png"), ring_mask())


def test_polygons_with_holes_islands_and_hidden_parts_survive(tmp_path):
    hidden = np.zeros((60, 80), dtype=bool)
    hidden[40:55, 5:30] = True
    region = ImageRegion.from_mask(ring_mask(), "niche", hidden)
    write_polygons(tmp_path / "r.json", [region], 80, 60)
    (back,) = read_polygon_regions(tmp_path / "r.json")
    assert back.name == "niche"
    assert np.array_equal(back.to_mask(80, 60), ring_mask())
    assert np.array_equal(back.hidden, hidden)


def test_a_single_polygon_is_plain_geojson_that_the_project_reads(tmp_path):
    region = ImageRegion.from_polygon([[1.5, 2.5], [20, 3], [15, 18]], name="gable")
    write_polygons(tmp_path / "r.json", [region], 40, 40)
    mark = read_polygons(tmp_path / "r.json")["gable"]
    assert np.allclose(mark.outline, region.loops[0])
    assert json.loads((tmp_path / "r.json").read_text())["pixel_origin"] == "centre of the top-left pixel"


def test_another_pixel_origin_is_converted(tmp_path):
    region = ImageRegion.from_polygon([[1.0, 2.0], [20, 3], [15, 18]], name="a")
    write_polygons(tmp_path / "r.json", [region], 40, 40)
    text = (tmp_path / "r.json").read_text().replace("centre of the top", "corner of the top")
    (tmp_path / "r.json").write_text(text)
    (back,) = read_polygon_regions(tmp_path / "r.json")
    assert np.allclose(back.loops[0], region.loops[0] - 0.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "cannot be read"),
        ("[]", "no “features”"),
        ('{"features": [{}]}', "properties.name"),
        ('{"features": [{"properties": {"name": "a"}, "geometry": {"type": "Point"}}]}', "no Polygon"),
        (
            '{"features": [{"properties": {"name": "a"}, "geometry": '
            '{"type": "Polygon", "coordinates": [[1]]}}]}',
            "at least three",
        ),
        ('{"features": [], "pixel_origin": "middle"}', "pixel_origin"),
    ],
)
def test_files_that_make_no_sense_say_where(tmp_path, text, message):
    (tmp_path / "r.json").write_text(text)
    with pytest.raises(RegionError, match=message):
        read_polygon_regions(tmp_path / "r.json")


def test_a_folder_that_cannot_be_made_is_an_output_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        write_mask(tmp_path / "file" / "m.png", ring_mask())
