"""The scene's own world: Blender keeps single precision, so large coordinates have an offset in double.

True world coordinates (metres, as in the scan's file) = Blender's coordinates + offset.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...core.arrays import FloatArray

OFFSET_KEY = "fresco_offset"


def read_offset(scene: bpy.types.Scene) -> FloatArray:
    """Return the scene's offset (3,), metres."""
    return np.array(scene.get(OFFSET_KEY, (0.0, 0.0, 0.0)), dtype=np.float64)


def write_offset(scene: bpy.types.Scene, offset: FloatArray) -> None:
    """Keep the offset (3,), metres, in the scene: an ID property of doubles, saved with the file."""
    scene[OFFSET_KEY] = [float(value) for value in offset]


def matrix_to_array(matrix: object) -> FloatArray:
    """Blender's 4x4 matrix as a (4,4) array of doubles."""
    return np.array(matrix, dtype=np.float64)


def collection(scene: bpy.types.Scene, name: str) -> bpy.types.Collection:
    """Return a collection inside the scene's collection "Fresco"; both are made where they are missing."""
    return _child(_child(scene.collection, "Fresco"), name)


def _child(parent: bpy.types.Collection, name: str) -> bpy.types.Collection:
    """Return the child collection of that name; Blender may have added a number to it."""
    found = next((child for child in parent.children if child.name.split(".")[0] == name), None)
    if found is None:
        found = bpy.data.collections.new(name)
        parent.children.link(found)
    return found
