import json

import cv2
import numpy as np
import pytest
from exif_files import LONG, RATIO, SHORT, TEXT, photo_file
from fresco.core.cameras.perspective import PerspectiveCamera
from fresco.core.errors import CameraError, PhotoError, RegionError
from fresco.core.photos import (
    Exif,
    RegionMark,
    camera_matrix,
    focal_from_sensor,
    open_photo,
    polygons_to_geojson,
    read_exif,
    read_mask,
    read_polygons,
    touches_frame,
)


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "Képek és maszkok"
    folder.mkdir()
    return folder


def mask_file(path, mask):
    path.write_bytes(cv2.imencode(path.suffix, mask)[1].tobytes())
    return path


def test_exif_of_a_full_photo(folder):
    path = photo_file(
        folder / "a.jpg",
        tags={0x10F: (TEXT, "NIKON"), 0x110: (TEXT, "D850"), 0x112: (SHORT, 8)},
        exif={
            0x829A: (RATIO, [(1, 60)]),
            0x829D: (RATIO, [(8, 1)]),
            0x8827: (SHORT, 64),
            0x9206: (RATIO, [(35, 10)]),
            0x920A: (RATIO, [(24, 1)]),
            0xA405: (SHORT, 24),
            0xA434: (TEXT, "24 mm f/1.4"),
            0xA431: (TEXT, "3001"),
            0xA002: (LONG, 90),
            0xA003: (LONG, 60),
            0xA20E: (RATIO, [(90 * 254, 36 * 10)]),
            0xA210: (SHORT, 2),
        },
        gps={
            1: (TEXT, "S"),
            2: (RATIO, [(46, 1), (30, 1), (36, 1)]),
            3: (TEXT, "E"),
            4: (RATIO, [(20, 1), (15, 1), (0, 1)]),
            6: (RATIO, [(1125, 10)]),
        },
    )
    exif = read_exif(path)
    assert (exif.make, exif.model, exif.lens, exif.serial) == ("NIKON", "D850", "24 mm f/1.4", "3001")
    assert (exif.focal_length, exif.aperture, exif.focus_distance, exif.iso) == (24, 8, 3.5, 64)
    assert exif.exposure_time == pytest.approx(1 / 60)
    assert exif.orientation == 8 and exif.up == (1.0, 0.0)
    assert exif.gps == pytest.approx((-46.51, 20.25, 112.5))
    # 36 mm over 90 pixels: 24 mm are 60 pixels, the same by sensor resolution and by 35 mm equivalent.
    assert exif.focal_pixels(90, 60)[0] == pytest.approx(60)
    assert exif.focal_pixels(45, 30)[0] == pytest.approx(30)
    assert Exif(focal_length_35mm=24).focal_pixels(90, 60)[0] == pytest.approx(60)


def test_photo_without_exif_needs_a_camera(folder):
    path = photo_file(folder / "bare.jpg")
    assert read_exif(path) == Exif()
    with pytest.raises(CameraError, match="does not tell its focal length"):
        open_photo(path)
    camera = PerspectiveCamera(90, 60, camera_matrix(90, 60, 75.0))
    photo = open_photo(path, camera)
    assert photo.name == "bare" and photo.camera is camera and photo.notes == ()


def test_camera_from_exif_has_a_note_and_the_principal_point_in_the_middle(folder):
    photo = open_photo(photo_file(folder / "a.jpg", exif={0xA405: (SHORT, 24)}))
    ray = photo.camera.unproject([[44.5, 29.5]])
    np.testing.assert_allclose(ray, [[0, 0, 1]], atol=1e-12)
    assert "35 mm equivalent of 24 mm, good to about 2 %" in photo.notes[0]


def test_listed_body_gives_the_sensor(folder):
    tags = {0x10F: (TEXT, "NIKON CORPORATION"), 0x110: (TEXT, "NIKON D850")}
    path = photo_file(folder / "a.jpg", tags=tags, exif={0x920A: (RATIO, [(24, 1)]), 0xA405: (SHORT, 25)})
    photo = open_photo(path)
    # The smaller of 35.9 mm over 90 and 23.9 mm over 60 pixels is the size of a pixel.
    assert photo.camera.K[0, 0] == pytest.approx(24 / (23.9 / 60))
    assert "Nominal camera of NIKON D850, 24 mm, perspective" in photo.notes[0]


def test_turned_photo_has_a_note(folder):
    photo = open_photo(photo_file(folder / "a.jpg", tags={0x112: (SHORT, 6)}, exif={0xA405: (SHORT, 24)}))
    assert "turned by 90° clockwise (EXIF orientation 6)" in photo.notes[0]
    assert "stored, 90 x 60" in photo.notes[0]
    assert photo.exif.up == (-1.0, 0.0)


def test_damaged_exif_counts_as_none(folder):
    path = photo_file(folder / "a.jpg", exif={0xA405: (SHORT, 24), 0x920A: (RATIO, [(24, 0)])})
    assert read_exif(path).focal_length is None
    data = path.read_bytes()
    at = data.index(b"MM\0*") + 8
    path.write_bytes(data[:at] + b"\xff" * 40 + data[at + 40 :])
    assert read_exif(path).focal_length is None


def test_photo_of_another_size_than_its_calibration(folder):
    path = photo_file(folder / "kép.jpg")
    with pytest.raises(PhotoError, match=r"90 x 60 pixels, but its camera is calibrated for 180 x 120"):
        open_photo(path, PerspectiveCamera(180, 120, camera_matrix(180, 120, 150.0)))


def test_camera_from_sensor_numbers():
    assert focal_from_sensor(50.0, 36.0, 6000, 4000) == pytest.approx(8333.33, abs=0.01)
    assert focal_from_sensor(50.0, 36.0, 4000, 6000) == pytest.approx(8333.33, abs=0.01)
    with pytest.raises(CameraError, match="positive"):
        focal_from_sensor(50.0, 0.0, 6000, 4000)


def region(height=60, width=90):
    mask = np.zeros((height, width), np.uint8)
    mask[20:40, 30:70] = 255
    return mask


@pytest.mark.parametrize(
    "stored",
    [
        region(),
        region() // 255,
        np.repeat(region()[:, :, None], 3, axis=2),
        np.dstack([np.full((60, 90, 3), 255, np.uint8), region()]),
        region().astype(np.uint16) * 257,
    ],
    ids=["grey", "zero and one", "colour", "alpha", "sixteen bits"],
)
def test_masks_as_programs_write_them(folder, stored):
    mask = read_mask(mask_file(folder / "déli ablak.png", stored))
    np.testing.assert_array_equal(mask, region() > 0)


def test_masks_that_do_not_fit(folder):
    path = mask_file(folder / "ablak.png", region())
    mark = RegionMark("ablak", path)
    assert mark.read_mask(90, 60).sum() == 800
    with pytest.raises(RegionError, match=r"ablak\.png: the mask is 90 x 60 pixels, but its photo 180 x 120"):
        mark.read_mask(180, 120)
    with pytest.raises(RegionError, match="turned photo"):
        mark.read_mask(60, 90)
    mask_file(path, np.zeros((60, 90), np.uint8))
    with pytest.raises(RegionError, match=r"ablak\.png: the mask is empty"):
        mark.read_mask(90, 60)
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(RegionError, match="damaged"):
        mark.read_mask(90, 60)
    with pytest.raises(RegionError, match="no such mask"):
        RegionMark("none", folder / "none.png").read_mask(90, 60)


def test_mask_at_the_frame():
    mask = region() > 0
    assert not touches_frame(mask)
    for edge in (np.s_[0, 40], np.s_[-1, 40], np.s_[30, 0], np.s_[30, -1]):
        touching = mask.copy()
        touching[edge] = True
        assert touches_frame(touching)


def test_a_mask_without_outline_inside_the_photo(folder):
    mask = np.ones((60, 80), bool)
    with pytest.raises(RegionError, match="ajtó: the mask is white everywhere, it has no outline inside"):
        RegionMark("ajtó", mask=mask).read_mask(80, 60)


def test_an_inverted_mask_is_asked_about(folder):
    mask = np.ones((60, 80), bool)
    mask[20:40, 30:50] = False
    with pytest.raises(RegionError, match=r"ajtó: .* on all four sides: is the mask inverted\?"):
        RegionMark("ajtó", mask=mask).read_mask(80, 60)
    mask[:, :20] = False  # cut off by three sides
    np.testing.assert_array_equal(RegionMark("ajtó", mask=mask).read_mask(80, 60), mask)


def test_polygons_there_and_back(folder):
    outline, hole = np.array([[1.5, 2], [9, 2], [9, 8.25]]), np.array([[5, 3], [6, 3], [6, 4]])
    behind = np.array([[0, 0], [4, 0], [4, 4]])
    path = folder / "régiók.json"
    shapes = {"déli ablak": ([[outline, hole]], []), "ajtó": ([[outline]], [behind])}
    path.write_text(json.dumps(polygons_to_geojson(shapes, (20, 10)), ensure_ascii=False), encoding="utf-8")
    back = read_polygons(path)
    np.testing.assert_array_equal(back["déli ablak"].outline, outline)
    np.testing.assert_array_equal(back["déli ablak"].holes[0], hole)
    assert back["déli ablak"].hidden is None and back["ajtó"].hidden.sum() == 10


def test_a_region_of_several_pieces_is_a_multipolygon(folder):
    first, hole = np.array([[0, 0], [8, 0], [8, 8], [0, 8]]), np.array([[2, 2], [2, 4], [4, 4], [4, 2]])
    content = polygons_to_geojson({"két ablak": ([[first, hole], [first + np.array([10, 0])]], [])}, (20, 10))
    geometry = content["features"][0]["geometry"]
    assert geometry["type"] == "MultiPolygon" and [len(piece) for piece in geometry["coordinates"]] == [2, 1]
    path = folder / "a.json"
    path.write_text(json.dumps(content))
    mask = read_polygons(path)["két ablak"].read_mask(20, 10)
    assert mask.sum() == 64 - 4 + 64 and mask[3, 3] == 0 and mask[3, 13]
    del content["width"]
    path.write_text(json.dumps(content))
    with pytest.raises(RegionError, match="MultiPolygons need the photo's width and height"):
        read_polygons(path)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("{", "not a JSON file"),
        ("{}", "no “features”"),
        ('{"features": [{}]}', r"feature 0: has no properties\.name"),
        ('{"features": [{"properties": {"name": "a"}, "geometry": {"type": "Point"}}]}', "is no Polygon"),
        ('{"features": [{"properties": {"name": "a"}, "geometry": {"type": "Polygon"}}]}', "no coordinates"),
        (
            '{"features": [{"properties": {"name": "a"}, '
            '"geometry": {"type": "Polygon", "coordinates": [["x"]]}}]}',
            r"list of \[u, v\]",
        ),
    ],
)
def test_polygons_that_are_wrong(folder, content, reason):
    (folder / "a.json").write_text(content)
    with pytest.raises(RegionError, match=reason):
        read_polygons(folder / "a.json")
