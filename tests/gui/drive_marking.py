"""Runs inside Blender's window: keys, dragging, adding and taking away, hidden parts, mending, bad clicks.

Arguments: the folder with the small scene (scan.ply, photos/, masks/).
"""

from pathlib import Path

import bpy
import driving as d

FOLDER = Path(ui.args[0])  # noqa: F821 - the runner gives `ui`


def truth(name):
    return d.read_mask(FOLDER / "masks" / "wall 1" / f"{name}.png")


def wand_by_mouse_and_keys(ui, area):
    """Dragging and plus, minus choose another size; Esc leaves everything; one undo step per click."""
    red = truth("red panel")
    place = ui.to_region(area, *d.middle(red))
    yield from d.use_tool(ui, area, "fresco.tool_photo_wand")
    yield from d.hold(ui, [place, (place[0] + 45, place[1])])
    yield from ui.wait(lambda: preview_steps() is not None, 30, "the wand's preview")
    yield from ui.move(place[0] + 46, place[1])
    assert preview_steps() == 3, preview_steps()
    ui.shot("1 wand dragged")
    yield from ui.key("ESC")
    yield from d.release(ui)
    assert len(d.fresco().regions) == 0

    yield from ui.click(*place)
    yield from ui.wait(lambda: len(d.fresco().regions) == 1, 30, "the wand")
    first = d.mask_of(d.fresco().regions[0])
    yield from ui.key("NUMPAD_PLUS")
    yield from ui.wait(lambda: d.marking().wand_steps == 1, 20, "the larger size")
    larger = d.mask_of(d.fresco().regions[0])
    assert larger.sum() > first.sum(), (first.sum(), larger.sum())
    yield from ui.key("MINUS")
    yield from ui.wait(lambda: d.marking().wand_steps == 0, 20, "the size before")
    assert d.mask_of(d.fresco().regions[0]).sum() == first.sum()
    for _ in range(2):
        yield from d.undo(ui, area)
    assert d.mask_of(d.fresco().regions[0]).sum() == first.sum()
    yield from d.undo(ui, area)
    assert len(d.fresco().regions) == 0
    with ui.override(area):
        bpy.ops.ed.redo()
    yield 0.4
    assert d.overlap(d.mask_of(d.fresco().regions[0]), red) > 0.9


def preview_steps():
    """Steps that the running wand stands at, by what it draws; None before it has begun."""
    running = [op for op in bpy.context.window.modal_operators if op.bl_idname == "FRESCO_OT_photo_wand"]
    return getattr(running[0], "steps", None) if running else None


def add_and_take_away(ui, area):
    """Shift adds what another click finds, Ctrl takes it away again."""
    green = truth("green panel")
    place = ui.to_region(area, *d.middle(green))
    before = d.mask_of(d.fresco().regions[0])
    yield from ui.click(*place, shift=True)
    yield from ui.wait(lambda: d.mask_of(d.fresco().regions[0]).sum() > before.sum(), 30, "the addition")
    both = d.mask_of(d.fresco().regions[0])
    assert d.overlap(both & ~before, green) > 0.9
    ui.shot("2 shift adds")
    yield from ui.click(*place, ctrl=True)
    yield from ui.wait(lambda: d.mask_of(d.fresco().regions[0]).sum() < both.sum(), 30, "the subtraction")
    assert d.overlap(d.mask_of(d.fresco().regions[0]), before) > 0.98
    assert len(d.fresco().regions) == 1


def grab_cut_and_snap(ui, area):
    green, blue = truth("green panel"), truth("blue tile")
    yield from d.use_tool(ui, area, "fresco.tool_photo_grabcut")
    yield from d.stroke(ui, d.in_photo(ui, area, d.box_of(green, 9), green.shape))
    yield from ui.wait(lambda: len(d.fresco().regions) == 2, 30, "GrabCut")
    share = d.overlap(d.mask_of(d.fresco().regions[1]), green)
    ui.log("GrabCut overlap", share)
    assert share > 0.93, share

    yield from d.use_tool(ui, area, "fresco.tool_photo_lasso")
    d.marking().snap = True
    v, u = blue.nonzero()
    corners = [(u[v.argmin()], v.min() - 5), (u.max() + 6, v[u.argmax()]), (u[v.argmax()], v.max() + 5),
               (u.min() - 6, v[u.argmin()])]  # fmt: skip
    drawn = d.overlap(d.module("tools.photo").polygon_mask([corners], 480, 320), blue)
    yield from d.stroke(ui, d.in_photo(ui, area, d.between(corners, 5), blue.shape))
    yield from ui.wait(lambda: len(d.fresco().regions) == 3, 30, "the lasso")
    share = d.overlap(d.mask_of(d.fresco().regions[2]), blue)
    ui.log("overlap of the lasso as drawn", drawn, "and snapped", share)
    assert share > max(0.88, drawn + 0.03), (drawn, share)
    d.marking().snap = False
    ui.shot("3 GrabCut and snapped lasso")


def hidden_part(ui, area):
    """What stands before a region is painted over it, drawn hatched, and kept with the mark."""
    blue = truth("blue tile")
    yield from d.use_tool(ui, area, "fresco.tool_photo_brush")
    d.marking().part, d.marking().radius = "HIDDEN", 22
    before = d.mask_of(d.fresco().regions[2])
    (place,) = d.in_photo(ui, area, [d.box_of(blue)[0]], blue.shape)
    yield from d.stroke(ui, [(place[0] + 10, place[1] - 40), (place[0] + 60, place[1] - 20)])
    region, photo = d.fresco().regions[2], d.fresco().photos[0]
    assert photo.mark(region.uid).hidden is not None, d.told()
    assert (d.mask_of(region) == before).all()
    ui.shot("4 hidden part")
    with ui.override(area):
        bpy.ops.fresco.clear_hidden()
    assert photo.mark(region.uid).hidden is None
    d.marking().part = "REGION"


def mending(ui, area):
    """Grow, shrink, fill and specks, each as the menu runs it."""
    start = d.mask_of(d.fresco().regions[2])
    d.marking().grow = 4
    sizes = []
    for action in ("GROW", "SHRINK", "SMOOTH", "SNAP"):
        with ui.override(area):
            bpy.ops.fresco.tidy_mark("INVOKE_DEFAULT", True, action=action)
        yield from d.finished(ui)
        sizes.append(int(d.mask_of(d.fresco().regions[2]).sum()))
    ui.log("mended", start.sum(), sizes)
    assert sizes[0] > start.sum() > 0.9 * sizes[1] and sizes[1] < sizes[0]
    yield from d.undo(ui, area)
    assert int(d.mask_of(d.fresco().regions[2]).sum()) == sizes[2]


def bad_clicks(ui, area):
    """A click beside the photo, a stroke of three pixels, taking away from nothing: a sentence each."""
    count, region = len(d.fresco().regions), ui.region(area)
    yield from d.use_tool(ui, area, "fresco.tool_photo_wand")
    yield from ui.click(region.x + 120, region.y + 40)
    text = yield from d.sentence(ui)
    assert "outside the photo" in text, text
    yield from off_the_message(ui, area)
    yield from d.use_tool(ui, area, "fresco.tool_photo_lasso")
    (place,) = d.in_photo(ui, area, [(100, 100)], (320, 480))
    yield from d.stroke(ui, [place, (place[0] + 2, place[1]), (place[0] + 2, place[1] + 2)])
    text = yield from d.sentence(ui)
    assert "pixels" in text or "corners" in text, text
    yield from off_the_message(ui, area)
    d.fresco().region_index = count  # none is chosen
    yield from d.use_tool(ui, area, "fresco.tool_photo_brush")
    yield from d.stroke(ui, [place, (place[0] + 30, place[1])], ctrl=True)
    text = yield from d.sentence(ui)
    assert "nothing can be taken away" in text, text
    assert len(d.fresco().regions) == count
    d.fresco().region_index = 0


def brush_radius(ui, area):
    """F and the mouse change the brush's radius."""
    yield from d.use_tool(ui, area, "fresco.tool_photo_brush")
    (place,) = d.in_photo(ui, area, [(240, 160)], (320, 480))
    yield from ui.move(*place)
    before = d.marking().radius
    yield from ui.key("F")
    yield 0.3
    yield from ui.move(place[0] + 40, place[1])
    yield 0.3
    ui.shot("6 brush radius")
    yield from ui.click(place[0] + 40, place[1])
    yield 0.3
    assert abs(d.marking().radius - before - 40) <= 6, (before, d.marking().radius)
    yield from ui.key("F")
    yield from ui.move(place[0] - 40, place[1])
    yield from ui.key("ESC")
    yield 0.3
    assert abs(d.marking().radius - before - 40) <= 6
    d.marking().radius = before


def off_the_message(ui, area):
    """Blender shows an error under the mouse, until the mouse leaves it."""
    for height in (0.5, 0.96):
        yield from ui.move(area.x + 0.8 * area.width, area.y + height * area.height)
        yield 0.3


def wand_on_scan(ui, area):
    """Shift adds a second wall, minus takes a step back, a click beside the scan is a sentence."""
    d.look(area, (6.0, 6.0, 5.0), (0.8, 0.8, 0.8))
    yield 0.5
    yield from d.use_tool(ui, area, "fresco.tool_scan_wand")
    yield from ui.click(*d.on_scan(ui, area, (0.0, 1.2, 1.2)))
    yield from ui.wait(lambda: d.fresco().regions[0].face_count > 0, 60, "the surface wand")
    one = d.fresco().regions[0].face_count
    yield from ui.click(*d.on_scan(ui, area, (1.2, 0.0, 1.2)), shift=True)
    yield from ui.wait(lambda: d.fresco().regions[0].face_count > one, 30, "the addition")
    both = d.fresco().regions[0].face_count
    ui.shot("5 shift adds a wall")
    assert both >= 1.9 * one, (one, both)
    yield from d.undo(ui, area)
    assert d.fresco().regions[0].face_count == one
    region = ui.region(area)
    yield from ui.click(region.x + 200, region.y + 40)
    text = yield from d.sentence(ui)
    assert "not on the scan" in text, text


def mending_faces(ui, area):
    """Grow, shrink, fill a hole that the brush made, as the menu runs it."""
    whole = d.fresco().regions[0].face_count
    yield from d.use_tool(ui, area, "fresco.tool_scan_brush")
    d.marking().radius = 25
    place = d.on_scan(ui, area, (0.0, 1.2, 1.2))
    yield from d.stroke(ui, [place, (place[0] + 4, place[1])], ctrl=True)
    yield from ui.wait(lambda: d.fresco().regions[0].face_count < whole, 20, "the hole")
    for action, fits in (
        ("SHRINK", lambda count: count < whole - 30),
        ("GROW", lambda count: count < whole),
        ("FILL", lambda count: count == whole),
    ):
        with ui.override(area):
            bpy.ops.fresco.tidy_faces("INVOKE_DEFAULT", True, action=action)
        yield from d.finished(ui)
        assert fits(d.fresco().regions[0].face_count), (action, d.fresco().regions[0].face_count, whole)


def loose_triangles(ui, area):
    """A scan whose triangles share no vertices: the wand joins them by their place."""
    scan = d.fresco().scan
    corners = [scan.data.vertices[k].co.copy() for face in scan.data.polygons for k in face.vertices]
    mesh = bpy.data.meshes.new("loose")
    mesh.from_pydata(corners, [], [(k, k + 1, k + 2) for k in range(0, len(corners), 3)])
    loose = bpy.data.objects.new("loose", mesh)
    bpy.context.scene.collection.objects.link(loose)
    scan.hide_set(True)
    d.fresco().scan, count = loose, len(d.fresco().regions)
    d.fresco().region_index = count
    yield 1.0
    yield from d.use_tool(ui, area, "fresco.tool_scan_wand")
    yield from ui.click(*d.on_scan(ui, area, (0.0, 1.2, 1.2)))
    yield from ui.wait(lambda: len(d.fresco().regions) > count, 60, "the wall of loose triangles")
    assert 1000 < d.fresco().regions[count].face_count <= 1152  # the wall, and only it


def steps(ui):
    yield from d.import_scene(FOLDER, ["wall 1"])
    bpy.ops.ed.undo_push(message="ready")
    left, right = yield from d.split(ui)
    for step in (
        wand_by_mouse_and_keys,
        add_and_take_away,
        grab_cut_and_snap,
        hidden_part,
        mending,
        bad_clicks,
        brush_radius,
    ):
        ui.log(step.__name__)
        yield from step(ui, left)
    for step in (wand_on_scan, mending_faces, loose_triangles):
        ui.log(step.__name__)
        yield from step(ui, right)
