"""Central camera models and their files."""

from .base import Camera

__all__ = ["Camera"]
