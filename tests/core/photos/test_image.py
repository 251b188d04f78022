import base64

import cv2
import numpy as np
import pytest
from fresco.core.cameras.perspective import PerspectiveCamera
from fresco.core.errors import PhotoError
from fresco.core.photos import camera_matrix, check_complete, image_size, read_deep_image, read_image
from fresco.core.photos.image import read_transparency

CMYK = (  # 32 x 24 pixels in four inks, as Adobe's programs write them
    "/9j/7gAOQWRvYmUAZAAAAAAA/9sAQwADAgICAgIDAgICAwMDAwQGBAQEBAQIBgYFBgkICgoJCAkJCgwPDAoLDgsJCQ"
    "0RDQ4PEBAREAoMEhMSEBMPEBAQ/8AAFAgAGAAgBEMRAE0RAFkRAEsRAP/EAB8AAAEFAQEBAQEBAAAAAAAAAAABAgME"
    "BQYHCAkKC//EALUQAAIBAwMCBAMFBQQEAAABfQECAwAEEQUSITFBBhNRYQcicRQygZGhCCNCscEVUtHwJDNicoIJCh"
    "YXGBkaJSYnKCkqNDU2Nzg5OkNERUZHSElKU1RVVldYWVpjZGVmZ2hpanN0dXZ3eHl6g4SFhoeIiYqSk5SVlpeYmZqi"
    "o6Slpqeoqaqys7S1tre4ubrCw8TFxsfIycrS09TV1tfY2drh4uPk5ebn6Onq8fLz9PX29/j5+v/aAA4EQwBNAFkASw"
    "AAPwD89Pht/wAsvwr4H/4VJ/06/pX6EeJfEn3/AN5+tfqnX1X8Nv8All+FH/CpP+nX9K8q8S+JPv8A7z9aK+q/ht/y"
    "y/Cj/hUn/Tr+leU+JfEn3/3n60V9VfDb/ll+FH/CpP8Ap1/SvKvEviT7/wC8/Wiv5/8A4bf8svwr7V/4VJ/06/pX1X"
    "4l8Sff/efrRX1X8Nv+WX4Uf8Kk/wCnX9K8p8S+JPv/ALz9aK+q/ht/yy/Cj/hUn/Tr+leVeJfEn3/3n60V9VfDb/ll"
    "+FH/AAqT/p1/SvKvEviT7/7z9aK/n/8Aht/yy/Cvtb/hUn/Tr+lfVXiXxJ9/95+tFfVfw2/5ZfhR/wAKk/6df0ryrx"
    "L4k+/+8/Wivqv4bf8ALL8KP+FSf9Ov6V5V4l8Sff8A3n60V9VfDb/ll+FH/CpP+nX9K8p8S+JPv/vP1or/2Q=="
)


def picture(width=61, height=43):
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    rgb = np.stack([3 * u, 4 * v, 120 + 60 * np.sin(u / 9) * np.cos(v / 7)], axis=2)
    return np.clip(rgb, 0, 255).astype(np.uint8)


def save(path, rgb, *options):
    coded = cv2.imencode(path.suffix, rgb[:, :, ::-1], list(options))[1]
    path.write_bytes(coded.tobytes())
    return path


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "Fényképek 2024 – Ötödik nap"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp", ".jpg", ".webp"])
def test_pixels_and_size_of_every_format(folder, suffix):
    path = save(folder / f"kép 1{suffix}", picture())
    assert image_size(path) == (61, 43)
    image = read_image(path)
    assert image.shape == (43, 61, 3) and image.dtype == np.uint8
    tolerance = 0 if suffix in (".png", ".tif", ".bmp") else 12
    assert np.abs(image.astype(int) - picture()).mean() <= tolerance


def test_size_comes_from_the_header_alone(folder):
    for suffix in (".jpg", ".png"):
        path = save(folder / f"a{suffix}", picture())
        path.write_bytes(path.read_bytes()[:700])
        assert image_size(path) == (61, 43)


@pytest.mark.parametrize("keep", [0.5, 0.9, 0.999])
@pytest.mark.parametrize(
    "options", [(".jpg",), (".jpg", cv2.IMWRITE_JPEG_PROGRESSIVE, 1), (".png",), (".tif",)]
)
def test_cut_off_photo_is_noticed(folder, options, keep):
    rng = np.random.default_rng(0)
    path = save(folder / f"kép{options[0]}", rng.integers(0, 255, (64, 96, 3), dtype=np.uint8), *options[1:])
    check_complete(path)
    path.write_bytes(path.read_bytes()[: int(keep * path.stat().st_size)])
    with pytest.raises(PhotoError, match=r"kép.*(cut off|damaged|cannot be decoded)"):
        read_image(path)


def test_zero_filled_tail_is_noticed_and_extra_bytes_are_not(folder):
    path = save(folder / "a.jpg", picture(400, 300))
    data = path.read_bytes()
    path.write_bytes(data + b"\xff\xd8 maker's preview" + bytes(900))
    assert read_image(path).shape == (300, 400, 3)
    path.write_bytes(data[:3000] + bytes(len(data) - 3000))
    with pytest.raises(PhotoError, match="cut off"):
        read_image(path)


def test_missing_empty_and_foreign_files(folder):
    with pytest.raises(PhotoError, match="no such photo"):
        read_image(folder / "none.jpg")
    (folder / "empty.jpg").write_bytes(b"")
    with pytest.raises(PhotoError, match="empty"):
        read_image(folder / "empty.jpg")
    (folder / "text.jpg").write_text("not a photo")
    for read in (read_image, image_size):
        with pytest.raises(PhotoError, match="not a photo"):
            read(folder / "text.jpg")
    with pytest.raises(PhotoError, match="cannot be read"):
        read_image(folder)


@pytest.mark.parametrize("scale", [0.5, 0.25, 0.3, 0.125])
@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_scaled_image_stays_under_the_scaled_camera(folder, scale, suffix):
    width, height = 803, 601
    camera = PerspectiveCamera(width, height, camera_matrix(width, height, 700.0))
    centre = np.array([[0.11, -0.07, 1.0]])
    at = camera.project(centre)[0]
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    blob = 255 * np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * 40.0**2))
    path = save(folder / f"blob{suffix}", np.repeat(blob[:, :, None], 3, axis=2).astype(np.uint8))
    small = read_image(path, scale)[:, :, 1].astype(float)
    where = np.array(
        [(small * axis).sum() / small.sum() for axis in np.meshgrid(*map(np.arange, small.shape[::-1]))]
    )
    expected = camera.scaled(scale).project(centre)[0]
    np.testing.assert_allclose(where, expected, atol=0.03)


def test_sixteen_bits_keep_their_depth_when_asked(folder):
    deep = (np.arange(61 * 43 * 3).reshape(43, 61, 3) * 8).astype(np.uint16)
    path = folder / "deep.tif"
    path.write_bytes(cv2.imencode(".tif", deep[:, :, ::-1])[1].tobytes())
    np.testing.assert_array_equal(read_deep_image(path), deep)
    np.testing.assert_allclose(read_image(path), deep / 257, atol=1)


def test_four_inks_become_rgb(folder):
    path = folder / "cmyk.jpg"
    path.write_bytes(base64.b64decode(CMYK))
    v, u = np.mgrid[0:24, 0:32]
    rgb = np.stack([8 * u, 10 * v, np.clip(255 - 4 * u - 4 * v, 0, 255)], axis=2)
    assert image_size(path) == (32, 24)
    assert np.abs(read_image(path).astype(int) - rgb).mean() < 2


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_grey_photo_has_three_equal_channels(folder, suffix, dtype):
    if suffix == ".jpg" and dtype == np.uint16:
        return
    grey = picture()[..., 0].astype(dtype) * (257 if dtype == np.uint16 else 1)
    path = folder / f"infrared{suffix}"
    path.write_bytes(cv2.imencode(suffix, grey)[1].tobytes())
    image = read_image(path)
    assert image.shape == (43, 61, 3) and image.dtype == np.uint8
    assert np.ptp(image, axis=2).max() == 0
    assert np.abs(image[..., 0].astype(int) - picture()[..., 0]).max() <= (12 if suffix == ".jpg" else 1)
    assert read_deep_image(path).dtype == dtype


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_transparent_pixels_are_told(folder, suffix, dtype):
    full = np.iinfo(dtype).max
    alpha = np.full((43, 61, 1), full, dtype)
    alpha[:, :20] = 0
    pixels = (picture().astype(np.int64) * full // 255).astype(dtype)
    path = folder / f"cut out{suffix}"
    path.write_bytes(cv2.imencode(suffix, np.concatenate([pixels, alpha], axis=2))[1].tobytes())
    opaque = read_transparency(path)
    assert opaque is not None
    np.testing.assert_array_equal(opaque, alpha[..., 0] > 0)
    assert image_size(path) == (61, 43)
    assert read_transparency(save(folder / f"plain{suffix}", picture())) is None


@pytest.mark.parametrize("options", [(), (cv2.IMWRITE_TIFF_COMPRESSION, 1)], ids=["logarithmic", "plain"])
def test_floating_point_pixels_are_refused(folder, options):
    path = folder / "float.tif"
    path.write_bytes(cv2.imencode(".tif", picture().astype(np.float32) / 255, options)[1].tobytes())
    for read in (read_image, read_deep_image):
        with pytest.raises(
            PhotoError, match=r"float\.tif: floating-point pixels .* save the photo with 8 or 16"
        ):
            read(path)


def test_orientation_tag_does_not_turn_the_pixels(folder):
    rgb = picture()
    data = save(folder / "a.jpg", rgb).read_bytes()
    turned = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    segment = b"\xff\xe1" + (len(turned) + 2).to_bytes(2, "big") + turned
    (folder / "b.jpg").write_bytes(data[:2] + segment + data[2:])
    np.testing.assert_array_equal(read_image(folder / "b.jpg"), read_image(folder / "a.jpg"))
    assert image_size(folder / "b.jpg") == (61, 43)
