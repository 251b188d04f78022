"""Runs inside Blender's window: refines a project's poses, stops by ESC, looks at before and after, at maps.

Arguments: a project file, and a folder into which the photo for the Image Editor is not copied but read.
"""

import importlib.util
import sys
from pathlib import Path

import bpy
import numpy as np

PROJECT = Path(ui.args[0])  # noqa: F821 - the runner gives `ui`


def _load(name):
    spec = importlib.util.spec_from_file_location(name, Path(ui.args[1]) / f"{name}.py")  # noqa: F821
    module = importlib.util.module_from_spec(spec)
    module.ui = ui  # noqa: F821
    spec.loader.exec_module(module)
    return module


steps_script = _load("drive_steps")
press, hold, finished, stop = (getattr(steps_script, n) for n in ("press", "hold", "finished", "stop"))
fresco, park_mouse = steps_script.fresco, steps_script.park_mouse
widen_sidebar = steps_script.widen_sidebar


def poses():
    return [photo.pose_json for photo in fresco().photos]


def only_steps(*names):
    """Leave these steps in the sidebar and take the others out, so that their buttons are in sight."""
    panels = [cls for base in bpy.types.Panel.__subclasses__() for cls in (base, *base.__subclasses__())]
    ours = {cls for cls in panels if cls.__name__.startswith("FRESCO_PT_") and cls.is_registered}
    kept = {f"FRESCO_PT_{name}" for name in names}
    in_view = [cls for cls in ours if cls.bl_space_type == "VIEW_3D"]
    for cls in sorted(in_view, key=lambda cls: not getattr(cls, "bl_parent_id", "")):  # children first
        if not kept & {cls.__name__, getattr(cls, "bl_parent_id", "")}:
            bpy.utils.unregister_class(cls)


def open_project(ui):
    with ui.override():
        bpy.ops.fresco.open_project(filepath=str(PROJECT))
    assert len(fresco().photos) > 1
    with ui.override():
        bpy.ops.fresco.solve_poses()
    assert all(photo.is_posed for photo in fresco().photos), [p.message for p in fresco().photos]
    yield 0.5


def refine_edges(ui):
    """One photo, then all; ESC leaves the poses where they were."""
    before = poses()
    hold(True)
    yield from press(ui, "fresco.refine_edges(only_active=False")
    yield from stop(ui, "refine by edges")
    assert poses() == before
    hold(False)
    yield from press(ui, "fresco.refine_edges(only_active=True", at=0.87)
    yield 0.3
    yield from ui.wait(lambda: not steps_script.job().running, 90, "the step to end")
    assert fresco().active_photo.refined == 1
    assert [p.refined for p in fresco().photos].count(1) == 1
    yield from park_mouse(ui)
    ui.shot("20 one refined by edges")


def refine_together(ui):
    before = poses()
    hold(True)
    yield from press(ui, "fresco.refine_jointly")
    yield from stop(ui, "refine together")
    assert poses() == before
    hold(False)
    yield from press(ui, "fresco.refine_jointly")
    yield from finished(ui, 400)
    assert any(photo.joint_shift > 0 for photo in fresco().photos)
    yield from park_mouse(ui)
    ui.shot("21 refined together")


def compare(ui):
    """The edges over the photo in both editors; the slider moves them."""
    area = ui.area()
    with ui.override():
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.4)
    yield 0.5
    views = [a for a in bpy.context.window.screen.areas if a.type == "VIEW_3D"]
    left = min(views, key=lambda a: a.x)
    left.type = "IMAGE_EDITOR"
    left.spaces.active.image = fresco().active_photo.image
    yield 1.0
    area = ui.area()
    yield from widen_sidebar(ui)
    yield from press(ui, "fresco.show_residuals")
    yield from finished(ui, 120)
    with bpy.context.temp_override(area=left, region=next(r for r in left.regions if r.type == "WINDOW")):
        bpy.ops.image.view_all(fit_view=True)
    yield 1.0
    assert area.spaces.active.region_3d.view_perspective == "CAMERA"
    background = fresco().active_photo.camera.data.background_images[0]
    background.display_depth, background.alpha = "FRONT", 0.7
    for share in (0.0, 1.0):
        fresco().compare.blend = share
        yield from park_mouse(ui)
        yield 1.0
        ui.shot(f"22 edges at {share:.0f}")
    module = sys.modules["bl_ext.user_default.fresco.addon.overlays.residuals"]
    found = module.edges_of(fresco().active_photo)
    assert found is not None
    start, end = (pose[1] for pose in found.poses)
    assert np.abs(np.subtract(start, end)).max() > 0
    assert found.residuals[1].median <= found.residuals[0].median + 0.5


def restore(ui):
    photo = fresco().active_photo
    after, count = photo.pose_json, photo.refined
    yield from press(ui, "fresco.restore_pose")
    yield 0.3
    assert photo.refined == count - 1 and photo.pose_json != after
    with ui.override():
        bpy.ops.ed.undo()
    yield 0.5
    assert fresco().active_photo.pose_json == after, "undo brings the refined pose back"


def maps(ui):
    """Texture, a map with its legend, places for the next photos."""
    with ui.override():
        bpy.ops.fresco.texture_scan()
    view = ui.area().spaces.active
    view.region_3d.view_perspective = "PERSP"
    with ui.override():
        bpy.ops.view3d.view_all(center=False)
    fresco().maps.wanted_texel = 0.004
    for field in ("texel_size", "view"):
        with ui.override():
            assert bpy.ops.fresco.show_map(field=field) == {"FINISHED"}
        assert view.shading.color_type == "VERTEX"
        yield from park_mouse(ui)
        yield 0.5
        ui.shot(f"23 map {field}")
    with ui.override():
        assert bpy.ops.fresco.next_standpoints() == {"FINISHED"}
    assert [obj for obj in bpy.data.objects if obj.name.startswith("Next 1 (adds")]
    yield from park_mouse(ui)
    yield 0.5
    ui.shot("24 next photos")


def steps(ui):
    with ui.override():
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
    yield from ui.sidebar("Fresco")
    yield from widen_sidebar(ui)
    yield from open_project(ui)
    only_steps("refine")
    yield 0.5
    for step in (refine_edges, refine_together, compare, restore, maps):
        ui.log(step.__name__)
        yield from step(ui)
