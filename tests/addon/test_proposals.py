"""Proposed regions, partners and marks: nothing counts before it is accepted."""

import json

import bpy
import numpy as np
import pytest


@pytest.fixture
def proposals(imported):
    """Return the list of proposals of the imported scene."""
    return imported.fresco_marking.proposals


def unmark(scene, photo, name, region):
    """Turn a region's mark in a photo into a region of its own, which has no faces."""
    fresco = scene.fresco
    mark = photo.mark(fresco.region_named(region).uid)
    item = fresco.regions.add()
    item.name, item.uid = name, 1000 + len(fresco.regions)
    mark.region_id = item.uid
    return item.uid


def test_facets_of_the_scan_become_regions_when_accepted(imported, proposals):
    fresco = imported.fresco
    bpy.ops.fresco.propose_surface()
    assert [p.kind for p in proposals] == ["FACET"] * 3  # the walls, of which little is marked
    assert len(fresco.regions) == 3
    attribute = proposals[0].attribute
    assert attribute in fresco.scan.data.attributes
    bpy.ops.fresco.accept_proposal()
    assert len(fresco.regions) == 4 and fresco.active_region.face_count == 1152
    assert attribute not in fresco.scan.data.attributes and len(proposals) == 2
    bpy.ops.fresco.propose_surface()
    assert len(proposals) == 2  # the accepted wall is not proposed again
    bpy.ops.fresco.discard_all_proposals()
    assert not [name for name in fresco.scan.data.attributes.keys() if "proposal" in name]  # noqa: SIM118


def test_an_opening_becomes_a_region_without_faces_that_the_solver_takes(imported, proposals, module):
    fresco = imported.fresco
    scan = fresco.scan
    inside = module("addon.bridge.regions").read_faces(imported, fresco.regions[0])
    bpy.context.view_layer.objects.active = scan
    module("addon.bridge.meshes").select_faces(scan.data, inside)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="FACE")
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.fresco.propose_surface(least_area=0.2)
    openings = [k for k, proposal in enumerate(proposals) if proposal.kind == "OPENING"]
    assert len(openings) == 1
    imported.fresco_marking.proposal_index = openings[0]
    bpy.ops.fresco.accept_proposal()
    region = fresco.active_region
    assert region.face_count == 0 and region.is_on_scan
    surface = module("addon.bridge.regions").surface_source(imported).regions()[region.name]
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(1.2 * 1.0, rel=0.05)
    bpy.ops.fresco.solve_poses()  # the red panel's marks find no faces; the opening has no marks
    assert fresco.region_named(region.name).opening_json


def test_areas_of_a_photo_become_marks_when_accepted(imported, proposals, module, room, folder):
    fresco = imported.fresco
    photo = fresco.photos[0]
    photo.marks.clear()
    bpy.ops.fresco.propose_photo()
    assert len(proposals) >= 3 and len(photo.marks) == 0
    assert len(fresco.regions) == 3
    count = len(proposals)
    bpy.ops.fresco.accept_all_proposals()
    assert len(proposals) == 0 and len(photo.marks) == count and len(fresco.regions) == 3 + count
    assert all(not region.is_on_scan for region in list(fresco.regions)[3:])


def test_partners_without_a_pose_are_tried_and_scored(imported, proposals):
    fresco, photo = imported.fresco, imported.fresco.photos[0]
    uids = {unmark(imported, photo, f"{name} here", name): name for name in ("red panel", "green panel")}
    bpy.ops.fresco.propose_partners()
    assert {p.kind for p in proposals} == {"PARTNERS"}
    best = {uids[a]: b for a, b in json.loads(proposals[0].pairs_json)}
    assert best == {name: fresco.region_named(name).uid for name in ("red panel", "green panel")}
    assert "overlap error" in proposals[0].note and proposals[0].pose_json
    assert all(photo.mark(uid) is not None for uid in uids)  # not accepted yet
    bpy.ops.fresco.accept_proposal()
    assert len(proposals) == 0 and len(fresco.regions) == 3
    assert all(photo.mark(fresco.region_named(name).uid) is not None for name in uids.values())


def test_partners_with_a_pose_are_found_by_projecting(imported, proposals):
    fresco, photo = imported.fresco, imported.fresco.photos[0]
    bpy.ops.fresco.solve_poses(only_active=True)
    assert photo.state == "SOLVED"
    unmark(imported, photo, "tile here", "blue tile")
    bpy.ops.fresco.propose_partners()
    assert [p.name for p in proposals] == ["tile here = blue tile"]
    bpy.ops.fresco.discard_proposal()
    assert fresco.region_named("tile here") is not None and len(proposals) == 0


def test_partners_need_someone_without_partner(imported):
    with pytest.raises(RuntimeError, match="has its partner already"):
        bpy.ops.fresco.propose_partners()


def test_a_solved_photo_gives_its_neighbour_marks(imported, proposals, module, folder):
    fresco = imported.fresco
    bpy.ops.fresco.solve_poses()
    second = fresco.photos[1]
    second.marks.clear()
    bpy.ops.fresco.transfer_regions()
    assert [p.kind for p in proposals] == ["TRANSFER"] * 3 and len(second.marks) == 0
    bpy.ops.fresco.accept_all_proposals()
    images = module("addon.bridge.images")
    for region in fresco.regions:
        found = images.read_mask_pixels(second.mark(region.uid).image)
        truth = images.read_mask_pixels(
            bpy.data.images.load(str(folder / "masks" / second.name / f"{region.name}.png"))
        )
        assert np.count_nonzero(found & truth) / np.count_nonzero(found | truth) > 0.95, region.name


def test_carrying_over_without_a_solved_photo_says_what_to_do(imported):
    assert not bpy.ops.fresco.transfer_regions.poll()


def test_advice_tells_the_uncertainty_of_the_coming_pose(imported, module):
    advice = module("addon.tools.advice")
    drain = module("core.jobs").drain
    told = drain(advice.advice_job(imported))
    assert set(told.qualities) == {"red panel", "green panel", "blue tile"}
    assert "Overlap error" in told.pose and "uncertain" in told.pose
    signature = advice.advice_signature(imported)
    assert signature == advice.advice_signature(imported)
    imported.fresco.photos[0].marks.remove(0)
    assert signature != advice.advice_signature(imported)
    imported.fresco.photos[0].marks.clear()
    assert "in this photo, too" in drain(advice.advice_job(imported)).pose


def test_no_advice_is_worked_out_in_edit_mode(imported, module):
    advice = module("addon.tools.advice")
    bpy.context.view_layer.objects.active = imported.fresco.scan
    bpy.ops.object.mode_set(mode="EDIT")
    assert advice.advice_signature(imported) == ()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert advice.advice_signature(imported) != ()
