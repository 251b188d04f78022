"""The scene's own world: Blender keeps single precision, so large coordinates have an offset in double.

True world coordinates (metres, as in the scan's file) = Blender's coordinates + offset.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...core.arrays import FloatArray

OFFSET_KEY = "fresco_offset"
LARGEST_COORDINATE = 1000.0  # m; beyond it single precision is coarser than 0.06 mm
OFFSET_STEP = 100.0  # m; a round number can be read and typed into other programs


def choose_offset(vertices: FloatArray) -> FloatArray:
    """Offset (3,) in metres that brings (V,3) world vertices near the origin; zero on axes that need none."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    far = np.maximum(np.abs(low), np.abs(high)) > LARGEST_COORDINATE
    return np.where(far, np.round((low + high) / 2 / OFFSET_STEP) * OFFSET_STEP, 0.0)


def read_offset(scene: bpy.types.Scene) -> FloatArray:
    """Return the scene's offset (3,), metres."""
    return np.array(scene.get(OFFSET_KEY, (0.0, 0.0, 0.0)), dtype=np.float64)


def write_offset(scene: bpy.types.Scene, offset: FloatArray) -> None:
    """Keep the offset (3,), metres, in the scene: an ID property of doubles, saved with the file."""
    scene[OFFSET_KEY] = [float(value) for value in offset]


def matrix_to_array(matrix: object) -> FloatArray:
    """Blender's 4x4 matrix as a (4,4) array of doubles."""
    return np.array(matrix, dtype=np.float64)
