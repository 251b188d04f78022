"""Runs inside Blender's window: goes through the five steps by their buttons, and stops each by ESC first.

Arguments: the folder with the small scene (scan.ply, photos/, masks/), and one to export into.
"""

import sys
from pathlib import Path

import bpy

FOLDER, OUTPUT = (Path(word) for word in ui.args)  # noqa: F821 - the runner gives `ui`
WIDTH = 360


def fresco():
    return bpy.context.scene.fresco


def job():
    return bpy.context.window_manager.fresco_job


def hold(on):
    """Let jobs take two steps and then wait, so that ESC meets them half-way; or let them run."""
    jobs = sys.modules["bl_ext.user_default.fresco.addon.jobs"]
    operator = jobs.JobOperator
    if not hasattr(operator, "advance_freely"):
        operator.advance_freely = operator._advance

    def two_steps(self, context):
        self.steps_taken = getattr(self, "steps_taken", 0) + 1
        return self.advance_freely(context) if self.steps_taken <= 2 else {"RUNNING_MODAL"}

    jobs.SLICE = 0.0 if on else 0.03
    operator._advance = two_steps if on else operator.advance_freely


def widen_sidebar(ui):
    """Drag the sidebar's edge: its texts need room."""
    region = ui.region(ui.area(), "UI")
    y = region.y + region.height // 2
    yield from ui.drag(region.x, y, region.x - max(0, WIDTH - region.width), y)
    yield 0.3


def press(ui, text, at=0.45):
    """Press the button whose operator call contains the text; `at` is where across the sidebar to look."""
    area = ui.area()
    region = ui.region(area, "UI")
    x, y = yield from ui.find(text, at=at)
    for higher in (0, 8, 16, -8):  # on a busy machine the button under the mouse is told late
        yield from ui.move(x, y + higher)
        yield 0.4
        if text in ui.under_mouse(area, region):
            break
    else:
        raise LookupError(f"{text} is not where it was found")
    yield from ui.click(x, y + higher)
    yield 0.3


def file_browser():
    windows = bpy.context.window_manager.windows
    return next(((w, a) for w in windows for a in w.screen.areas if a.type == "FILE_BROWSER"), None)


def choose(ui, text, folder, names=(), at=0.45):
    """Press a button that opens the file browser, choose a folder or a file there, and confirm."""
    yield from press(ui, text, at)
    yield from ui.wait(file_browser, 20, "the file browser")
    yield 1.0
    window, area = file_browser()
    area.spaces.active.params.directory = str(folder).encode()
    yield 1.0
    for name in names[:1]:
        area.spaces.active.params.filename = name
    with bpy.context.temp_override(window=window, area=area, region=ui.region(area)):
        bpy.ops.file.execute("INVOKE_DEFAULT")
    yield 0.1


def stop(ui, name):
    """Stop the running step by ESC."""
    yield from ui.wait(lambda: job().running, 10, f"{name} to run")
    yield 0.4
    ui.shot(f"running {name}")
    area = ui.area()
    yield from ui.move(area.x + area.width // 3, area.y + area.height // 2)
    yield from ui.key("ESC")
    yield from ui.wait(lambda: not job().running, 5, f"{name} to stop")
    assert not job().error, job().error
    ui.log("stopped", name)


def finished(ui, seconds=90):
    """Wait until the running step has ended well."""
    yield 0.3
    yield from ui.wait(lambda: not job().running, seconds, "the step to end")
    yield 0.4
    assert not job().error, job().error


def park_mouse(ui):
    """Take the mouse off the buttons: a tooltip would hide them in the picture."""
    area = ui.area()
    yield from ui.move(area.x + area.width // 4, area.y + area.height // 3)
    yield 0.3


def step_scan(ui):
    hold(True)
    yield from choose(ui, "fresco.import_scan", FOLDER, ["scan.ply"])
    yield from stop(ui, "import scan")
    assert fresco().scan is None and "scan" not in bpy.data.meshes
    hold(False)
    yield from choose(ui, "fresco.import_scan", FOLDER, ["scan.ply"])
    yield from finished(ui)
    assert fresco().scan is not None
    yield from park_mouse(ui)
    ui.shot("2 scan")


def step_photos(ui):
    hold(True)
    yield from choose(ui, "fresco.import_photo_folder", FOLDER / "photos", at=0.87)
    yield from stop(ui, "import photos")
    assert len(fresco().photos) == 0 and not any(obj.type == "CAMERA" for obj in bpy.data.objects)
    hold(False)
    yield from choose(ui, "fresco.import_photo_folder", FOLDER / "photos", at=0.87)
    yield from finished(ui)
    assert len(fresco().photos) == 3
    yield from park_mouse(ui)
    ui.shot("3 photos without calibration")


def step_calibration(ui):
    yield from press(ui, "fresco.set_calibration", at=0.87)
    yield 0.6
    ui.shot("4 calibration dialog")
    yield from ui.key("ESC")
    yield 0.3
    camera = dict(
        source="PIXELS", all_alike=True, focal=(520, 520), principal=(236.5, 163), radial=(-0.12, 0.03, 0),
        tangential=(0.001, -0.0005),
    )  # fmt: skip
    with ui.override():
        bpy.ops.fresco.set_calibration(**camera)
    yield 0.4
    assert all(photo.camera_json for photo in fresco().photos)
    yield from park_mouse(ui)
    ui.shot("5 photos")


def step_regions(ui):
    for region, name in zip(fresco().regions, ["red panel", "green panel", "blue tile"], strict=True):
        region.name = name
    with ui.override():
        bpy.context.view_layer.objects.active = fresco().scan
        fresco().region_index = 2
    yield from press(ui, "fresco.select_region", at=0.87)
    yield 0.5
    assert fresco().scan.mode == "EDIT"
    yield from park_mouse(ui)
    ui.shot("6 region in edit mode")
    yield from press(ui, "fresco.region_from_selection")
    assert len(fresco().regions) == 4
    assert fresco().regions[3].face_count == fresco().regions[2].face_count
    yield from press(ui, "fresco.remove_region", at=0.87)
    assert len(fresco().regions) == 3
    with ui.override():
        bpy.ops.object.mode_set(mode="OBJECT")
    hold(True)
    yield from choose(ui, "fresco.import_mask_folder", FOLDER / "masks", at=0.87)
    yield from stop(ui, "import masks")
    assert sum(len(photo.marks) for photo in fresco().photos) == 0
    hold(False)
    yield from choose(ui, "fresco.import_mask_folder", FOLDER / "masks", at=0.87)
    yield from finished(ui)
    assert [len(photo.marks) for photo in fresco().photos] == [3, 3, 3]
    yield from park_mouse(ui)
    ui.shot("7 regions")


def step_pose(ui):
    hold(True)
    before = fresco().photos[0].camera.matrix_world.copy()
    yield from press(ui, "fresco.solve_poses(only_active=False")
    yield from stop(ui, "solve poses")
    assert fresco().photos[0].camera.matrix_world == before
    assert [photo.state for photo in fresco().photos] == ["UNSOLVED"] * 3
    hold(False)
    yield from press(ui, "fresco.solve_poses(only_active=False")
    yield from finished(ui)
    assert [photo.state for photo in fresco().photos] == ["SOLVED"] * 3
    yield from park_mouse(ui)
    ui.shot("8 poses")
    yield from press(ui, "fresco.look_through", at=0.87)
    yield 0.6
    assert ui.area().spaces.active.region_3d.view_perspective == "CAMERA"
    fresco().active_photo.camera.data.background_images[0].alpha = 0.5
    fresco().active_photo.camera.data.background_images[0].display_depth = "FRONT"
    yield from park_mouse(ui)
    ui.shot("9 look through")
    fresco().active_photo.camera.data.background_images[0].display_depth = "BACK"
    ui.area().spaces.active.region_3d.view_perspective = "PERSP"


def step_texture(ui):
    hold(True)
    yield from press(ui, "fresco.texture_scan")
    yield from stop(ui, "texture")
    assert "Fresco" not in fresco().scan.data.uv_layers
    assert len(fresco().scan.data.materials) == 0
    hold(False)
    yield from press(ui, "fresco.texture_scan")
    yield from finished(ui)
    assert "Fresco" in fresco().scan.data.uv_layers
    assert ui.area().spaces.active.shading.color_type == "TEXTURE"
    yield from park_mouse(ui)
    ui.shot("10 texture")


def step_undo(ui):
    """Undo takes the texture away, redo brings it back."""
    with ui.override():
        bpy.ops.ed.undo()
    yield 0.5
    assert "Fresco" not in fresco().scan.data.uv_layers
    assert [photo.state for photo in fresco().photos] == ["SOLVED"] * 3
    with ui.override():
        bpy.ops.ed.redo()
    yield 0.5
    assert "Fresco" in fresco().scan.data.uv_layers


def step_export(ui):
    fresco().export.folder = str(OUTPUT)
    fresco().export.write_blend = True
    hold(True)
    yield from press(ui, "fresco.export()")
    yield from stop(ui, "export")
    assert not [path for path in OUTPUT.iterdir() if ".part" in path.name]
    hold(False)
    yield from press(ui, "fresco.export()")
    yield from finished(ui)
    written = {path.name for path in OUTPUT.iterdir()}
    assert {"scan.glb", "scan.obj", "scan.mtl", "scan_report.html", "scan.blend"} <= written, written
    yield from park_mouse(ui)
    ui.shot("11 export")


def steps(ui):
    bpy.context.preferences.view.filebrowser_display_type = "SCREEN"
    with ui.override():
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
    yield from ui.sidebar("Fresco")
    yield from widen_sidebar(ui)
    yield from park_mouse(ui)
    ui.shot("1 empty")
    for step in (
        step_scan,
        step_photos,
        step_calibration,
        step_regions,
        step_pose,
        step_texture,
        step_undo,
        step_export,
    ):
        ui.log(step.__name__)
        yield from step(ui)
