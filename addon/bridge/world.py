"""The scene's own world: Blender keeps single precision, so large coordinates have an offset in double.

True world coordinates (metres, as in the scan's file) = Blender's coordinates + offset.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...core.arrays import FloatArray

OFFSET_KEY = "fresco_offset"
ROOT_COLLECTION = "Fresco"


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
    parent = scene.collection
    for wanted in (ROOT_COLLECTION, name):
        child = _child(parent, wanted)
        if child is None:
            child = bpy.data.collections.new(wanted)
            parent.children.link(child)
        parent = child
    return parent


def find_collection(scene: bpy.types.Scene, name: str) -> bpy.types.Collection | None:
    """Return a collection inside the scene's collection "Fresco", or None; changes nothing."""
    parent = _child(scene.collection, ROOT_COLLECTION)
    return None if parent is None else _child(parent, name)


def _child(parent: bpy.types.Collection, name: str) -> bpy.types.Collection | None:
    """Return the child collection of that name; Blender may have added a number to it."""
    return next((child for child in parent.children if child.name.split(".")[0] == name), None)
