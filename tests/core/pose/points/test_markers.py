"""Markers drawn at known places are found to a fraction of a pixel."""

import cv2
import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.errors import PhotoError
from fresco.core.pose.points.markers import (
    detect_checkerboard_markers,
    detect_coded_markers,
    detect_round_markers,
    snap_to_corner,
)
from fresco.core.pose.points.survey import Survey, match_by_name, match_by_place

OVER = 8


def photographed(pattern, homography, size=(400, 300)):
    """The plane pattern(x, y) -> brightness seen through a homography (plane -> pixels), area-averaged."""
    width, height = size
    fine_u = (np.arange(width * OVER) + 0.5) / OVER - 0.5
    fine_v = (np.arange(height * OVER) + 0.5) / OVER - 0.5
    u, v = np.meshgrid(fine_u, fine_v)
    plane = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(homography).T
    fine = pattern(plane[..., 0] / plane[..., 2], plane[..., 1] / plane[..., 2]).astype(np.float32)
    image = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(0).normal(0, 1.0, image.shape)
    grey = np.clip(cv2.GaussianBlur(image, (0, 0), 0.7) + noise, 0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def seen_at(homography):
    return homography[:2, 2] / homography[2, 2]


SLANTED = np.array([[40.0, 9, 190.3], [-6, 33, 140.6], [0.02, 0.03, 1]])
FLAT = np.array([[40.0, 9, 190.3], [-6, 33, 140.6], [0, 0, 1]])


def test_round_target_is_found():
    image = photographed(lambda x, y: np.where(np.hypot(x, y) < 0.6, 30, 210), FLAT)
    (marker,) = detect_round_markers(image)
    assert np.linalg.norm(marker.pixel - seen_at(FLAT)) < 0.08


def test_checkerboard_target_is_found():
    def board(x, y):
        inside = (np.abs(x) < 1) & (np.abs(y) < 1)
        return np.where(inside, np.where((x > 0) == (y > 0), 30, 220), 128)

    markers = detect_checkerboard_markers(photographed(board, SLANTED))
    nearest = min(markers, key=lambda m: np.linalg.norm(m.pixel - seen_at(SLANTED)))
    assert np.linalg.norm(nearest.pixel - seen_at(SLANTED)) < 0.1
    picked = snap_to_corner(photographed(board, SLANTED), seen_at(SLANTED) + np.array([2.5, -2]))
    assert np.linalg.norm(picked - seen_at(SLANTED)) < 0.1


@pytest.mark.parametrize("family", ["apriltag-36h11", "aruco-4x4"])
def test_coded_marker_is_found_and_read(family):
    from fresco.core.pose.points.markers import FAMILIES

    dictionary = cv2.aruco.getPredefinedDictionary(FAMILIES[family])
    code = cv2.aruco.generateImageMarker(dictionary, 7, 80)

    def square(x, y):
        column, row = np.floor(40 * (x + 1)).astype(int), np.floor(40 * (y + 1)).astype(int)
        inside = (column >= 0) & (column < 80) & (row >= 0) & (row < 80)
        return np.where(inside, code[np.clip(row, 0, 79), np.clip(column, 0, 79)], 255)

    (marker,) = detect_coded_markers(photographed(square, SLANTED), family)
    assert marker.name == "7"
    assert np.linalg.norm(marker.pixel - seen_at(SLANTED)) < 0.15


def test_empty_photos_have_no_markers_and_unknown_families_are_refused():
    empty = np.full((200, 200, 3), 128, np.uint8)
    assert detect_coded_markers(empty) == []
    assert detect_round_markers(empty) == []
    assert detect_checkerboard_markers(empty) == []
    assert snap_to_corner(empty, (1, 1)) is None
    with pytest.raises(PhotoError, match="choose one of"):
        detect_coded_markers(empty, "qr")


def test_markers_are_matched_by_place_and_by_name():
    from fresco.core.pose.points.markers import Marker

    survey = Survey(("a", "b"), np.array([[0.0, 0, 5], [1, 0, 5]]))
    camera = PerspectiveCamera(400, 300, [[300, 0, 200], [0, 300, 150], [0, 0, 1]])
    markers = [Marker("", np.array([262.0, 151])), Marker("", np.array([20.0, 20]))]
    pixels, points, names = match_by_place(markers, survey, camera, np.eye(3), np.zeros(3), radius=10)
    assert names == ["b"]
    assert np.allclose(points, survey.points[1:])
    assert np.allclose(pixels, [[262, 151]])
    coded = [
        Marker("b", np.array([1.0, 2])),
        Marker("c", np.zeros(2)),
        Marker("a", np.ones(2)),
        Marker("a", np.ones(2)),
    ]
    assert match_by_name(coded, survey)[2] == ["b"]
