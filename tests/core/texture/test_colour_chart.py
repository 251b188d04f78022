from __future__ import annotations

import cv2
import numpy as np
import pytest
from fresco.core.errors import PhotoError
from fresco.core.texture.colour.colour_chart import REFERENCE, find_colour_chart
from fresco.core.texture.colour.correction import fit_correction
from fresco.core.texture.colour.difference import lab_to_linear
from fresco.core.texture.views.images import to_bytes, to_srgb

CAST = np.array([[0.80, 0.10, 0.02], [0.06, 0.62, 0.05], [0.01, 0.12, 0.42]])
PITCH, SIDE, RIM = 48, 41, 30


def flat_chart():
    """The chart (linear) straight on, and the pixel of its first patch's centre."""
    image = np.full((4 * PITCH + 2 * RIM, 6 * PITCH + 2 * RIM, 3), 0.012)
    for number, colour in enumerate(np.clip(lab_to_linear(REFERENCE), 0, 1)):
        x, y = RIM + (number % 6) * PITCH, RIM + (number // 6) * PITCH
        gap = (PITCH - SIDE) // 2
        image[y + gap : y + gap + SIDE, x + gap : x + gap + SIDE] = colour
    return image


def photograph_chart(corners, size=(900, 1200), cast=CAST, noise=1.5, seed=0, shading=0.0):
    """A photo of a chart, its board's corners at `corners` (4,2) px, before clutter; and the truth."""
    random = np.random.default_rng(seed)
    clutter = cv2.resize(random.random((30, 40, 3)), size[::-1], interpolation=cv2.INTER_CUBIC)
    scene = np.clip(0.15 + 0.25 * clutter, 0, 1)
    for _ in range(25):
        at, colour = random.integers(0, min(size), 2), random.random(3)
        cv2.rectangle(scene, at.tolist(), (at + random.integers(10, 60, 2)).tolist(), colour.tolist(), -1)
    chart = flat_chart()
    height, width = chart.shape[:2]
    board = np.float32([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    homography = cv2.getPerspectiveTransform(board, np.float32(corners))
    warped = cv2.warpPerspective(chart, homography, size[::-1], flags=cv2.INTER_AREA)
    inside = cv2.warpPerspective(np.ones((height, width)), homography, size[::-1])[..., None]
    light = (scene * (1 - inside) + warped * inside) @ cast.T
    light *= 1 + shading * np.linspace(-1, 1, size[1])[None, :, None]
    photo = to_bytes(to_srgb(light)).astype(float) + random.normal(scale=noise, size=light.shape)
    centre = RIM + PITCH * (np.stack(np.meshgrid(np.arange(6), np.arange(4)), -1).reshape(-1, 2) + 0.5) - 0.5
    truth = cv2.perspectiveTransform(centre[None].astype(np.float64), homography.astype(np.float64))[0]
    return np.clip(np.rint(photo), 0, 255).astype(np.uint8), truth


VIEWS = {
    "straight": [(300, 250), (780, 250), (780, 590), (300, 590)],
    "tilted": [(350, 260), (800, 330), (760, 620), (320, 590)],
    "upside down": [(780, 590), (300, 590), (300, 250), (780, 250)],
    "on its side": [(700, 150), (700, 650), (350, 650), (350, 150)],
    "small": [(500, 400), (640, 410), (636, 510), (498, 500)],
    "from the side": [(400, 200), (640, 260), (640, 560), (400, 640)],
}


@pytest.mark.parametrize("view", VIEWS)
def test_the_chart_is_found_and_its_colours_made_true(view):
    photo, truth = photograph_chart(VIEWS[view], seed=len(view))
    chart = find_colour_chart(photo)
    np.testing.assert_allclose(chart.centre, truth, atol=1.5)
    found = fit_correction(chart.colour, REFERENCE, chart.usable)
    assert found.before > 8
    assert found.after < 1.5
    assert found.left_out < 2.5


def test_uneven_light_on_the_chart_leaves_a_larger_difference():
    after = []
    for shading in (0.0, 0.6):
        photo, truth = photograph_chart(VIEWS["straight"], shading=shading)
        chart = find_colour_chart(photo)
        np.testing.assert_allclose(chart.centre, truth, atol=1.5)
        after.append(fit_correction(chart.colour, REFERENCE, chart.usable).after)
    assert after[1] > 2 * after[0]


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
def test_rough_corners_in_any_order_are_refined(turn):
    photo, truth = photograph_chart(VIEWS["tilted"])
    field = np.array([[-0.43, -0.43], [5.43, -0.43], [5.43, 3.43], [-0.43, 3.43]])
    index = np.stack(np.meshgrid(np.arange(6), np.arange(4)), -1).reshape(-1, 2).astype(float)
    corners = cv2.perspectiveTransform(field[None], cv2.findHomography(index, truth)[0])[0]
    rough = np.roll(corners, turn, axis=0) + np.random.default_rng(turn).uniform(-6, 6, (4, 2))
    np.testing.assert_allclose(find_colour_chart(photo, rough).centre, truth, atol=1.5)


def chessboard():
    image = np.full((900, 1200, 3), 120, np.uint8)
    for row in range(4):
        for column in range(6):
            colour = 230 if (row + column) % 2 else 30
            image[200 + 60 * row : 250 + 60 * row, 300 + 60 * column : 350 + 60 * column] = colour
    return image


def random_colours():
    image = np.full((900, 1200, 3), 25, np.uint8)
    colours = np.random.default_rng(8).integers(30, 230, (24, 3))
    for number, colour in enumerate(colours):
        x, y = 300 + 60 * (number % 6), 200 + 60 * (number // 6)
        image[y : y + 50, x : x + 50] = colour
    return image


@pytest.mark.parametrize(
    "photo",
    [
        chessboard(),
        random_colours(),
        np.full((300, 400, 3), 90, np.uint8),
        np.random.default_rng(1).integers(0, 255, (400, 600, 3)).astype(np.uint8),
    ],
    ids=["chessboard", "other colours", "plain", "noise"],
)
def test_a_chart_that_is_not_there_is_refused(photo):
    with pytest.raises(PhotoError, match="No colour chart"):
        find_colour_chart(photo)
    middle = [(290, 190), (660, 190), (660, 440), (290, 440)] if photo.shape[0] > 800 else None
    if middle is not None:
        with pytest.raises(PhotoError, match="No colour chart"):
            find_colour_chart(photo, middle)


def test_corners_without_an_area_are_refused():
    with pytest.raises(PhotoError, match="20 x 20"):
        find_colour_chart(np.zeros((50, 50, 3), np.uint8), [(1, 1), (2, 2), (3, 3), (4, 4)])
    with pytest.raises(PhotoError, match="four corners"):
        find_colour_chart(np.zeros((50, 50, 3), np.uint8), [(1, 1), (2, 2)])
