"""A baked atlas as a model of its own in the scene."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.project import TexturedScan
from ...core.project.delivery import BakedAtlas
from . import materials, meshes
from .images import load_image
from .world import collection

COLLECTION = "Delivery"
UV_MAP = "Atlas"


def show_atlas(context: bpy.types.Context, textured: TexturedScan, baked: BakedAtlas) -> bpy.types.Object:
    """Make the model with one material per page; that of an earlier bake of the same name goes."""
    name = baked.path.stem
    target = collection(context.scene, COLLECTION)
    old = target.objects.get(name)
    if old is not None:
        mesh = old.data
        bpy.data.objects.remove(old)
        if mesh.users == 0:
            bpy.data.meshes.remove(mesh)
    mesh = meshes.build_mesh(name, textured.vertices, textured.faces)
    meshes.write_uvs(mesh, UV_MAP, baked.uv)
    for path in baked.atlas.paths:
        image = load_image(path)
        image.reload()  # a page of an earlier bake may have had this name
        mesh.materials.append(_page_material(path.stem, image))
    meshes.write_material_indices(mesh, np.asarray(baked.page, dtype=np.int32))
    obj = bpy.data.objects.new(name, mesh)
    target.objects.link(obj)
    obj.hide_set(True)  # it lies on the scan
    return obj


def _page_material(name: str, image: bpy.types.Image) -> bpy.types.Material:
    existing = bpy.data.materials.get(name)
    return materials.photo_material(name, image, existing, UV_MAP)
