"""Take the pictures of docs/window.md in a real Blender window, from the finished sample.

The runner of the window tests drives it, after `make demo`:
    RUNNER --zip EXTENSION --out FOLDER --bind DEMO tools/window_pictures.py -- DEMO/chapel.blend
"""

import bpy


def steps(ui):
    bpy.ops.wm.open_mainfile(filepath=ui.args[0], load_ui=False)
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
    ui.shot("overview")
    yield from look_through(ui, fresco, area)
    yield from region(ui, fresco, area)


def look_through(ui, fresco, area):
    fresco.photo_index = 2
    with ui.override():
        bpy.ops.fresco.look_through(index=2)
        bpy.ops.view3d.view_center_camera()
    background = fresco.active_photo.camera.data.background_images[0]
    background.display_depth = "FRONT"
    background.alpha = 0.6
    area.spaces.active.shading.color_type = "OBJECT"
    area.spaces.active.shading.light = "STUDIO"
    yield 1.5
    ui.shot("photo over the scan")


def region(ui, fresco, area):
    area.spaces.active.region_3d.view_perspective = "PERSP"
    with ui.override():
        bpy.context.view_layer.objects.active = fresco.scan
        fresco.region_index = 2
        bpy.ops.fresco.select_region()
    yield 1.5
    ui.shot("region")
