import cv2
import numpy as np
import pytest
from fresco.core.errors import RegionError
from fresco.core.regions.grabcut import grab_cut


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
