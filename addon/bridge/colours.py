"""Colours that belong to the scan itself, kept on the mesh: refinement and regions use them."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.arrays import AnyArray, ByteArray, Float32Array, FloatArray
from ...core.geometry.meshes import barycentric
from ...core.project import TexturedScan
from ...core.scans import Scan
from .maps import write_vertex_colours

SCAN_COLOURS = "Fresco scan colour"
INTENSITY = "fresco_intensity"


def write_scan_colours(
    mesh: bpy.types.Mesh, colours: ByteArray | None, intensity: Float32Array | None
) -> None:
    """Keep the colours (V,3) sRGB and intensities (V,) that a scan was read with."""
    if colours is not None:
        write_vertex_colours(mesh, SCAN_COLOURS, colours)
    if intensity is not None:
        attribute = mesh.attributes.new(INTENSITY, "FLOAT", "POINT")
        attribute.data.foreach_set("value", np.ascontiguousarray(intensity, dtype=np.float32))


def read_scan_colours(mesh: bpy.types.Mesh) -> tuple[ByteArray | None, Float32Array | None]:
    """Return the scan's own colours (V,3) sRGB and intensities (V,), None where it has none."""
    intensity, values = mesh.attributes.get(INTENSITY), None
    if intensity is not None and intensity.domain == "POINT":
        values = np.empty(len(mesh.vertices), dtype=np.float32)
        intensity.data.foreach_get("value", values)
    return read_point_colours(mesh, SCAN_COLOURS), values


def read_point_colours(mesh: bpy.types.Mesh, name: str) -> ByteArray | None:
    """SRGB colours (V,3) of vertices, None where there is no colour attribute of that name."""
    attribute = mesh.color_attributes.get(name)
    if attribute is None or attribute.domain != "POINT":
        return None
    flat = np.empty(4 * len(mesh.vertices), dtype=np.float32)
    attribute.data.foreach_get("color_srgb", flat)
    return np.rint(255 * flat.reshape(-1, 4)[:, :3]).astype(np.uint8)


def carry_over(mesh: bpy.types.Mesh, scan: Scan, textured: TexturedScan) -> None:
    """Give a mesh whose faces were split the colours of the scan before, blended within each face.

    The scan's vertices come first and keep their values; only faces with new ones are looked at.
    """
    colours, intensity = scan.vertex_colors, scan.intensity
    if colours is None and intensity is None:
        return
    count = len(scan.vertices)
    cut = np.flatnonzero((textured.faces >= count).any(axis=1))
    corner, before = textured.faces[cut], scan.faces[textured.parent[cut]]
    shares = barycentric(textured.vertices[corner], scan.vertices[before][:, None])

    def blended(values: AnyArray) -> FloatArray:
        known = values.reshape(count, -1).astype(np.float64)
        out = np.concatenate([known, np.zeros((len(textured.vertices) - count, known.shape[1]))])
        out[corner.ravel()] = np.einsum("fcb,fbk->fck", shares, known[before]).reshape(-1, known.shape[1])
        out[:count] = known
        return out

    write_scan_colours(
        mesh,
        None if colours is None else np.rint(blended(colours)).astype(np.uint8),
        None if intensity is None else blended(intensity)[:, 0].astype(np.float32),
    )
