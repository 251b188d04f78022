"""What the scripts that mark regions in a real window share: the workspace, tools, strokes, masks."""

import sys

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Matrix, Vector

PACKAGE = "bl_ext.user_default.fresco.addon"


def module(name):
    return sys.modules[f"{PACKAGE}.{name}"]


def fresco():
    return bpy.context.scene.fresco


def marking():
    return bpy.context.scene.fresco_marking


def told():
    """Return the sentence that the panel shows."""
    return bpy.context.window_manager.fresco_job.error


def sentence(ui, seconds=20):
    """Wait for the sentence that tells of an error, and take it away."""
    yield from ui.wait(told, seconds, "the sentence")
    text = told()
    bpy.ops.fresco.dismiss_error()
    return text


def mask_of(region, photo=None):
    photo = photo or fresco().photos[0]
    return module("bridge.images").read_mask_pixels(photo.mark(region.uid).image)


def read_mask(path):
    return module("bridge.images").read_mask_pixels(bpy.data.images.load(str(path)))


def overlap(found, truth):
    return np.count_nonzero(found & truth) / np.count_nonzero(found | truth)


def middle(mask):
    """Centre of a mask as view coordinates 0..1 of the Image Editor."""
    v, u = np.nonzero(mask)
    return view_place(u.mean(), v.mean(), mask.shape)


def view_place(u, v, shape):
    """Pixel as view coordinates 0..1 of the Image Editor."""
    return (u + 0.5) / shape[1], 1 - (v + 0.5) / shape[0]


def box_of(mask, margin=0):
    """Corners (4,2) of the box around a mask, in pixels."""
    v, u = np.nonzero(mask)
    a, b, c, d = u.min() - margin, u.max() + margin, v.min() - margin, v.max() + margin
    return [(a, c), (b, c), (b, d), (a, d)]


def between(corners, count):
    """Places along a closed polygon, `count` on every side."""
    share = np.arange(count)[:, None] / count
    pairs = zip(corners, [*corners[1:], corners[0]], strict=True)
    return np.concatenate([(1 - share) * np.array(a) + share * np.array(b) for a, b in pairs])


def import_scene(folder, photos, keep_regions=False, scan="scan.ply"):
    """Import scan and photos of the small scene, without the regions that its scan brings."""
    bpy.ops.object.select_all(action="SELECT")
    bpy.ops.object.delete()
    bpy.ops.fresco.import_scan(filepath=str(folder / scan))
    bpy.ops.fresco.import_photos(
        directory=str(folder / "photos"), files=[{"name": f"{name}.png"} for name in photos]
    )
    yield 1.0
    while fresco().regions and not keep_regions:
        bpy.ops.fresco.remove_region()


def calibrate():
    bpy.ops.fresco.set_calibration(
        source="PIXELS", all_alike=True, focal=(520, 520), principal=(236.5, 163),
        radial=(-0.12, 0.03, 0), tangential=(0.001, -0.0005),
    )  # fmt: skip


def split(ui, sidebar=False, factor=0.5):
    """Photo left, scan right."""
    with ui.override(ui.area()):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=factor)
    yield 0.4
    areas = sorted((a for a in ui.window.screen.areas if a.type == "VIEW_3D"), key=lambda a: a.x)
    left, right = areas[0], areas[-1]
    left.type = "IMAGE_EDITOR"
    yield 0.4
    left.spaces.active.image = fresco().photos[0].image
    for area in (left, right):
        area.spaces.active.show_region_toolbar = True
    left.spaces.active.show_region_ui = False
    right.spaces.active.show_region_ui = sidebar
    with ui.override(left):
        bpy.ops.image.view_all(fit_view=True)
    yield 0.5
    return left, right


def use_tool(ui, area, name):
    with ui.override(area):
        bpy.ops.wm.tool_set_by_id(name=name)
    yield 0.3


def hold(ui, points, **keys):
    """Press at the first place and move over the others, without letting go."""
    yield from ui.move(*points[0])
    ui._sim(type="LEFTMOUSE", value="PRESS", x=ui.x, y=ui.y, **keys)
    yield 0.3
    for place in points[1:]:
        yield from ui.move(*place)
        yield 0.1


def release(ui, **keys):
    ui._sim(type="LEFTMOUSE", value="RELEASE", x=ui.x, y=ui.y, **keys)
    yield 0.6


def stroke(ui, points, **keys):
    """Press at the first place, move over the others, release at the last."""
    yield from hold(ui, points, **keys)
    yield from release(ui, **keys)


def in_photo(ui, area, pixels, shape):
    """Places in the window of pixels (u, v) of the shown photo."""
    return [ui.to_region(area, *view_place(u, v, shape)) for u, v in pixels]


def look(area, eye, target):
    """Set a 3D view to look from a point at another."""
    view = area.spaces.active.region_3d
    view.view_perspective = "PERSP"
    eye, target = Vector(eye), Vector(target)
    turn = (eye - target).to_track_quat("Z", "Y").to_matrix().to_4x4()
    view.view_matrix = (Matrix.Translation(eye) @ turn).inverted()


def on_scan(ui, area, point):
    """Place in the window of a point of the scan."""
    region = ui.region(area)
    place = location_3d_to_region_2d(region, area.spaces.active.region_3d, Vector(point))
    return region.x + place.x, region.y + place.y


def undo(ui, area):
    with ui.override(area):
        bpy.ops.ed.undo()
    yield 0.4


def finished(ui, seconds=60):
    """Wait until the running step has ended well."""
    yield 0.3
    job = bpy.context.window_manager.fresco_job
    yield from ui.wait(lambda: not job.running, seconds, "the step to end")
    yield 0.3
    assert not job.error, job.error
