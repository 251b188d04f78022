"""Models that are made for delivery, each as an object of its own in the scene."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np

from ...core.arrays import AnyArray, FloatArray, IntArray
from ...core.project import TexturedScan
from ...core.project.stages.colour_chart import ChartResult, ColourChartEntry
from ...core.project.stages.delivery import BakedAtlas, DeliverySettings
from ...core.project.stages.simplified import SimplifiedModel, SimplifySettings
from ...core.settings import AtlasSettings
from ...core.texture.colour.correction import ColourCorrection
from ..settings import from_core, to_core
from . import materials, meshes
from .images import load_image
from .world import collection, find_collection

COLLECTION = "Delivery"
UV_MAP = "Atlas"
SIMPLIFIED_KEY = "fresco_simplified"
"""ID property of a simplified model's object: its numbers in words."""


def delivery_settings(scene: bpy.types.Scene) -> DeliverySettings:
    """Return what the panel asks for."""
    delivery = scene.fresco.delivery
    return DeliverySettings(to_core(scene.fresco.atlas, AtlasSettings), delivery.level, delivery.untouched)


def simplify_settings(scene: bpy.types.Scene) -> SimplifySettings:
    """Return how far the panel asks to simplify."""
    delivery = scene.fresco.delivery
    if delivery.simplify_by == "FACES":
        return SimplifySettings(faces=delivery.simplify_faces)
    return SimplifySettings(tolerance=float(str(np.float32(delivery.simplify_tolerance))))


def show_settings(scene: bpy.types.Scene, atlas: DeliverySettings, simplify: SimplifySettings | None) -> None:
    """Let the panel ask for what a project asks for."""
    delivery = scene.fresco.delivery
    from_core(scene.fresco.atlas, atlas.atlas)
    delivery.level, delivery.untouched = atlas.level, atlas.untouched
    if simplify is None:
        return
    delivery.simplify_by = "TOLERANCE" if simplify.faces is None else "FACES"
    if simplify.faces is not None:
        delivery.simplify_faces = simplify.faces
    if simplify.tolerance is not None:
        delivery.simplify_tolerance = simplify.tolerance


def atlas_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the models of baked atlases."""
    found = find_collection(scene, COLLECTION)
    return [] if found is None else [obj for obj in found.objects if SIMPLIFIED_KEY not in obj]


def show_atlas(context: bpy.types.Context, textured: TexturedScan, baked: BakedAtlas) -> bpy.types.Object:
    """Make the model of a baked atlas."""
    mesh = textured.vertices, textured.faces
    return _show_model(context, baked.path.stem, *mesh, baked.uv, baked.page, baked.atlas.paths)


def show_simplified(context: bpy.types.Context, model: SimplifiedModel) -> bpy.types.Object:
    """Make the object of a simplified model; its numbers stay with it."""
    name, page = model.path.stem, model.page
    obj = _show_model(context, name, model.vertices, model.faces, model.uv, page, model.pages)
    obj[SIMPLIFIED_KEY] = model.told
    return obj


def simplified_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the objects of simplified models."""
    return [obj for obj in scene.objects if SIMPLIFIED_KEY in obj]


def _show_model(
    context: bpy.types.Context,
    name: str,
    vertices: FloatArray,
    faces: IntArray,
    uv: FloatArray,
    page: AnyArray,
    paths: Sequence[Path],
) -> bpy.types.Object:
    """Make a model with one material per page; an earlier one of the same name goes."""
    target = collection(context.scene, COLLECTION)
    old = target.objects.get(name)
    if old is not None:
        mesh = old.data
        bpy.data.objects.remove(old)
        if mesh.users == 0:
            bpy.data.meshes.remove(mesh)
    mesh = meshes.build_mesh(name, vertices, faces)
    meshes.write_uvs(mesh, UV_MAP, uv)
    for path in paths:
        image = load_image(path)
        image.reload()  # a page of an earlier bake may have had this name
        mesh.materials.append(_page_material(path.stem, image))
    meshes.write_material_indices(mesh, np.asarray(page, dtype=np.int32))
    obj = bpy.data.objects.new(name, mesh)
    target.objects.link(obj)
    obj.hide_set(True)  # it lies on the scan
    return obj


def _page_material(name: str, image: bpy.types.Image) -> bpy.types.Material:
    existing = bpy.data.materials.get(name)
    return materials.photo_material(name, image, existing, UV_MAP)


def write_chart(scene: bpy.types.Scene, entry: ColourChartEntry, chart: ChartResult) -> None:
    """Keep the colour chart of a layer with the scene, in place of an earlier one."""
    delivery = scene.fresco.delivery
    fitted = dataclasses.asdict(chart.correction) | {"coefficients": chart.correction.coefficients.tolist()}
    asked = {"path": str(entry.photo), "corners": entry.corners, "method": entry.method}
    kept = json.loads(delivery.charts_json or "{}")
    kept[entry.layer] = asked | {"photo": chart.photo, "told": chart.told, "correction": fitted}
    delivery.charts_json = json.dumps(kept)


def read_charts(scene: bpy.types.Scene) -> dict[str, tuple[ColourChartEntry, ChartResult]]:
    """Return the scene's colour charts by layer."""
    found = {}
    for layer, kept in json.loads(scene.fresco.delivery.charts_json or "{}").items():
        fitted = kept["correction"] | {"coefficients": np.array(kept["correction"]["coefficients"])}
        corners = None if kept["corners"] is None else tuple((u, v) for u, v in kept["corners"])
        entry = ColourChartEntry(Path(kept["path"]), layer, corners, kept["method"])
        found[layer] = entry, ChartResult(kept["photo"], ColourCorrection(**fitted))
    return found
