"""Colours that photos give to the points of a cloud: kept on the scan, layer by layer."""

from __future__ import annotations

import json
from collections.abc import Mapping

import bpy
import numpy as np

from ...core.arrays import ByteArray, Float32Array
from ...core.errors import TextureError
from ...core.project.stages.cloud import ColouredCloud
from ...core.texture.models.colours import Colours, PointSelection
from ...core.texture.views.visibility import project
from . import meshes
from .colours import read_point_colours, read_scan_colours
from .maps import write_vertex_colours
from .photos import read_view
from .texture import LAYERS_KEY, NUMBERS_KEY, PHOTOS_KEY, attribute_name, layer_names

COLOURS = "Fresco photo colour"
"""Colour attribute of the points; a layer's name follows."""
_UNSEEN = 70
"""Grey (sRGB byte) of points that no photo sees, in a scan without colours of its own."""


def colours_name(layer: str) -> str:
    """Name of the colour attribute of a layer."""
    return f"{COLOURS} {layer}" if layer else COLOURS


def show_clouds(scene: bpy.types.Scene, clouds: Mapping[str, ColouredCloud]) -> None:
    """Keep the colours of every layer on the scan, and show the one without a name, or the first."""
    mesh = scene.fresco.scan.data
    _remove_clouds(mesh)
    names = sorted(clouds, key=lambda layer: layer != "")
    for layer in reversed(names):  # the last one that is written is shown
        selection, views = clouds[layer].selection, clouds[layer].views
        write_vertex_colours(mesh, colours_name(layer), selection.colours.rgb)
        meshes.write_element_attribute(mesh, attribute_name("view", layer), selection.view)
        texel = selection.texel_size.astype(np.float32)
        meshes.write_element_attribute(mesh, attribute_name("texel_size", layer), texel)
        mesh[PHOTOS_KEY + layer] = json.dumps([view.name for view in views])
        mesh[NUMBERS_KEY + layer] = json.dumps({"gain": selection.gain.tolist()})
    mesh[LAYERS_KEY] = json.dumps(names)
    show_cloud(scene, names[0])


def show_cloud(scene: bpy.types.Scene, layer: str) -> None:
    """Show the colours of a layer, and tell its numbers."""
    mesh = scene.fresco.scan.data
    mesh.color_attributes.active_color = mesh.color_attributes[colours_name(layer)]
    scene.fresco.layer = layer
    rows = cloud_rows(read_cloud(scene, layer))
    scene.fresco.texture_report = "\n".join("\t".join(row) for row in rows)
    scene.fresco.texture_warnings = ""


def _remove_clouds(mesh: bpy.types.Mesh) -> None:
    for layer in json.loads(mesh.get(LAYERS_KEY, "[]")):
        for name in (colours_name(layer), attribute_name("view", layer), attribute_name("texel_size", layer)):
            meshes.remove_attribute(mesh, name)


def read_clouds(scene: bpy.types.Scene) -> dict[str, ColouredCloud]:
    """Return the coloured points of all layers. Raises TextureError when there are none."""
    names = layer_names(scene.fresco.scan)
    if not names:
        raise TextureError("The points have no colours from photos yet: colour them first (step 6).")
    return {layer: read_cloud(scene, layer) for layer in names}


def read_cloud(scene: bpy.types.Scene, layer: str) -> ColouredCloud:
    """Return the coloured points of a layer as core takes them. Raises TextureError."""
    obj, photos = scene.fresco.scan, scene.fresco.photos
    mesh, points = obj.data, meshes.read_vertices(obj)
    names = json.loads(mesh[PHOTOS_KEY + layer])
    missing = [name for name in names if name not in photos]
    if missing:
        raise TextureError(f"Photo {missing[0]} was removed since the points were coloured: do it again.")
    views = tuple(read_view(scene, photos[name]) for name in names)
    view = meshes.read_element_attribute(mesh, attribute_name("view", layer))
    texel = meshes.read_element_attribute(mesh, attribute_name("texel_size", layer))
    rgb = read_point_colours(mesh, colours_name(layer))
    if view is None or texel is None or rgb is None:
        raise TextureError("The points' colours were removed or changed: colour them again (step 6).")
    gain = np.array(json.loads(mesh[NUMBERS_KEY + layer])["gain"])
    pixel = np.zeros((len(points), 2))
    for number, one in enumerate(views):
        pixel[view == number] = project(one, points[view == number])
    selection = PointSelection(view, pixel, gain, texel.astype(np.float64), Colours(rgb, view >= 0))
    return ColouredCloud(points, selection, views)


def shown_colours(mesh: bpy.types.Mesh) -> tuple[ByteArray | None, Float32Array | None]:
    """Colours (V,3) sRGB that a cloud is shown with, and intensity (V,); None where it has none.

    Points that no photo sees have the scan's own colour, or a dark grey.
    """
    own, intensity = read_scan_colours(mesh)
    active = mesh.color_attributes.active_color
    if active is None or not active.name.startswith(COLOURS):
        return own, intensity
    shown = read_point_colours(mesh, active.name)
    view = meshes.read_element_attribute(mesh, attribute_name("view", active.name[len(COLOURS) :].strip()))
    if shown is not None and view is not None:
        shown[view < 0] = _UNSEEN if own is None else own[view < 0]
    return shown, intensity


def cloud_rows(cloud: ColouredCloud) -> list[tuple[str, str]]:
    """Numbers of coloured points for the panel: names and values."""
    seen = cloud.selection.view >= 0
    rows = [
        ("Coloured", f"{100 * cloud.coverage:.1f} % of the points"),
        ("Photos", f"{len(np.unique(cloud.selection.view[seen]))} in use"),
        ("Points", f"{np.count_nonzero(seen):,} of {len(seen):,}"),
    ]
    if seen.any():
        rows.append(("Pixel", f"{1000 * float(np.nanmedian(cloud.selection.texel_size)):.2f} mm (median)"))
    return rows
