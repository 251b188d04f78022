"""Take the pictures of docs/window.md in a real Blender window, as JPEG in the folder OUT.

The runner of the window tests drives it, after `make demo`:
    RUNNER --zip EXTENSION --out OUT --bind DEMO tools/window_pictures.py -- DEMO/chapel.blend sample
Either word may be `-`: without the first the finished sample is left out, without the second the sequence
from an unposed photo to a pose.
"""

import json
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests" / "gui"))
import driving as d

WIDTH = 1100  # pixels of a picture
SHAPE = (1000, 1500)
LENS = {
    "focal": (1000, 1000),
    "principal": (755.8, 495.4),
    "radial": (-0.118, 0.082, -0.017),
    "tangential": (0.0006, -0.0004),
}
PHOTO = "01_overview.jpg"
CLICKS = {"annunciation": ((1104, 376), -210), "tablet": ((217, 628), 56), "saint": ((443, 480), 0)}
"""Region -> pixel of the photo that is pressed, pixels of the screen that are dragged."""
ON_SCAN = {"annunciation": (3.49, 0.005, 1.72), "tablet": (0.035, -0.57, 1.16), "saint": (0.62, 0.01, 1.84)}
KEYS = 10  # presses of plus or minus within which the outline that fits best is looked for


def picture(ui, name, areas=(), width=WIDTH):
    """Photograph the window, or some of its areas, and keep it small enough for a page."""
    import cv2

    path = Path(ui.shot(name))
    image = cv2.imread(str(path))
    path.unlink()
    if areas:
        height = image.shape[0]
        left, right = min(a.x for a in areas), max(a.x + a.width for a in areas)
        low, high = min(a.y for a in areas), max(a.y + a.height for a in areas)
        image = image[height - high : height - low, left:right]
    size = width, round(image.shape[0] * width / image.shape[1])
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path.with_suffix(".jpg")), small, [cv2.IMWRITE_JPEG_QUALITY, 85])


def steps(ui):
    finished, sample = ui.args
    if sample != "-":
        yield from from_photo_to_pose(ui, Path(sample).resolve())
        yield from cloud(ui, Path(sample).resolve())
    if finished != "-":
        yield from finished_sample(ui, finished)


def finished_sample(ui, path):
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=False)
    yield 2.0
    yield from ui.sidebar("Fresco")
    area = ui.area()
    sidebar = ui.region(area, "UI")
    middle = sidebar.y + sidebar.height // 2
    yield from ui.drag(sidebar.x, middle, sidebar.x - 100, middle)
    fresco = bpy.context.scene.fresco
    with ui.override():
        for chosen in bpy.context.selected_objects:
            chosen.select_set(False)
        fresco.scan.select_set(True)
        bpy.ops.view3d.view_selected()
        bpy.ops.fresco.show_texture()
    yield from ui.move(area.x + 200, area.y + 200)
    yield 1.5
    picture(ui, "window-overview")
    yield from look_through(ui, fresco, area)
    yield from region(ui, fresco, area)


def look_through(ui, fresco, area):
    fresco.photo_index = 2
    with ui.override():
        bpy.ops.fresco.look_through(index=2)
        bpy.ops.view3d.view_center_camera()
    lay_photo_over_scan(fresco.active_photo, area)
    yield 1.5
    picture(ui, "window-photo")


def lay_photo_over_scan(photo, area):
    background = photo.camera.data.background_images[0]
    background.display_depth = "FRONT"
    background.alpha = 0.6
    area.spaces.active.shading.color_type = "OBJECT"
    area.spaces.active.shading.light = "STUDIO"


def region(ui, fresco, area):
    area.spaces.active.region_3d.view_perspective = "PERSP"
    with ui.override():
        bpy.context.view_layer.objects.active = fresco.scan
        fresco.region_index = 2
        bpy.ops.fresco.select_region()
    yield 1.5
    picture(ui, "window-region")


def from_photo_to_pose(ui, sample):
    """Mark three regions in an unposed photo and on the scan by the wands alone; solve, and refine."""
    photo, scan = yield from workspace(ui, sample)
    areas = photo, scan
    picture(ui, "clicks-1", areas)

    for number, (name, (pixel, dragged)) in enumerate(CLICKS.items(), 1):
        yield from by_the_wand(ui, photo, pixel, dragged, areas if number == 1 else ())
        yield from name_region(ui, number, name)
        if number == 1:
            picture(ui, "clicks-3", areas)
        yield from fitted(ui, d.read_mask(sample / "masks" / Path(PHOTO).stem / f"{name}.png"))
        yield from mark_on_scan(ui, scan, name, ON_SCAN[name])
        if number == 1:
            picture(ui, "clicks-4", areas)
    picture(ui, "clicks-5", areas)
    yield from advice(ui, photo)
    picture(ui, "clicks-6", areas)
    yield from press(ui, scan, "fresco.solve_poses")
    tell(ui, sample, "solved")
    picture(ui, "clicks-7", areas)
    if d.fresco().active_photo.state == "AMBIGUOUS":
        yield from press(ui, scan, "fresco.accept_pose")
    yield from press(ui, scan, "fresco.refine_edges")
    position, rotation = tell(ui, sample, "refined")
    assert position < 0.01 and rotation < 0.1, "the pose in the guide is not a good one"
    yield from show_edges(ui, photo, scan)
    picture(ui, "clicks-8", areas)
    yield from through_the_camera(ui, scan)
    picture(ui, "clicks-9", areas)


def cloud(ui, sample):
    """Mark regions on the scan's corners as if it were a cloud."""
    area = next(area for area in ui.window.screen.areas if area.type == "VIEW_3D")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "points.ply"
        corners = d.module("bridge.meshes").read_vertices(d.fresco().scan)
        rows = [" ".join(f"{value:.4f}" for value in corner) for corner in corners]
        head = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
        head += [*(f"property float {axis}" for axis in "xyz"), "end_header"]
        path.write_text("\n".join([*head, *rows, ""]))
        bpy.ops.fresco.import_scan(filepath=str(path))
    while d.fresco().regions:
        bpy.ops.fresco.remove_region()
    d.fresco().scan.select_set(False)
    d.look(area, (3.6, -7.5, 2.8), (2.2, 0.0, 1.6))
    yield 8.0  # until the points are shaded
    for name, place in ON_SCAN.items():
        d.fresco().region_index = len(d.fresco().regions)
        yield from mark_on_scan(ui, area, name, place)
        d.fresco().active_region.name = name
    yield 3.0
    picture(ui, "window-cloud", [area], 640)


def workspace(ui, sample):
    """Photo left, scan right, nothing else."""
    bpy.ops.object.select_all(action="SELECT")
    bpy.ops.object.delete()
    bpy.ops.fresco.import_scan(filepath=str(sample / "scan.ply"))
    bpy.ops.fresco.import_photos(directory=str(sample / "photos"), files=[{"name": PHOTO}])
    bpy.ops.fresco.set_calibration(source="PIXELS", all_alike=True, **LENS)
    yield 1.0
    while d.fresco().regions:
        bpy.ops.fresco.remove_region()
    bpy.context.scene.fresco.scan.select_set(False)
    for kind in ("OUTLINER", "PROPERTIES", "DOPESHEET_EDITOR"):
        area = next(a for a in ui.window.screen.areas if a.type == kind)
        with bpy.context.temp_override(window=ui.window, area=area):
            bpy.ops.screen.area_close()
        yield 0.4
    photo, scan = yield from d.split(ui, factor=0.55)
    d.look(scan, (3.6, -7.5, 2.8), (2.2, 0.0, 1.6))
    scan.spaces.active.overlay.show_floor = scan.spaces.active.overlay.show_axis_x = False
    scan.spaces.active.overlay.show_axis_y = scan.spaces.active.overlay.show_cursor = False
    scan.spaces.active.shading.show_cavity = True
    bpy.ops.ed.undo_push(message="ready")
    yield 1.0
    return photo, scan


def name_region(ui, count, name):
    yield from ui.wait(lambda: len(d.fresco().regions) == count, 60, name)
    d.fresco().active_region.name = name
    yield 0.3


def by_the_wand(ui, photo, pixel, dragged, areas):
    """Press on a pixel of the photo, drag while the outline is previewed, release."""
    yield from d.use_tool(ui, photo, "fresco.tool_photo_wand")
    (place,) = d.in_photo(ui, photo, [pixel], SHAPE)
    yield from d.hold(ui, [place, *((place[0] + dragged * k / 8, place[1]) for k in range(1, 9))])
    yield 8.0 if areas else 2.0  # until the photo is read and the wand has answered
    yield from ui.move(place[0] + dragged, place[1])
    yield 1.0
    if areas:
        picture(ui, "clicks-2", areas)
    yield from d.release(ui)


def fitted(ui, wanted):
    """Press plus and minus as one who looks does, until the outline fits what is `wanted` (H,W) best."""
    best, at = d.overlap(d.mask_of(d.fresco().active_region), wanted), 0
    for key, back, sign in (("NUMPAD_MINUS", "NUMPAD_PLUS", -1), ("NUMPAD_PLUS", "NUMPAD_MINUS", 1)):
        pressed = 0
        while pressed < KEYS and (yield from another_size(ui, key)):
            pressed += 1
            share = d.overlap(d.mask_of(d.fresco().active_region), wanted)
            best, at = max((best, at), (share, sign * pressed))
        for _ in range(pressed):
            yield from another_size(ui, back)
    for _ in range(abs(at)):
        yield from another_size(ui, "NUMPAD_PLUS" if at > 0 else "NUMPAD_MINUS")
    ui.log(d.fresco().active_region.name, "fits by", best, "after pressing", at)


def another_size(ui, key):
    """Press a key that changes the wand's last click; -> whether there was another size."""
    before = d.marking().wand_steps
    yield from ui.key(key)
    for _ in range(20):
        if d.marking().wand_steps != before:
            return True
        yield 0.1
    return False


def mark_on_scan(ui, area, name, place):
    """Click a place of the scan with the wand, and wait for the region."""
    yield from d.use_tool(ui, area, "fresco.tool_scan_wand")
    yield from ui.click(*d.on_scan(ui, area, place))
    yield from ui.wait(on_scan, 120, f"{name} on the scan")
    yield 0.5


def on_scan():
    """Whether the chosen region has faces or points."""
    region = d.fresco().active_region
    return region is not None and region.face_count > 0


def advice(ui, area):
    """Open the sidebar and wait for what it says of the marks."""
    told = bpy.context.window_manager.fresco_advice
    yield from ui.sidebar("Fresco", area)
    yield from ui.wait(lambda: not told.working and told.pose, 120, "the advice")
    ui.log(told.pose)
    yield 0.8


def press(ui, area, button):
    """Press a button of the sidebar, and wait until its step has ended."""
    yield from ui.sidebar("Fresco", area)
    x, y = yield from ui.find(button, area)
    yield from ui.click(x, y)
    yield from d.finished(ui, 240)
    yield from ui.move(area.x + 0.3 * area.width, area.y + 60)
    yield 0.8


def tell(ui, sample, step):
    """Log what is told of the pose and how far it truly lies off; -> these, metres and degrees."""
    photo = d.fresco().active_photo
    truth = json.loads((sample / "truth.json").read_text())[f"photos/{PHOTO}"]
    true_rotation, true_translation = np.array(truth["rotation"]), np.array(truth["translation"])
    rotation, translation, _ = d.module("bridge.photos").read_pose(bpy.context.scene, photo)
    position = float(np.linalg.norm(true_rotation.T @ true_translation - rotation.T @ translation))
    angle = float(np.degrees(np.arccos(np.clip((np.trace(rotation @ true_rotation.T) - 1) / 2, -1, 1))))
    ui.log(step, photo.state, "overlap", photo.overlap, photo.message)
    ui.log("told", photo.centre_sigma, photo.rotation_sigma, "true", position, angle)
    return position, angle


def show_edges(ui, photo, scan):
    """Lay the scan's edges over the photo."""
    with ui.override(scan):
        bpy.ops.fresco.show_residuals("INVOKE_DEFAULT")
    yield from d.finished(ui, 120)
    photo.tag_redraw()
    yield 1.0


def through_the_camera(ui, area):
    """Look at the scan through the solved camera, with the photo laid over it."""
    area.spaces.active.show_region_ui = False
    with ui.override(area):
        bpy.ops.fresco.look_through(index=0)
        bpy.ops.view3d.view_center_camera()
    lay_photo_over_scan(d.fresco().active_photo, area)
    yield 1.5
