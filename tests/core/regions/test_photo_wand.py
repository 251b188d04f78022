import cv2
import numpy as np
import pytest
from fresco.core.errors import RegionError
from fresco.core.geometry.polygons import polygon_areas, polygon_moments
from fresco.core.jobs import Progress
from fresco.core.regions.photo.snap import snap_outline, snap_polygon
from fresco.core.regions.photo.wand import prepare_wand, prepare_wand_job
from fresco.core.settings import RegionSettings

PANEL = np.array([[210.3, 160.2], [611.8, 190.6], [590.4, 421.7], [190.9, 440.1]])
OPENING = (760, 300)


def facade(seed=3):
    """Ornamented panel, rough wall, dark round opening, painted disc: (H,W,3) uint8 and the panel's mask."""
    rng = np.random.default_rng(seed)
    height, width = 600, 900
    wall = np.full((height, width, 3), (150, 120, 110), dtype=np.float32)
    wall += cv2.GaussianBlur(rng.normal(0, 30, (height, width)).astype(np.float32), (0, 0), 1.5)[..., None]
    panel = np.zeros((height * 8, width * 8), dtype=np.uint8)  # drawn eight times larger: sub-pixel edges
    cv2.fillPoly(panel, [np.round((PANEL + 0.5) * 8 - 0.5).astype(np.int32)], 1)
    share = cv2.resize(panel.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)[..., None]
    inside = np.full_like(wall, (120, 75, 72))
    for _ in range(60):
        u, v = rng.integers([215, 170], [590, 430])
        cv2.circle(inside, (int(u), int(v)), int(rng.integers(4, 14)), (90, 60, 62), 3)
    image = wall * (1 - share) + inside * share
    cv2.circle(image, OPENING, 60, (25, 25, 30), cv2.FILLED)
    image = cv2.GaussianBlur(image, (0, 0), 0.7) + rng.normal(0, 2, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def panel_mask():
    mask = np.zeros((600, 900), dtype=np.uint8)
    cv2.fillPoly(mask, [np.round(PANEL).astype(np.int32)], 1)
    return mask > 0


def iou(a, b):
    return np.count_nonzero(a & b) / np.count_nonzero(a | b)


@pytest.fixture(scope="module")
def wand():
    return prepare_wand(facade())


def test_one_click_finds_an_ornamented_panel(wand):
    level = wand.click((401, 303)).level()
    assert level.straight
    assert iou(wand.mask(wand.finished(level)), panel_mask()) > 0.98


def test_the_finished_panel_is_exact_to_a_fraction_of_a_pixel(wand):
    (corners,) = wand.finished(wand.click((401, 303)).level())
    gap = np.linalg.norm(corners[:, None] - PANEL[None], axis=-1).min(axis=0)
    assert gap.max() < 0.8


def test_one_click_finds_a_round_opening_by_colour(wand):
    level = wand.click(OPENING, "colour").level()
    mask = np.zeros((600, 900), dtype=np.uint8)
    cv2.circle(mask, OPENING, 60, 1, cv2.FILLED)
    assert iou(wand.mask(wand.finished(level)), mask > 0) > 0.96


def test_levels_grow_and_end_at_the_last(wand):
    click = wand.click((401, 303))
    areas = [level.area for level in click.levels]
    assert areas == sorted(areas)
    assert click.level(-1000) is click.levels[0]
    assert click.level(1000) is click.levels[-1]


def test_a_larger_tolerance_never_shrinks_a_region(wand):
    areas = [wand.grow(OPENING, tolerance).area for tolerance in (2, 8, 20, 50)]
    assert areas == sorted(areas)


def test_the_working_copy_may_be_much_smaller_than_the_photo():
    large = cv2.resize(facade(), None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    wand = prepare_wand(large, RegionSettings(working_size=900))
    assert wand.factor == pytest.approx(1 / 3)
    mask = cv2.resize(panel_mask().astype(np.uint8), None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST) > 0
    pixel = (401 + 0.5) * 3 - 0.5, (303 + 0.5) * 3 - 0.5
    assert iou(wand.mask(wand.finished(wand.click(pixel).level())), mask) > 0.98


def test_clicks_that_cannot_work_say_so(wand):
    for pixel in ((-5, 10), (5000, 10), (np.nan, 3)):
        with pytest.raises(RegionError, match="outside the photo"):
            wand.click(pixel)
    sky = prepare_wand(np.full((200, 300, 3), 240, dtype=np.uint8))
    with pytest.raises(RegionError, match="goes on outside the photo"):
        sky.click((150, 100))
    with pytest.raises(RegionError, match="closed outline"):
        sky.click((150, 100), "frame")


def test_sky_and_what_the_frame_cuts_off_are_no_regions():
    rng = np.random.default_rng(5)
    image = facade().astype(np.float32)
    image[:120] = np.linspace(200, 235, 120)[:, None, None] + rng.normal(0, 2, (120, 900, 3))  # sky
    cv2.rectangle(image, (840, 200), (899, 420), (30, 32, 40), cv2.FILLED)  # a window cut by the frame
    wand = prepare_wand(np.clip(image, 0, 255).astype(np.uint8))
    for pixel in ((450, 50), (880, 310)):
        with pytest.raises(RegionError, match="goes on outside the photo"):
            wand.click(pixel, "colour")


def test_a_region_of_three_pixels_is_not_offered():
    image = np.full((300, 400, 3), 140, dtype=np.uint8)
    image[150, 200:203] = 10
    with pytest.raises(RegionError, match="goes on outside the photo"):
        prepare_wand(image).click((201, 150))


def test_photos_that_are_not_8_bit_are_refused():
    with pytest.raises(RegionError, match="8-bit"):
        prepare_wand(np.zeros((50, 50, 3), dtype=np.float32))


def test_preparing_is_a_job_that_can_be_stopped():
    job = prepare_wand_job(facade())
    assert isinstance(next(job), Progress)
    job.close()


def test_snapping_moves_a_rough_circle_onto_the_edge():
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rough = np.array(OPENING) + np.stack([np.cos(angle), np.sin(angle)], axis=1) * (
        60 + 5 * np.sin(3 * angle)[:, None]
    )
    snapped = snap_outline(facade(), rough, 9)
    radius = np.linalg.norm(snapped - OPENING, axis=1)
    assert abs(np.median(radius) - 60) < 0.7
    assert np.quantile(np.abs(radius - np.median(radius)), 0.9) < 1.0


def test_snapping_without_an_edge_leaves_the_outline():
    flat = np.full((100, 100, 3), 128, dtype=np.uint8)
    corners = np.array([[20.0, 20.0], [70.0, 22.0], [72.0, 68.0], [18.0, 71.0]])
    assert np.abs(snap_polygon(flat, corners, 5) - corners).max() < 0.6


def test_moments_of_polygons():
    box = np.array([[[2.0, 1.0], [8.0, 1.0], [8.0, 4.0], [2.0, 4.0]]])
    mean, spread = polygon_moments(box)
    assert np.allclose(mean, [[5, 2.5]])
    assert np.allclose(spread, [[[36 / 12, 0], [0, 9 / 12]]])
    assert np.allclose(polygon_areas(box), 18)
