"""Runs inside Blender's window: proposals, partners, advice, transfer, by the buttons' operators.

Arguments: the folder with the small scene (scan.ply, photos/, masks/).
"""

import json
from pathlib import Path

import bpy
import driving as d
import numpy as np

FOLDER = Path(ui.args[0])  # noqa: F821 - the runner gives `ui`
PANELS = ("red panel", "green panel", "blue tile")


def advice():
    return bpy.context.window_manager.fresco_advice


def kinds():
    return [proposal.kind for proposal in d.marking().proposals]


def run(ui, area, operator, **settings):
    with ui.override(area):
        operator("INVOKE_DEFAULT", True, **settings)
    yield from d.finished(ui)


def propose_on_scan(ui, right):
    """Three walls are proposed; nothing is a region before it is accepted."""
    yield from run(ui, right, bpy.ops.fresco.propose_surface)
    ui.log([(p.kind, p.name, p.note) for p in d.marking().proposals])
    assert kinds().count("FACET") == 3, kinds()
    count = len(d.fresco().regions)
    ui.shot("1 facets proposed")
    d.marking().proposal_index = 0
    with ui.override(right):
        bpy.ops.fresco.accept_proposal("EXEC_DEFAULT", True)
    assert len(d.fresco().regions) == count + 1
    assert d.fresco().active_region.face_count == 1152
    yield from d.undo(ui, right)
    assert len(d.fresco().regions) == count and kinds().count("FACET") == 3
    with ui.override(right):
        bpy.ops.fresco.discard_all_proposals("EXEC_DEFAULT", True)
    names = d.fresco().scan.data.attributes.keys()
    assert not kinds() and not [name for name in names if "proposal" in name]


def propose_in_photo(ui, left):
    """The painted panels are among what is proposed; those accepted are marked in the photo only."""
    yield from run(ui, left, bpy.ops.fresco.propose_photo)
    ui.log([(p.name, p.note) for p in d.marking().proposals])
    ui.shot("2 areas proposed")
    outlines, polygon_mask = d.module("bridge.proposals").read_outlines, d.module("tools.photo").polygon_mask
    for name in PANELS:
        truth = d.read_mask(FOLDER / "masks" / "wall 1" / f"{name}.png")
        shares = [
            d.overlap(polygon_mask(outlines(p), 480, 320), truth) if p.kind == "PHOTO" else 0
            for p in d.marking().proposals
        ]
        best = max(range(len(shares)), key=shares.__getitem__)
        ui.log(name, shares[best])
        assert shares[best] > 0.9, (name, shares)
        d.marking().proposal_index = best
        with ui.override(left):
            bpy.ops.fresco.accept_proposal("EXEC_DEFAULT", True)
        d.fresco().active_region.name = f"{name} in the photo"
    with ui.override(left):
        bpy.ops.fresco.discard_all_proposals("EXEC_DEFAULT", True)
    assert len(d.fresco().regions) == 6
    yield 0.2


def find_partners(ui, left):
    """Without a pose pairings are tried; the best is the right one, and it counts when it is accepted."""
    yield from run(ui, left, bpy.ops.fresco.propose_partners)
    ui.log([(p.name, p.note) for p in d.marking().proposals])
    d.marking().proposal_index = 0
    yield 0.5
    ui.shot("3 partners proposed")
    names = {r.uid: r.name for r in d.fresco().regions}
    pairs = json.loads(d.marking().proposals[0].pairs_json)
    assert all(names[a] == f"{names[b]} in the photo" for a, b in pairs), (pairs, names)
    with ui.override(left):
        bpy.ops.fresco.accept_proposal("EXEC_DEFAULT", True)
    assert len(d.fresco().regions) == 6 - len(pairs) < 6


def advise(ui, area):
    """The panel tells what the regions marked so far are worth, after the last change."""
    yield from ui.wait(lambda: not advice().working and "uncertain" in advice().pose, 60, "the advice")
    ui.log(advice().pose)
    assert len(json.loads(advice().regions_json)) == 3
    yield from ui.move(area.x + area.width // 2, area.y + 60)
    yield 0.5
    ui.shot("4 advice")


def forget_partner(photo, name):
    """Turn a region's mark in a photo into a region that is not on the scan."""
    mark = photo.mark(d.fresco().region_named(name).uid)
    with_mark = d.module("bridge.regions").add_region(bpy.context.scene, f"{name} in the photo")
    mark.region_id = with_mark.uid


def solve_and_project(ui, left):
    """With a pose the last partner is proposed by projecting, and the next photo gets its marks."""
    with ui.override(left):
        bpy.ops.fresco.solve_poses(only_active=True)
    photo = d.fresco().photos[0]
    assert photo.state == "SOLVED", photo.message
    forget_partner(photo, "blue tile")
    yield from run(ui, left, bpy.ops.fresco.propose_partners)
    ui.log([(p.name, p.note) for p in d.marking().proposals])
    assert kinds() == ["PARTNERS"], kinds()
    with ui.override(left):
        bpy.ops.fresco.accept_proposal("EXEC_DEFAULT", True)
    assert [region.name for region in d.fresco().regions] == list(PANELS)
    assert len(d.fresco().photos[0].marks) == 3


def transfer(ui, left):
    d.fresco().photo_index = 1
    left.spaces.active.image = d.fresco().photos[1].image
    photo = d.fresco().photos[1]
    pose = d.module("bridge.photos")
    truth = json.loads(ui.args[1])
    pose.write_pose(bpy.context.scene, photo, np.array(truth["rotation"]), np.array(truth["translation"]))
    photo.state = "GIVEN"
    yield from run(ui, left, bpy.ops.fresco.transfer_regions)
    ui.log([(p.name, p.note) for p in d.marking().proposals])
    assert kinds() == ["TRANSFER"] * 3 and len(photo.marks) == 0
    yield 0.5
    ui.shot("5 carried into the next photo")
    with ui.override(left):
        bpy.ops.fresco.accept_all_proposals("EXEC_DEFAULT", True)
    for name in PANELS:
        mask = d.mask_of(d.fresco().region_named(name), d.fresco().photos[1])
        share = d.overlap(mask, d.read_mask(FOLDER / "masks" / "wall 2" / f"{name}.png"))
        ui.log(name, share)
        assert share > 0.95, (name, share)


def steps(ui):
    yield from d.import_scene(FOLDER, ["wall 1", "wall 2"], keep_regions=True)
    for region, name in zip(d.fresco().regions, PANELS, strict=True):
        region.name = name
    d.calibrate()
    bpy.ops.ed.undo_push(message="ready")
    left, right = yield from d.split(ui)
    d.look(right, (6.0, 6.0, 5.0), (0.8, 0.8, 0.8))
    yield from ui.sidebar("Fresco", left)
    with ui.override(left):
        bpy.ops.image.view_all(fit_view=True)
    yield 0.3
    yield from propose_on_scan(ui, right)
    for step in (propose_in_photo, find_partners, advise, solve_and_project, transfer):
        ui.log(step.__name__)
        yield from step(ui, left)
