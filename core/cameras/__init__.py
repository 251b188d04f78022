"""Central camera models and their files."""

from .base import Camera
from .distortion import Distortion
from .perspective import PerspectiveCamera

__all__ = ["Camera", "Distortion", "PerspectiveCamera"]
