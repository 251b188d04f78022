"""Runs inside Blender's window: regions on a scan of points by mouse, the pose they give, coloured points.

Arguments: the folder with the small scene (cloud.ply, photos/, masks/).
"""

from pathlib import Path

import bpy
import driving as d
import numpy as np

FOLDER = Path(ui.args[0])  # noqa: F821 - the runner gives `ui`
PANELS = {
    "red panel": (0, (0.5, 0.5), (1.7, 1.5)),
    "green panel": (1, (0.6, 0.7), (1.6, 1.9)),
    "blue tile": (2, (0.9, 0.8), (1.7, 1.5)),
}
EYE = (6.0, 5.2, 3.6)
SEEN = {"red panel": (0.0, 1.1, 1.0), "green panel": (1.1, 0.0, 1.3), "blue tile": (1.3, 1.15, 0.0)}


def regions_by_wand(ui, photo, scan):
    """One click in the photo and one on the points for each panel, as on a mesh."""
    for number, (name, place) in enumerate(SEEN.items(), 1):
        mask = d.read_mask(FOLDER / "masks" / "wall 1" / f"{name}.png")
        yield from d.use_tool(ui, photo, "fresco.tool_photo_wand")
        yield from ui.click(*ui.to_region(photo, *d.middle(mask)))
        yield from ui.wait(lambda n=number: len(d.fresco().regions) == n, 60, name)
        d.fresco().active_region.name = name
        yield from d.use_tool(ui, scan, "fresco.tool_scan_wand")
        yield from ui.click(*d.on_scan(ui, scan, place))
        yield from ui.wait(lambda: d.fresco().active_region.face_count > 0, 60, f"{name} on the points")
        yield 0.5
    ui.log("points", [region.face_count for region in d.fresco().regions])
    yield 1.0
    ui.shot("2 regions of points")
    for region, size in zip(d.fresco().regions, (1.2, 1.2, 0.56), strict=True):
        found = region.face_count * 0.01**2
        assert 0.8 * size < found < 1.03 * size, (region.name, found, size)


def lasso_and_brush(ui, scan):
    """The lasso takes the points that are seen inside it, the brush takes some away again."""
    d.fresco().region_index = len(d.fresco().regions)
    yield from d.use_tool(ui, scan, "fresco.tool_scan_lasso")
    corners = [d.on_scan(ui, scan, p) for p in ((1.9, 0, 1.9), (2.3, 0, 1.9), (2.3, 0, 2.3), (1.9, 0, 2.3))]
    yield from d.stroke(ui, d.between(corners, 6))
    yield from ui.wait(lambda: len(d.fresco().regions) == 4, 30, "the lasso")
    count = d.fresco().regions[3].face_count
    assert abs(count - 1600) < 160, count
    yield from d.use_tool(ui, scan, "fresco.tool_scan_brush")
    d.marking().radius = 20
    x, y = d.on_scan(ui, scan, (2.1, 0, 2.1))
    yield from d.stroke(ui, [(x, y), (x + 5, y)], ctrl=True)
    yield from ui.wait(lambda: d.fresco().regions[3].face_count < count, 30, "the brush")
    ui.shot("3 lasso and brush")
    bpy.ops.fresco.remove_region()
    yield 0.5


def clicks_beside(ui, scan):
    """A click beside the points is a sentence, and nothing changes."""
    region, count = ui.region(scan), len(d.fresco().regions)
    yield from d.use_tool(ui, scan, "fresco.tool_scan_wand")
    yield from ui.click(region.x + 200, region.y + 60)
    text = yield from d.sentence(ui)
    assert "not on the scan" in text and len(d.fresco().regions) == count, text


def colours(ui, scan):
    """Solve by the panels' own points, and colour the points by the buttons of steps 4 and 6."""
    positions = d.module("bridge.meshes").read_positions(d.fresco().scan.data)
    for name, (axis, *ends) in PANELS.items():
        others = np.delete(positions, axis, axis=1)
        inside = np.all((others > ends[0]) & (others < ends[1]), axis=1) & (abs(positions[:, axis]) < 0.01)
        d.module("bridge.regions").write_faces(bpy.context.scene, d.fresco().region_named(name), inside)
    bpy.ops.fresco.import_mask_folder(directory=str(FOLDER / "masks"))
    with ui.override(scan):
        bpy.ops.fresco.solve_poses("INVOKE_DEFAULT")
    yield from d.finished(ui, 120)
    assert d.fresco().photos[0].state == "SOLVED", d.fresco().photos[0].message
    with ui.override(scan):
        bpy.ops.fresco.texture_scan("INVOKE_DEFAULT")
    yield from d.finished(ui, 120)
    yield 2.0
    ui.shot("4 coloured points")
    assert "of the points" in d.fresco().texture_report


def steps(ui):
    yield from d.import_scene(FOLDER, ["wall 1", "wall 2", "wall 3"], scan="cloud.ply")
    d.calibrate()
    photo, scan = yield from d.split(ui, sidebar=True, factor=0.4)
    d.look(scan, EYE, (0.9, 0.9, 0.8))
    yield 3.0
    ui.shot("1 cloud")
    yield from regions_by_wand(ui, photo, scan)
    yield from lasso_and_brush(ui, scan)
    yield from clicks_beside(ui, scan)
    yield from colours(ui, scan)
