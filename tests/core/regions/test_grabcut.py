import cv2
import numpy as np
import pytest
from fresco.core.errors import RegionError
from fresco.core.regions.photo.grabcut import grab_cut


def shield():
    """Photo 700 x 500 with a textured ellipse on a textured ground, and the ellipse's mask."""
    rng = np.random.default_rng(0)
    mask = np.zeros((500, 700), dtype=np.uint8)
    cv2.ellipse(mask, (350, 250), (150, 90), 20, 0, 360, 1, cv2.FILLED)
    image = np.where(mask[..., None] > 0, (90, 120, 160), (160, 140, 110)) + rng.normal(0, 12, (500, 700, 3))
    return np.clip(image, 0, 255).astype(np.uint8), mask > 0


def test_a_rough_ellipse_becomes_exact():
    image, truth = shield()
    rough = np.zeros(truth.shape, dtype=np.uint8)
    cv2.ellipse(rough, (358, 243), (163, 84), 14, 0, 360, 1, cv2.FILLED)
    found = grab_cut(image, rough > 0)
    assert np.count_nonzero(found & truth) / np.count_nonzero(found | truth) > 0.98
    assert np.array_equal(found, grab_cut(image, rough > 0))


@pytest.mark.parametrize("margin", [-10, 0, 12])
def test_a_box_around_a_panel_on_a_patterned_wall_leaves_the_wall_out(margin):
    rng = np.random.default_rng(1)
    v, u = np.mgrid[0:320, 0:480]
    tile = np.array([(120, 120, 140), (80, 80, 110), (150, 150, 160)])
    image = tile[((u // 24 + v // 24) % 3)] + rng.normal(0, 3, (320, 480, 3))
    panel = cv2.fillConvexPoly(
        np.zeros((320, 480), np.uint8), np.array([(92, 20), (182, 14), (186, 140), (104, 166)]), 1
    )
    image[panel > 0] = (60, 200, 80)
    columns, rows = np.flatnonzero(panel.any(axis=0)), np.flatnonzero(panel.any(axis=1))
    box = np.zeros_like(panel)
    low, high = (columns[0] - margin, rows[0] - margin), (columns[-1] + margin, rows[-1] + margin)
    cv2.rectangle(box, np.array(low).tolist(), np.array(high).tolist(), 1, cv2.FILLED)
    found = grab_cut(np.clip(image, 0, 255).astype(np.uint8), box > 0)
    truth = panel > 0
    assert np.count_nonzero(found & truth) / np.count_nonzero(found | truth) > 0.97


def test_bad_outlines_are_refused():
    image, truth = shield()
    with pytest.raises(RegionError, match="photo's size"):
        grab_cut(image, truth[:100])
    tiny = np.zeros_like(truth)
    tiny[5, 5:8] = True
    with pytest.raises(RegionError, match="only 3 pixels"):
        grab_cut(image, tiny)
    with pytest.raises(RegionError, match="whole photo"):
        grab_cut(image, np.ones_like(truth))
