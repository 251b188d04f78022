"""A small scene for the add-on's tests; the extension's own modules are reached by name."""

import importlib
import importlib.util
import sys
from pathlib import Path

import pytest

MODULE = "bl_ext.user_default.fresco"


def _load_small_scene():
    spec = importlib.util.spec_from_file_location("small_scene", Path(__file__).with_name("small_scene.py"))
    loaded = importlib.util.module_from_spec(spec)
    sys.modules["small_scene"] = loaded
    spec.loader.exec_module(loaded)
    return loaded


small_scene = _load_small_scene()


@pytest.fixture
def module(extension):
    """Return a function that imports a module of the installed extension: `module("addon.jobs")`."""
    return lambda name: importlib.import_module(f"{MODULE}.{name}")


@pytest.fixture(scope="session")
def room():
    """Return the module that describes the small scene."""
    return small_scene


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """Return a folder with the small scene: scan.ply, photos/, masks/; its name has spaces and accents."""
    from fresco.core.cameras import PerspectiveCamera

    path = tmp_path_factory.mktemp("Kápolna Észak") / "fotók 1"
    camera = PerspectiveCamera(*small_scene.SIZE, small_scene.K, small_scene.DISTORTION)
    small_scene.write_all(path, camera)
    return path


@pytest.fixture
def calibrate(room):
    """Return a function that gives all photos of the scene their true calibration."""
    import bpy

    def run():
        k1, k2, p1, p2 = room.DISTORTION
        bpy.ops.fresco.set_calibration(
            source="PIXELS",
            all_alike=True,
            focal=(room.K[0, 0], room.K[1, 1]),
            principal=(room.K[0, 2], room.K[1, 2]),
            radial=(k1, k2, 0),
            tangential=(p1, p2),
        )

    return run


@pytest.fixture
def imported(scene, folder, calibrate):
    """Return a scene with scan, calibrated photos and marked regions."""
    import bpy

    bpy.ops.fresco.import_scan(filepath=str(folder / "scan.ply"))
    for region, name in zip(scene.fresco.regions, small_scene.PANELS, strict=True):
        region.name = name
    bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))
    calibrate()
    bpy.ops.fresco.import_mask_folder(directory=str(folder / "masks"))
    return scene
