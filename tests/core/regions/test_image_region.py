import numpy as np
import pytest
from fresco.core.errors import RegionError
from fresco.core.regions import ImageRegion


def ring():
    mask = np.zeros((40, 60), dtype=bool)
    mask[5:35, 10:50] = True
    mask[15:20, 20:30] = False
    return mask


def test_mask_with_a_hole_and_back():
    region = ImageRegion.from_mask(ring(), "window")
    assert region.area == ring().sum()
    assert region.frame == (60, 40)
    assert len(region.loops) == 2
    np.testing.assert_array_equal(region.to_mask(60, 40), ring())


def test_grey_masks_count_from_one():
    assert ImageRegion.from_mask(ring().astype(np.uint8) * 255).area == ring().sum()


def test_polygon_is_the_same_however_it_is_wound():
    outline = np.array([(9.5, 4.5), (49.5, 4.5), (49.5, 34.5), (9.5, 34.5)])
    hole = np.array([(19.5, 14.5), (29.5, 14.5), (29.5, 19.5), (19.5, 19.5)])
    for turned in (1, -1):
        region = ImageRegion.from_polygon(outline[::turned], [hole[::turned]])
        assert region.area == ring().sum()
        np.testing.assert_array_equal(region.to_mask(60, 40), ring())


@pytest.mark.parametrize(
    ("mask", "hidden", "message"),
    [
        (np.zeros((4, 5), bool), None, "'niche' is empty"),
        (np.zeros((4, 5, 3), bool), None, "one value per pixel"),
        (np.ones((4, 5), bool), np.zeros((5, 5), bool), "another size than its mask"),
    ],
)
def test_bad_masks(mask, hidden, message):
    with pytest.raises(RegionError, match=message):
        ImageRegion.from_mask(mask, "niche", hidden)


@pytest.mark.parametrize(
    ("outline", "message"),
    [
        ([(0, 0), (1, 1)], "at least three"),
        ([(0, 0), (1, 1), (np.nan, 3)], "not numbers"),
        ([(0, 0), (1, 1), (2, 2)], "no area"),
    ],
)
def test_bad_polygons(outline, message):
    with pytest.raises(RegionError, match=message):
        ImageRegion.from_polygon(outline, name="niche")
