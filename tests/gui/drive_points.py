"""Runs inside Blender's window: points picked by mouse, their residuals and ticks, a resized window.

Arguments: the folder with the small scene (scan.ply, control.csv, photos/), and the points' true pixels in
the first photo as JSON.
"""

import json
import subprocess
from pathlib import Path

import bpy
import driving as d
import numpy as np

FOLDER = Path(ui.args[0])  # noqa: F821 - the runner gives `ui`
PIXELS = {name: np.array(pixel) for name, pixel in json.loads(ui.args[1]).items()}  # noqa: F821
SHAPE = (320, 480)
WRONG = "P3"


def pick(ui, photo, scan, name, pixel):
    """Choose a point in the list, ask for its pixel, click in the photo."""
    d.fresco().point_index = d.fresco().points.find(name)
    with ui.override(scan):
        bpy.ops.fresco.pick_in_photo("INVOKE_DEFAULT")
    yield 0.3
    yield from ui.click(*d.in_photo(ui, photo, [pixel], SHAPE)[0])
    yield 0.3


def picked_and_snapped(ui, photo, scan):
    """Every click lands on the corner that is near it, to a part of a pixel; one is 25 pixels wrong."""
    picks = d.fresco().photos[0].picks
    for name, true in PIXELS.items():
        off = np.array([25.0, 9.0]) if name == WRONG else np.array([1.6, -1.2])
        yield from pick(ui, photo, scan, name, true + off)
        yield from ui.wait(lambda n=name: picks.get(n) is not None, 20, name)
    found = {name: np.linalg.norm(np.array(picks[name].pixel) - true) for name, true in PIXELS.items()}
    ui.log("from the true corners", found)
    right = [away for name, away in found.items() if name != WRONG]
    assert np.median(right) < 1.2 and max(right) < 2.5, found  # a pixel of this photo is one of the screen
    ui.shot("1 picked")


def clicks_beside(ui, photo, scan):
    """A click beside the photo picks nothing; Esc neither."""
    region, picks = ui.region(photo), d.fresco().photos[0].picks
    before = tuple(picks["P1"].pixel)
    d.fresco().point_index = 0
    with ui.override(scan):
        bpy.ops.fresco.pick_in_photo("INVOKE_DEFAULT")
    yield 0.3
    yield from ui.click(region.x + 120, region.y + 40)
    yield 0.5
    assert tuple(picks["P1"].pixel) == before
    ui.shot("2 beside the photo")
    for height in (0.5, 0.96):  # Blender shows the sentence under the mouse, until the mouse leaves it
        yield from ui.move(scan.x + 0.4 * scan.width, scan.y + height * scan.height)
        yield 0.3
    with ui.override(scan):
        bpy.ops.fresco.pick_in_photo("INVOKE_DEFAULT")
    yield 0.3
    yield from ui.key("ESC")
    yield from ui.click(*d.in_photo(ui, photo, [(240, 160)], SHAPE)[0])
    assert tuple(picks["P1"].pixel) == before


def only_points():
    """Leave step 4 with its points open, and nothing else, in the sidebar: all of it is then in sight."""
    panels = [cls for cls in bpy.types.Panel.__subclasses__() if cls.__name__.startswith("FRESCO_PT_")]
    panels += [cls for base in bpy.types.Panel.__subclasses__() for cls in base.__subclasses__()]
    ours = {cls for cls in panels if cls.__name__.startswith("FRESCO_PT_") and cls.is_registered}
    in_view = [cls for cls in ours if cls.bl_space_type == "VIEW_3D"]
    for cls in sorted(in_view, key=lambda cls: not getattr(cls, "bl_parent_id", "")):  # children first
        if cls.bl_idname != "FRESCO_PT_pose":
            bpy.utils.unregister_class(cls)
    points = d.module("panels.points").FRESCO_PT_points
    opened = {"bl_idname": "FRESCO_PT_points_open", "bl_options": set()}  # Blender remembers which are closed
    bpy.utils.register_class(type("FRESCO_PT_points_open", (points,), opened))


def untick(ui, scan, pick):
    """Click a point's tick in the list."""
    only_points()
    yield 1.0
    index = [each.name for each in d.fresco().photos[0].picks].index(pick.name)
    place = yield from ui.find(f"picks[{index}].active", scan, at=0.1, step=5)
    ui.log("tick at", place)
    yield from ui.click(*place)
    yield from ui.wait(lambda: not pick.active, 20, "the tick")
    yield 0.5


def residuals_and_ticks(ui, scan):
    """The pose names the wrong point; without its tick it is left out."""
    with ui.override(scan):
        bpy.ops.fresco.pose_from_points("INVOKE_DEFAULT")
    yield from d.finished(ui)
    photo = d.fresco().photos[0]
    assert photo.state == "SOLVED" and WRONG in photo.message, photo.message
    assert [pick.name for pick in photo.picks if not pick.used] == [WRONG]
    assert photo.picks[WRONG].residual > 10 and photo.picks["P2"].residual < 2
    ui.log("residuals", {pick.name: round(pick.residual, 2) for pick in photo.picks})
    ui.shot("3 residuals")
    yield from untick(ui, scan, photo.picks[WRONG])
    with ui.override(scan):
        bpy.ops.fresco.pose_from_points("INVOKE_DEFAULT")
    yield from d.finished(ui)
    assert photo.state == "SOLVED" and WRONG not in photo.message, photo.message
    ui.shot("4 without the wrong one")


def resized(ui, photo, scan):
    """In a window of another size clicks hit what lies under the mouse, and a click on nothing is told."""
    find = ["xdotool", "search", "--onlyvisible", "--class", "blender"]
    for size in ((1240, 900), (1500, 1200)):
        subprocess.run([*find, "windowsize", *map(str, size)], check=True, timeout=20)
        yield from ui.wait(lambda w=size[0]: abs(ui.window.width - w) < 3, 20, "the other size")
        yield 1.0
        with ui.override(photo):
            bpy.ops.image.view_all(fit_view=True)
        yield 0.5
        count = len(d.fresco().regions)
        d.fresco().region_index = count
        yield from d.use_tool(ui, photo, "fresco.tool_photo_wand")
        mask = d.read_mask(FOLDER / "masks" / "wall 1" / "red panel.png")
        yield from ui.click(*ui.to_region(photo, *d.middle(mask)))
        yield from ui.wait(lambda n=count: len(d.fresco().regions) == n + 1, 30, "the wand")
        yield 0.5
        assert d.overlap(d.mask_of(d.fresco().regions[count]), mask) > 0.9
        yield from ui.click(*d.in_photo(ui, photo, [(5, 300)], SHAPE)[0])  # the dark beside the walls
        text = yield from d.sentence(ui)
        assert "goes on outside the photo" in text, text
        assert len(d.fresco().regions) == count + 1
        ui.shot(f"5 window of {size[0]}")
        yield from ui.move(scan.x + 0.4 * scan.width, scan.y + 0.96 * scan.height)
        yield 0.5


def steps(ui):
    yield from d.import_scene(FOLDER, ["wall 1"])
    d.calibrate()
    bpy.ops.fresco.import_points(filepath=str(FOLDER / "control.csv"))
    photo, scan = yield from d.split(ui, sidebar=True, factor=0.4)
    yield from ui.sidebar("Fresco", scan)
    yield 1.0
    yield from picked_and_snapped(ui, photo, scan)
    yield from clicks_beside(ui, photo, scan)
    yield from residuals_and_ticks(ui, scan)
    yield from resized(ui, photo, scan)
