"""Partners by what is known of a photo's pose: satellites, a neighbour, the first solved region."""

import importlib.util
import json
import math
from pathlib import Path

import bpy
import cv2
import numpy as np
import pytest

ORIGIN = (686100.0, 5330440.0, 520.0)
"""Where the corner of the room lies: UTM zone 32, metres."""
_spec = importlib.util.spec_from_file_location(
    "exif_files", Path(__file__).parents[1] / "core" / "photos" / "exif_files.py"
)
exif_files = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(exif_files)


@pytest.fixture(scope="module")
def town(tmp_path_factory, room):
    """Return a folder with the small scene in the map projection; its photos tell position and direction."""
    from fresco.core.cameras import PerspectiveCamera

    folder = tmp_path_factory.mktemp("town")
    room.write_all(folder, PerspectiveCamera(*room.SIZE, room.K, room.DISTORTION), ORIGIN)
    rng = np.random.default_rng(2)
    for number, (rotation, translation) in enumerate(room.POSES, 1):
        path = folder / "photos" / f"wall {number}.png"
        east, north, height = -rotation.T @ translation + ORIGIN + rng.normal(0, [0.7, 0.7, 1.5])
        latitude, longitude = exif_files.place_of(32, east, north)
        heading = math.degrees(math.atan2(*rotation[2, :2])) + 1.86 + 6 * rng.normal()
        gps = exif_files.position_tags(latitude, longitude, height, heading % 360, error=1.0)
        data = cv2.imencode(".jpg", cv2.imread(str(path)), [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
        path.with_suffix(".jpg").write_bytes(exif_files.with_exif(data, gps=gps))
        path.unlink()
    return folder


@pytest.fixture
def placed(scene, town, calibrate, room):
    """Return the town's scene: scan, calibrated photos, marks, nothing solved."""
    bpy.ops.fresco.import_scan(filepath=str(town / "scan.ply"))
    for region, name in zip(scene.fresco.regions, room.PANELS, strict=True):
        region.name = name
    bpy.ops.fresco.import_photo_folder(directory=str(town / "photos"))
    calibrate()
    bpy.ops.fresco.import_mask_folder(directory=str(town / "masks"))
    scene.fresco.photo_index = 0
    return scene


def unmark(scene, photo, regions):
    """Turn regions' marks in a photo into regions of their own; -> number of each -> name of its partner."""
    partners = {}
    for number, name in enumerate(regions):
        mark = photo.mark(scene.fresco.region_named(name).uid)
        item = scene.fresco.regions.add()
        item.name, item.uid = f"patch {number}", 2000 + number
        mark.region_id = item.uid
        partners[item.uid] = name
    return partners


def proposed(scene):
    """Proposed pairs as number of the photo's region -> name of the scan's, over all proposals."""
    names = {region.uid: region.name for region in scene.fresco.regions}
    pairs = [json.loads(p.pairs_json) for p in scene.fresco_marking.proposals]
    return {first: names[second] for group in pairs for first, second in group}


def test_the_scan_s_projection_gives_partners(placed, room):
    photo = placed.fresco.photos[0]
    assert photo.place_told == "Tells its place, ± 1 m, direction ± 12°"
    placed.fresco.scan_settings.epsg = 25832
    partners = unmark(placed, photo, room.PANELS)
    bpy.ops.fresco.propose_partners(guide="POSITION")
    assert proposed(placed) == partners
    assert all("overlap" in p.note and p.pose_json for p in placed.fresco_marking.proposals)
    assert photo.state == "UNSOLVED"  # nothing is taken without asking


def test_solved_photos_show_how_positions_lie_in_a_scan_of_unknown_projection(placed, room):
    photo = placed.fresco.photos[0]
    partners = unmark(placed, photo, room.PANELS)
    bpy.ops.fresco.solve_poses()
    assert [p.is_posed for p in placed.fresco.photos] == [False, True, True]
    bpy.ops.fresco.propose_partners()
    assert proposed(placed) == partners


def test_without_either_all_pairs_are_tried_and_it_is_said_why(placed, module):
    photo = placed.fresco.photos[0]
    partners = unmark(placed, photo, ["red panel", "green panel"])
    with pytest.raises(RuntimeError, match="give the EPSG code"):
        bpy.ops.fresco.propose_partners(guide="POSITION")
    bpy.ops.fresco.propose_partners()
    first = json.loads(placed.fresco_marking.proposals[0].pairs_json)
    names = {region.uid: region.name for region in placed.fresco.regions}
    assert {a: names[b] for a, b in first} == partners
    assert "EPSG" in module("addon.jobs").state(bpy.context).error


def test_a_solved_neighbour_gives_partners(imported, room):
    photo = imported.fresco.photos[0]
    imported.fresco.photo_index = 0
    partners = unmark(imported, photo, room.PANELS)
    with pytest.raises(RuntimeError, match="No other photo is solved"):
        bpy.ops.fresco.propose_partners(guide="NEIGHBOUR")
    bpy.ops.fresco.solve_poses()
    bpy.ops.fresco.propose_partners(guide="NEIGHBOUR")
    assert proposed(imported) == partners
    with pytest.raises(RuntimeError, match="does not tell where it was taken"):
        bpy.ops.fresco.propose_partners(guide="POSITION")


def test_the_first_solved_region_gives_the_partners_of_the_others(imported):
    photo = imported.fresco.photos[0]
    imported.fresco.photo_index = 0
    partners = unmark(imported, photo, ["red panel", "blue tile"])
    bpy.ops.fresco.solve_poses(only_active=True)
    assert photo.state in {"SOLVED", "AMBIGUOUS"}
    bpy.ops.fresco.propose_partners()
    assert proposed(imported) == partners
