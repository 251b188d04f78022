"""Registration leaves nothing behind, and can be repeated."""

import bpy
import pytest


def test_register_cycle_is_silent(extension, capfd):
    for _ in range(3):
        extension.unregister()
        extension.register()
    out, err = capfd.readouterr()
    assert out == "" and err == ""


def test_unregister_takes_everything_away(extension):
    extension.unregister()
    try:
        assert not hasattr(bpy.types.Scene, "fresco")
        assert not hasattr(bpy.types.WindowManager, "fresco_job")
        assert not hasattr(bpy.types, "FRESCO_PT_scan")
        assert not [name for name in dir(bpy.types) if name.startswith(("FRESCO_", "Fresco"))]
    finally:
        extension.register()
    assert hasattr(bpy.types, "FRESCO_PT_scan")


def operators():
    return [name for name in dir(bpy.ops.fresco) if not name.startswith("_")]


def test_every_operator_is_described(extension):
    assert len(operators()) > 1
    for name in operators():
        rna = getattr(bpy.ops.fresco, name).get_rna_type()
        assert rna.name, name
        assert len(rna.description) > 20 or name == "dismiss_error", name
        assert not rna.description.endswith("."), f"{name}: Blender adds the full stop"


def test_every_setting_has_its_text(extension, module):
    settings = module("addon.settings")
    for group in settings.CLASSES:
        assert group.__annotations__, group
        for name, prop in group.bl_rna.properties.items():
            assert name == "rna_type" or name == "name" or prop.description, (group, name)


def test_settings_go_to_core_and_back_exactly(scene, module):
    settings, core = module("addon.settings"), module("core.settings")
    assert settings.to_core(scene.fresco.pose, core.PoseSettings) == core.PoseSettings()
    values = core.TextureSettings(max_angle=71.3, uv_tolerance=0.1)
    settings.from_core(scene.fresco.texture, values)
    assert settings.to_core(scene.fresco.texture, core.TextureSettings) == values


@pytest.mark.parametrize("kind", ["FRESCO_PT", "FRESCO_OT", "FRESCO_UL"])
def test_class_names_follow_blenders_rule(extension, kind):
    for name in dir(bpy.types):
        if name.startswith(kind):
            cls = getattr(bpy.types, name)
            assert cls.__name__ == name
