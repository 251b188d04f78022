"""Proposals between core and the scene: kept in the list until the user accepts or discards them."""

from __future__ import annotations

import json
import secrets
from collections.abc import Sequence

import bpy
import numpy as np

from ...core.arrays import FloatArray
from ...core.errors import RegionError
from ...core.photos import RegionMark
from ...core.pose import Pose
from ...core.regions.photo.outline import polygon_mask
from ...core.regions.surface.proposals import SurfaceProposal
from ..properties import FrescoPhoto, FrescoRegion
from ..tools.settings import FrescoProposal
from . import meshes, regions


def _add(scene: bpy.types.Scene, kind: str, name: str, note: str) -> FrescoProposal:
    item = scene.fresco_marking.proposals.add()
    item.uid, item.kind, item.name, item.note = secrets.randbits(31), kind, name, note
    return item


def add_surface(scene: bpy.types.Scene, proposal: SurfaceProposal, name: str) -> None:
    """List a facet or an opening of the scan."""
    scan, note = scene.fresco.scan, f"{proposal.area:.2f} m²"
    if len(proposal.faces):
        item = _add(scene, "FACET", name, note)
        inside = np.zeros(len(scan.data.polygons), dtype=np.bool_)
        inside[proposal.faces] = True
        meshes.write_face_attribute(scan.data, item.attribute, inside)
    else:
        _add(scene, "OPENING", name, note).opening_json = regions.opening_to_json(scan, proposal.region)


def add_outlines(
    scene: bpy.types.Scene,
    photo: FrescoPhoto,
    outlines: Sequence[FloatArray],
    name: str,
    note: str,
    region: FrescoRegion | None = None,
) -> None:
    """List closed outlines (n,2) in a photo, of a new region or of one of the scan."""
    item = _add(scene, "PHOTO" if region is None else "TRANSFER", name, note)
    item.photo, item.region_id = photo.name, 0 if region is None else region.uid
    item.outlines_json = json.dumps([np.round(loop, 2).tolist() for loop in outlines])


def add_partners(
    scene: bpy.types.Scene,
    photo: FrescoPhoto,
    pairs: Sequence[tuple[FrescoRegion, FrescoRegion]],
    note: str,
    pose: Pose | None = None,
) -> None:
    """List pairs (region of the photo, region of the scan), with the pose that they would give."""
    name = ", ".join(f"{first.name} = {second.name}" for first, second in pairs)
    item = _add(scene, "PARTNERS", name, note)
    item.photo = photo.name
    item.pairs_json = json.dumps([[first.uid, second.uid] for first, second in pairs])
    if pose is not None:
        kept = {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()}
        item.pose_json = json.dumps(kept)


def read_outlines(proposal: FrescoProposal) -> list[FloatArray]:
    """Closed outlines (n,2) of a proposal, pixels of its photo."""
    return [np.array(loop) for loop in json.loads(proposal.outlines_json or "[]")]


def accept(scene: bpy.types.Scene, index: int) -> None:
    """Make a proposal true, and take it off the list with those that it makes pointless."""
    proposal = scene.fresco_marking.proposals[index]
    if proposal.kind in {"FACET", "OPENING"}:
        _accept_surface(scene, proposal)
    elif proposal.kind == "PARTNERS":
        _accept_partners(scene, proposal)
    else:
        _accept_outlines(scene, proposal)
    discard(scene, index)
    _drop_pointless(scene)


def _accept_surface(scene: bpy.types.Scene, proposal: FrescoProposal) -> None:
    region = regions.add_region(scene, proposal.name)
    if proposal.kind == "OPENING":
        region.opening_json = proposal.opening_json
        region.revision = secrets.randbits(31)
        return
    inside = meshes.read_face_attribute(scene.fresco.scan.data, proposal.attribute)
    if inside is None or not inside.any():
        raise RegionError(f"{proposal.name} is no longer on the scan: let regions be proposed again.")
    regions.write_faces(scene, region, inside)


def _accept_outlines(scene: bpy.types.Scene, proposal: FrescoProposal) -> None:
    photo = scene.fresco.photos.get(proposal.photo)
    if photo is None:
        raise RegionError(f"The photo {proposal.photo} is no longer in the list.")
    region = regions.region_of(scene, proposal.region_id) or regions.add_region(scene, proposal.name)
    mask = polygon_mask(read_outlines(proposal), *photo.size)
    regions.write_mark(photo, region, RegionMark(region.name, mask=mask), photo.size)


def _accept_partners(scene: bpy.types.Scene, proposal: FrescoProposal) -> None:
    for first, second in json.loads(proposal.pairs_json):
        in_photo, on_scan = regions.region_of(scene, first), regions.region_of(scene, second)
        if in_photo is None or on_scan is None:
            raise RegionError("One of these regions was removed: let partners be proposed again.")
        regions.merge_regions(scene, on_scan, in_photo)


def _drop_pointless(scene: bpy.types.Scene) -> None:
    """Take partnerships off the list whose regions are gone or have found another partner."""
    marking = scene.fresco_marking
    there = {region.uid for region in scene.fresco.regions}
    for index in reversed(range(len(marking.proposals))):
        proposal = marking.proposals[index]
        if proposal.kind != "PARTNERS":
            continue
        photo = scene.fresco.photos.get(proposal.photo)
        pairs = json.loads(proposal.pairs_json)
        gone = any(uid not in there for pair in pairs for uid in pair)
        if gone or photo is None or any(photo.mark(on_scan) is not None for _, on_scan in pairs):
            discard(scene, index)


def discard(scene: bpy.types.Scene, index: int) -> None:
    """Take a proposal off the list, and its faces off the scan."""
    marking = scene.fresco_marking
    scan = scene.fresco.scan
    if scan is not None:
        meshes.remove_attribute(scan.data, marking.proposals[index].attribute)
    marking.proposals.remove(index)
    marking.proposal_index = max(0, min(marking.proposal_index, len(marking.proposals) - 1))


def discard_all(scene: bpy.types.Scene, kinds: set[str], photo: str | None = None) -> None:
    """Take all proposals of some kinds off the list; of one photo only, if named."""
    marking = scene.fresco_marking
    for index in reversed(range(len(marking.proposals))):
        proposal = marking.proposals[index]
        if proposal.kind in kinds and photo in (None, proposal.photo):
            discard(scene, index)
