"""The wand's last click: other sizes by keys, made ready in threads and kept."""

import bpy
import numpy as np
import pytest


@pytest.fixture
def clicked(imported, module):
    """Return the scene, its first photo and its click of the wand, which stands at its best level."""
    photo = imported.fresco.photos[0]
    wand_module = module("core.regions.photo.wand")
    wand = wand_module.prepare_wand(module("addon.tools.prepared").read_pixels(photo.path))
    region = imported.fresco.region_named("red panel")
    mask = module("addon.bridge.images").read_mask_pixels(photo.mark(region.uid).image)
    found = wand.click(np.argwhere(mask).mean(axis=0)[::-1])
    levels = module("addon.tools.photo").PhotoClick(wand, found, photo.name, region.uid, "replace", None)
    prepared = module("addon.tools.prepared")
    prepared.STORE.click = prepared.LastClick(levels, "IMAGE_EDITOR")
    imported.fresco_marking.wand_steps = 0
    yield imported, photo, levels
    prepared.STORE.clear()


def marked_pixels(module, photo, levels):
    return int(module("addon.bridge.images").read_mask_pixels(photo.mark(levels.uid).image).sum())


def test_keys_choose_the_next_size_and_back(clicked, module):
    scene, photo, levels = clicked
    room = len(levels.found.levels) - 1 - levels.found.best
    steps = 1 if room > 0 else -1
    bpy.ops.fresco.wand_step(steps=steps)
    first = marked_pixels(module, photo, levels)
    assert first == pytest.approx(levels.found.level(steps).area, rel=0.15)
    assert scene.fresco_marking.wand_steps == steps
    bpy.ops.fresco.wand_step(steps=-steps)
    assert scene.fresco_marking.wand_steps == 0
    assert marked_pixels(module, photo, levels) == pytest.approx(levels.found.level(0).area, rel=0.15)
    work = levels.ready(steps)
    bpy.ops.fresco.wand_step(steps=steps)
    assert levels.ready(steps) is work  # kept, not made again
    assert marked_pixels(module, photo, levels) == first


def test_no_size_beyond_the_last_and_none_of_a_region_that_is_gone(clicked, module):
    scene, photo, levels = clicked
    before = photo.mark(levels.uid).image
    assert bpy.ops.fresco.wand_step(steps=1000) == {"CANCELLED"}
    assert photo.mark(levels.uid).image == before and scene.fresco_marking.wand_steps == 0
    index = [region.uid for region in scene.fresco.regions].index(levels.uid)
    scene.fresco.regions.remove(index)
    assert not bpy.ops.fresco.wand_step.poll()


def test_on_the_scan_a_level_takes_its_faces(imported, module):
    scene, scan = imported, imported.fresco.scan
    meshes, prepared = module("addon.bridge.meshes"), module("addon.tools.prepared")
    index = module("core.regions.surface.index").index_surface(
        meshes.read_vertices(scan), meshes.read_any_faces(scan.data)
    )
    wand = module("core.regions.surface.wand")
    found = wand.grow_surface(index, 300)
    caster = module("core.geometry.rays").RayCaster(
        meshes.read_vertices(scan), meshes.read_any_faces(scan.data)
    )
    ready = prepared.PreparedScan(index, caster, meshes.read_vertices(scan), meshes.read_any_faces(scan.data))
    region = scene.fresco.region_named("red panel")
    levels = module("addon.tools.scan").ScanClick(ready, found, region.uid, "replace", None)
    prepared.STORE.click = prepared.LastClick(levels, "VIEW_3D")
    for k, level in enumerate(found.levels):
        steps = k - found.best
        scene.fresco_marking.wand_steps = 0
        bpy.ops.fresco.wand_step(steps=steps)
        assert region.face_count == len(wand.region_faces(index, found.face, level))
        assert scene.fresco_marking.wand_steps == steps
    prepared.STORE.clear()
