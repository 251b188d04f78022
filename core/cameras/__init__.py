"""Central camera models and their files."""

from .base import Camera
from .catadioptric import CatadioptricCamera
from .distortion import Distortion
from .equirectangular import EquirectangularCamera
from .fisheye import FisheyeCamera
from .lens_models import DivisionCamera, ExtendedUnifiedCamera, FieldOfViewCamera, InverseRadialCamera
from .perspective import PerspectiveCamera
from .polynomial import PolynomialCamera
from .resolution import angular_resolution, ground_sample_distance, pixel_solid_angle

__all__ = [
    "Camera",
    "CatadioptricCamera",
    "Distortion",
    "DivisionCamera",
    "EquirectangularCamera",
    "ExtendedUnifiedCamera",
    "FieldOfViewCamera",
    "FisheyeCamera",
    "InverseRadialCamera",
    "PerspectiveCamera",
    "PolynomialCamera",
    "angular_resolution",
    "ground_sample_distance",
    "pixel_solid_angle",
]
