"""Picture agreement on pictures that differ in a known way."""

import cv2
import numpy as np
import pytest
from fresco.core.errors import TextureError
from fresco.core.texture.quality import compare_images, fit_gain, image_offset, psnr, ssim
from hypothesis import given, settings
from hypothesis import strategies as st


def noise_image(seed=1, sigma=2.5, size=(180, 240)):
    rng = np.random.default_rng(seed)
    image = cv2.GaussianBlur(rng.normal(size=(*size, 3)), (0, 0), sigma)
    return np.clip(128 + 40 * image / image.std(), 0, 255)


def shifted(image, du, dv):
    """The image moved right by du and down by dv, by the Fourier shift theorem on a periodic copy."""
    fv, fu = np.fft.fftfreq(image.shape[0])[:, None, None], np.fft.fftfreq(image.shape[1])[None, :, None]
    spectrum = np.fft.fft2(image, axes=(0, 1)) * np.exp(-2j * np.pi * (fu * du + fv * dv))
    return np.clip(np.rint(np.fft.ifft2(spectrum, axes=(0, 1)).real), 0, 255).astype(np.uint8)


def all_of(image):
    return np.ones(image.shape[:2], dtype=bool)


@settings(max_examples=15, deadline=None)
@given(st.floats(-2, 2), st.floats(-2, 2), st.integers(0, 99))
def test_a_known_shift_is_found(du, dv, seed):
    image = noise_image(seed)
    covered = all_of(image)
    covered[:, :12] = covered[:12] = covered[:, -12:] = covered[-12:] = False
    found = image_offset(shifted(image, du, dv), np.rint(image).astype(np.uint8), covered)
    assert np.hypot(found[0] - du, found[1] - dv) < 0.03


def test_the_shift_is_found_under_another_exposure():
    image = noise_image(3)
    darker = (shifted(image, 0.4, -0.3) * 0.7).astype(np.uint8)
    found = image_offset(darker, image.astype(np.uint8), all_of(image))
    assert np.allclose(found, (0.4, -0.3), atol=0.04)


def test_too_little_cover_gives_no_shift():
    image = noise_image().astype(np.uint8)
    covered = np.zeros(image.shape[:2], dtype=bool)
    covered[:5, :5] = True
    assert np.isnan(image_offset(image, image, covered)).all()


def test_psnr_of_a_known_error():
    image = np.full((20, 30, 3), 100, np.uint8)
    covered = all_of(image)
    assert psnr(image + 5, image, covered) == pytest.approx(20 * np.log10(255 / 5))
    assert psnr(image, image, covered) == float("inf")
    spoiled = image.copy()
    spoiled[0, 0] = 255
    covered[0, 0] = False
    assert psnr(spoiled, image, covered) == float("inf")


def test_ssim_is_one_for_equal_and_falls_with_blur_and_noise():
    image = noise_image(5).astype(np.uint8)
    covered = all_of(image)
    blurred = cv2.GaussianBlur(image, (0, 0), 4)
    noisy = np.clip(image + np.random.default_rng(0).normal(0, 40, image.shape), 0, 255).astype(np.uint8)
    assert ssim(image, image, covered) == pytest.approx(1, abs=1e-4)
    assert ssim(blurred, image, covered) < 0.9
    assert ssim(noisy, image, covered) < 0.9


def test_ssim_looks_only_at_whole_windows():
    image = noise_image(6).astype(np.uint8)
    covered = all_of(image)
    covered[:, 120:] = False
    spoiled = image.copy()
    spoiled[:, 120:] = 0
    assert ssim(spoiled, image, covered) == pytest.approx(1, abs=1e-4)


def test_gain_fit_undoes_an_exposure_difference():
    image = np.rint(noise_image(7)).astype(np.uint8)
    covered = all_of(image)
    darker = np.rint(image * np.array([0.6, 0.8, 0.9])).astype(np.uint8)
    assert psnr(darker, image, covered) < 20
    assert psnr(fit_gain(darker, image, covered), image, covered) > 45
    agreement = compare_images(darker, image, covered)
    assert agreement.gain_fitted_psnr > agreement.psnr + 20
    assert agreement.coverage == 1


def test_pictures_that_cannot_be_compared_are_refused():
    image = noise_image().astype(np.uint8)
    with pytest.raises(TextureError, match="differ in size"):
        psnr(image, image[:-1], all_of(image))
    with pytest.raises(TextureError, match="no pixel"):
        psnr(image, image, ~all_of(image))
