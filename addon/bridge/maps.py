"""Maps as colours of the scan with their legend, and proposed standpoints as cameras."""

from __future__ import annotations

import json

import bpy
import numpy as np

from ...core.cameras import Camera
from ...core.geometry.rigid import rotation_between
from ...core.report.maps import FaceMap
from ...core.texture.coverage import Coverage, Standpoint
from . import cameras
from .world import collection, find_collection

COLOURS = "Fresco map"
"""Colour attribute of the scan that shows a map."""
STANDPOINTS = "Next Photos"
_STEPS = 32
"""Colours of a scale that the legend keeps."""


def write_map(scene: bpy.types.Scene, shown: FaceMap) -> None:
    """Colour the scan's faces by a map, and keep its legend."""
    write_corner_colours(scene.fresco.scan.data, COLOURS, np.repeat(shown.colours, 3, axis=0))
    scene.fresco.maps.legend = json.dumps(legend(shown))


def legend(shown: FaceMap) -> dict[str, object]:
    """Return title, single colours and scale of a map, colours as sRGB from 0 to 1."""
    scale = np.zeros((0, 3)) if shown.scale is None else shown.scale
    if len(scale):
        scale = scale[np.linspace(0, len(scale) - 1, _STEPS).astype(int)]
    return {
        "title": shown.title,
        "entries": [[[part / 255 for part in colour], text] for colour, text in shown.entries],
        "scale": (np.asarray(scale) / 255).tolist(),
        "ends": list(shown.ends),
    }


def read_legend(scene: bpy.types.Scene) -> dict[str, object] | None:
    """Return the legend of the map that is shown."""
    text = scene.fresco.maps.legend
    return json.loads(text) if text else None


def write_corner_colours(mesh: bpy.types.Mesh, name: str, colours: np.ndarray) -> None:
    """Store sRGB colours (C,3) uint8 per face corner and make them the active ones."""
    _write_colours(mesh, name, colours, "CORNER")


def write_vertex_colours(mesh: bpy.types.Mesh, name: str, colours: np.ndarray) -> None:
    """Store sRGB colours (V,3) uint8 per vertex and make them the active ones."""
    _write_colours(mesh, name, colours, "POINT")


def _write_colours(mesh: bpy.types.Mesh, name: str, colours: np.ndarray, domain: str) -> None:
    attribute = mesh.color_attributes.get(name)
    if attribute is not None and (attribute.domain != domain or attribute.data_type != "BYTE_COLOR"):
        mesh.color_attributes.remove(attribute)
        attribute = None
    if attribute is None:
        attribute = mesh.color_attributes.new(name, "BYTE_COLOR", domain)
    values = np.ones((len(colours), 4), dtype=np.float32)
    values[:, :3] = colours / np.float32(255)
    attribute.data.foreach_set("color_srgb", values.ravel())
    mesh.color_attributes.active_color = attribute
    mesh.update()


def coverage_rows(coverage: Coverage, wanted: float) -> list[tuple[str, str]]:
    """Numbers of what the photos cover, for the panel."""
    fine = 100 * coverage.sharp_enough / coverage.total if coverage.total > 0 else 0.0
    return [
        ("Covered", f"{100 * coverage.share:.1f} % of {coverage.total:.1f} m²"),
        ("Fine enough", f"{fine:.1f} % (to {1000 * wanted:.1f} mm)"),
        ("Overlap", f"{coverage.views:.1f} photos see a place"),
    ]


def write_standpoints(context: bpy.types.Context, places: list[Standpoint], camera: Camera) -> None:
    """Make a camera at each proposed place, in a collection of their own; those of before go."""
    old = find_collection(context.scene, STANDPOINTS)
    for obj in list(old.objects) if old is not None else ():
        data = obj.data
        bpy.data.objects.remove(obj)
        if data.users == 0:
            bpy.data.cameras.remove(data)
    size = 0.04 * max(context.scene.fresco.scan.dimensions)
    for number, place in enumerate(places, 1):
        name = f"Next {number} (adds {place.gain:.2f} m²)"
        obj = bpy.data.objects.new(name, bpy.data.cameras.new(name))
        cameras.write_calibration(obj.data, camera)
        obj.data.display_size = size
        obj.show_name = True
        rotation = _looking(place.direction)
        cameras.write_pose(obj, rotation, -rotation @ place.centre)
        obj["fresco_gain"] = float(place.gain)
        collection(context.scene, STANDPOINTS).objects.link(obj)


def _looking(direction: np.ndarray) -> np.ndarray:
    """World-to-camera rotation (3,3) that looks along a direction, upright where that has a meaning."""
    down = np.array([0.0, 0.0, -1.0])
    right = np.cross(down, direction)
    if np.linalg.norm(right) < 1e-3:
        return rotation_between(direction, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(direction, right), direction])
