import numpy as np
import pytest
from fresco.core.cameras import (
    CatadioptricCamera,
    Distortion,
    DivisionCamera,
    EquirectangularCamera,
    ExtendedUnifiedCamera,
    FieldOfViewCamera,
    FisheyeCamera,
    InverseRadialCamera,
    PerspectiveCamera,
    PolynomialCamera,
)

SIZE = (1600, 1200)
K = np.array([[500.0, 0.4, 803.3], [0, 495.0, 590.8], [0, 0, 1]])
WIDE_K = np.array([[900.0, 0.4, 803.3], [0, 905.0, 590.8], [0, 0, 1]])
MEI_K = np.array([[1170.0, 0.5, 803.3], [0, 1176.0, 590.8], [0, 0, 1]])
LONG_K = np.array([[1100.0, 0.4, 803.3], [0, 1089.0, 590.8], [0, 0, 1]])
CAMERAS = {
    "perspective": PerspectiveCamera(*SIZE, K, (-0.05, 0.01, 4e-4, -3e-4)),
    "perspective_rational": PerspectiveCamera(*SIZE, K, (8.2, 3.1, 2e-4, -1e-4, 0.2, 8.6, 5.2, 0.9)),
    "fisheye": FisheyeCamera(*SIZE, K, (-0.02, 0.003, -0.002, 0.0004)),
    "equidistant": FisheyeCamera(*SIZE, K),
    "thin_prism_fisheye": FisheyeCamera(
        *SIZE, K, (0.03, -0.006, 1e-3), Distortion(tangential=(4e-4, -3e-4), prism=(1e-3, -1e-4, -8e-4, 2e-4))
    ),
    "metashape_fisheye": FisheyeCamera(
        *SIZE, K, (), Distortion(radial=(-0.02, 1e-3, -2e-4, 1e-5), tangential=(4e-4, -3e-4))
    ),
    "polynomial": PolynomialCamera(
        *SIZE, (803.3, 590.8), (485.0, 0, -7.2e-4, 2.1e-7, -4.4e-10), (1.0006, 3e-4, -2e-4)
    ),
    "polynomial_perspective": PolynomialCamera(*SIZE, (803.3, 590.8), (700.0,)),
    "catadioptric": CatadioptricCamera(*SIZE, WIDE_K, 0.85),
    "para_catadioptric": CatadioptricCamera(*SIZE, WIDE_K, 1.0),
    "mei": CatadioptricCamera(*SIZE, MEI_K, 1.4, (-0.05, 0.01, 4e-4, -3e-4)),
    "sphere_perspective": CatadioptricCamera(*SIZE, K, 0.0),
    "equirectangular": EquirectangularCamera(1600, 800),
    "cropped_panorama": EquirectangularCamera(1600, 500, (2400, 1200), (1300, 200)),
    "extended_unified": ExtendedUnifiedCamera(*SIZE, K, 0.6, 1.1),
    "orthographic": ExtendedUnifiedCamera(*SIZE, LONG_K, 1.0, 1.0),
    "flat_unified": ExtendedUnifiedCamera(*SIZE, K, 0.3, 0.9),
    "division_barrel": DivisionCamera(*SIZE, K, -0.2),
    "division_pincushion": DivisionCamera(*SIZE, K, 0.05),
    "field_of_view": FieldOfViewCamera(*SIZE, K, 0.8),
    "inverse_pincushion": InverseRadialCamera(*SIZE, K, -0.05),
    "inverse_barrel": InverseRadialCamera(*SIZE, K, 0.1),
}


@pytest.fixture(params=CAMERAS)
def any_camera(request):
    return CAMERAS[request.param]


@pytest.fixture(scope="session")
def any_camera_for_properties():
    return tuple(CAMERAS.values())
