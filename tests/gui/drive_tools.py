"""Runs inside Blender's window: marks regions in a photo and on the scan with the tools of both toolbars.

Arguments: the folder with the small scene (scan.ply, photos/, masks/).
"""

import sys
from pathlib import Path

import bpy
import numpy as np

FOLDER = Path(ui.args[0])  # noqa: F821 - the runner gives `ui`


def fresco():
    return bpy.context.scene.fresco


def mask_of(region, photo):
    images = sys.modules["bl_ext.user_default.fresco.addon.bridge.images"]
    return images.read_mask_pixels(photo.mark(region.uid).image)


def overlap(found, truth):
    return np.count_nonzero(found & truth) / np.count_nonzero(found | truth)


def truth(name):
    image = bpy.data.images.load(str(FOLDER / "masks" / "wall 1" / f"{name}.png"))
    images = sys.modules["bl_ext.user_default.fresco.addon.bridge.images"]
    return images.read_mask_pixels(image)


def middle(mask):
    """Centre of a mask as view coordinates 0..1 of the Image Editor."""
    v, u = np.nonzero(mask)
    return (u.mean() + 0.5) / mask.shape[1], 1 - (v.mean() + 0.5) / mask.shape[0]


def use_tool(ui, area, name):
    with ui.override(area):
        bpy.ops.wm.tool_set_by_id(name=name)
    yield 0.3


def split(ui):
    """Photo left, scan right."""
    area = ui.area()
    with ui.override(area):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
    yield 0.4
    areas = sorted((a for a in ui.window.screen.areas if a.type == "VIEW_3D"), key=lambda a: a.x)
    left, right = areas[0], areas[-1]
    left.type = "IMAGE_EDITOR"
    yield 0.4
    left.spaces.active.image = fresco().photos[0].image
    for area in (left, right):
        area.spaces.active.show_region_toolbar = True
    right.spaces.active.show_region_ui = False
    with ui.override(left):
        bpy.ops.image.view_all(fit_view=True)
    yield 0.5
    return left, right


def stroke(ui, points, **keys):
    """Press at the first place, move over the others, release at the last."""
    yield from ui.move(*points[0])
    ui._sim(type="LEFTMOUSE", value="PRESS", x=ui.x, y=ui.y, **keys)
    yield 0.3
    for place in points[1:]:
        yield from ui.move(*place)
        yield 0.1
    ui._sim(type="LEFTMOUSE", value="RELEASE", x=ui.x, y=ui.y, **keys)
    yield 1.0


def photo_tools(ui, area):
    red, green = truth("red panel"), truth("green panel")
    photo = fresco().photos[0]
    yield from use_tool(ui, area, "fresco.tool_photo_wand")
    yield from ui.click(*ui.to_region(area, *middle(red)))
    yield from ui.wait(lambda: len(fresco().regions) == 1, 60, "the wand")
    yield 0.5
    ui.shot("1 photo wand")
    share = overlap(mask_of(fresco().regions[0], photo), red)
    ui.log("wand overlap", share)
    assert share > 0.9, share

    yield from use_tool(ui, area, "fresco.tool_photo_lasso")
    v, u = np.nonzero(green)
    h, w = green.shape
    box = [(u.min(), v.min()), (u.max(), v.min()), (u.max(), v.max()), (u.min(), v.max())]
    corners = [ui.to_region(area, (a + 0.5) / w, 1 - (b + 0.5) / h) for a, b in box]
    yield from stroke(ui, corners)
    yield from ui.wait(lambda: len(fresco().regions) == 2, 30, "the lasso")
    ui.shot("2 photo lasso")
    drawn = mask_of(fresco().regions[1], photo)

    yield from use_tool(ui, area, "fresco.tool_photo_brush")
    bpy.context.scene.fresco_marking.radius = 25
    middle_place = ui.to_region(area, *middle(green))
    yield from stroke(ui, [middle_place, (middle_place[0] + 20, middle_place[1])], ctrl=True)
    painted = mask_of(fresco().regions[1], photo)
    assert painted.sum() < drawn.sum(), (painted.sum(), drawn.sum())
    ui.shot("3 photo brush takes away")

    with ui.override(area):
        bpy.ops.fresco.tidy_mark("EXEC_DEFAULT", True, action="FILL")
    filled = mask_of(fresco().regions[1], fresco().photos[0])
    ui.log("filled", filled.sum(), painted.sum(), drawn.sum(), np.argwhere(filled != drawn)[:5])
    assert np.count_nonzero(filled != drawn) < 5
    with ui.override(area):
        bpy.ops.ed.undo()
    yield 0.5
    photo = fresco().photos[0]
    assert mask_of(fresco().regions[1], photo).sum() == painted.sum()


def photo_corners(ui, area):
    yield from use_tool(ui, area, "fresco.tool_photo_polygon")
    blue = truth("blue tile")
    v, u = np.nonzero(blue)
    triangle = [
        (u[v.argmin()], v.min()),
        (u.max(), v[u.argmax()]),
        (u[v.argmax()], v.max()),
        (u.min(), v[u.argmin()]),
    ]
    for a, b in triangle:
        yield from ui.click(*ui.to_region(area, (a + 0.5) / blue.shape[1], 1 - (b + 0.5) / blue.shape[0]))
    yield from ui.key("RET")
    yield from ui.wait(lambda: len(fresco().regions) == 3, 30, "the polygon")
    ui.shot("4 photo polygon")
    share = overlap(mask_of(fresco().regions[2], fresco().photos[0]), blue)
    ui.log("polygon overlap", share)
    assert share > 0.85, share

    yield from use_tool(ui, area, "fresco.tool_photo_wand")
    count = len(fresco().regions)
    region = ui.region(area)
    yield from ui.click(region.x + 40, region.y + 40)  # beside the photo
    yield 1.0
    assert len(fresco().regions) == count
    ui.shot("5 photo click beside")


def scan_tools(ui, area):
    fresco().region_index = 0
    view = area.spaces.active.region_3d
    from mathutils import Matrix, Vector

    eye = Vector((6.0, 6.0, 5.0))
    view.view_perspective = "PERSP"
    view.view_matrix = (
        Matrix.Translation(eye) @ (eye - Vector((0.8, 0.8, 0.8))).to_track_quat("Z", "Y").to_matrix().to_4x4()
    ).inverted()
    yield 0.6
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    def at(point):
        region = ui.region(area)
        place = location_3d_to_region_2d(region, view, Vector(point))
        return region.x + place.x, region.y + place.y

    yield from use_tool(ui, area, "fresco.tool_scan_wand")
    yield from ui.click(*at((0.0, 1.2, 1.2)))
    yield from ui.wait(lambda: fresco().regions[0].face_count > 0, 60, "the surface wand")
    yield 0.5
    ui.shot("6 surface wand")
    grown = fresco().regions[0].face_count
    ui.log("faces", grown)
    assert 1000 <= grown <= 1250, grown

    yield from use_tool(ui, area, "fresco.tool_scan_brush")
    bpy.context.scene.fresco_marking.radius = 40
    yield from stroke(ui, [at((0.0, 1.2, 1.2)), at((0.0, 1.4, 1.2))], ctrl=True)
    ui.shot("7 surface brush takes away")
    less = fresco().regions[0].face_count
    assert 300 < less < grown - 50, (grown, less)

    fresco().region_index = 1
    yield from use_tool(ui, area, "fresco.tool_scan_lasso")
    yield from stroke(ui, [at((0.6, 0, 0.7)), at((1.6, 0, 0.7)), at((1.6, 0, 1.9)), at((0.6, 0, 1.9))])
    yield from ui.wait(lambda: fresco().regions[1].face_count > 0, 30, "the surface lasso")
    ui.shot("8 surface lasso")
    ui.log("lasso faces", fresco().regions[1].face_count)


def steps(ui):
    bpy.ops.object.select_all(action="SELECT")
    bpy.ops.object.delete()
    bpy.ops.fresco.import_scan(filepath=str(FOLDER / "scan.ply"))
    bpy.ops.fresco.import_photos(
        directory=str(FOLDER / "photos"), files=[{"name": "wall 1.png"}, {"name": "wall 2.png"}]
    )
    yield 1.0
    while fresco().regions:  # those that the scan brings
        bpy.ops.fresco.remove_region()
    bpy.ops.ed.undo_push(message="ready")
    left, right = yield from split(ui)
    ui.shot("0 workspace")
    yield from photo_tools(ui, left)
    yield from photo_corners(ui, left)
    yield from scan_tools(ui, right)
