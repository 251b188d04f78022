"""Let regions, partners and marks in other photos be proposed; nothing counts before it is accepted."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.arrays import BoolArray
from ...core.jobs import Job, Progress, part
from ...core.regions.photo.outline import polygon_mask
from ...core.regions.photo.proposals import propose_image_regions_job
from ...core.regions.photo.wand import Level, PhotoWand
from ...core.regions.surface.proposals import (
    SurfaceProposal,
    propose_facets_job,
    propose_openings_job,
)
from ..background import beside_job
from ..bridge import meshes
from ..bridge import proposals as bridge
from ..bridge import regions as region_bridge
from ..bridge.images import MaskSource, mask_source
from ..jobs import JobOperator, StepOperator
from ..properties import FrescoPhoto
from ..tools import targets
from ..tools.prepared import PreparedScan, photo_job, scan_job
from ..tools.watch import redraw_views
from .regions import has_faces

_TAKEN = 0.5  # share of a proposal that may lie in regions that are marked already


class FRESCO_OT_propose_surface(JobOperator):
    bl_idname = "fresco.propose_surface"
    bl_label = "Propose on Scan"
    bl_description = "Look for smooth facets and openings of the scan; you choose which become regions"
    bl_options = {"REGISTER", "UNDO"}
    step = "regions"

    count: bpy.props.IntProperty(name="Facets", default=12, min=1, max=100, description="How many at most")
    least_area: bpy.props.FloatProperty(
        name="Smallest Opening",
        default=0.1,
        min=1e-6,
        description="Area (m²) from which a hole counts as opening",
    )

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_faces(cls, context):
            return False
        cls.poll_message_set("Leave Edit Mode first")
        return context.scene.fresco.scan.mode == "OBJECT"

    def start(self, context: bpy.types.Context) -> Job[list[SurfaceProposal]]:
        scan = context.scene.fresco.scan
        taken = np.zeros(len(scan.data.polygons), dtype=np.bool_)
        for region in context.scene.fresco.regions:
            taken |= region_bridge.read_faces(context.scene, region)
        return self._job_of(scan_job(scan), taken, self.count, self.least_area)

    @staticmethod
    def _job_of(
        prepared: Job[PreparedScan], taken: BoolArray, count: int, least_area: float
    ) -> Job[list[SurfaceProposal]]:
        scan = yield from part(prepared, 0.0, 0.5)
        return (yield from part(beside_job(surface_job(scan, taken, count, least_area)), 0.5, 1.0))

    def finish(self, context: bpy.types.Context, result: list[SurfaceProposal]) -> None:
        bridge.discard_all(context.scene, {"FACET", "OPENING"})
        numbers = {"Facet": 0, "Opening": 0}
        for proposal in result:
            kind = "Facet" if len(proposal.faces) else "Opening"
            numbers[kind] += 1
            bridge.add_surface(context.scene, proposal, f"{kind} {numbers[kind]}")
        self.report({"INFO"}, f"{numbers['Facet']} facets and {numbers['Opening']} openings proposed")


def surface_job(
    scan: PreparedScan, taken: BoolArray, count: int, least_area: float
) -> Job[list[SurfaceProposal]]:
    """Facets that are not marked already (`taken`, (F,)), and openings, of a scan."""
    facets = yield from part(propose_facets_job(scan.index, scan.vertices, scan.faces, count), 0.0, 0.8)
    openings = yield from part(
        propose_openings_job(scan.index, scan.vertices, scan.faces, least_area), 0.8, 1.0
    )
    new = [facet for facet in facets if np.mean(taken[facet.faces]) < _TAKEN]
    return [*new, *openings]


class FRESCO_OT_propose_photo(JobOperator):
    bl_idname = "fresco.propose_photo"
    bl_label = "Propose in Photo"
    bl_description = "Look for frames and closed areas of the photo; you choose which become regions"
    bl_options = {"REGISTER", "UNDO"}
    step = "regions"

    count: bpy.props.IntProperty(name="Areas", default=10, min=1, max=100, description="How many at most")

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Choose a photo with a calibrated camera in the list")
        photo = worked_photo(context)
        return photo is not None and bool(photo.camera_json)

    def start(self, context: bpy.types.Context) -> Job[list[Level]]:
        photo = worked_photo(context)
        self._photo = photo.name
        marks = [mask_source(mark.image) for mark in photo.marks if mark.image is not None]
        return self._job_of(photo_job(photo), marks, self.count)

    @staticmethod
    def _job_of(prepared: Job[PhotoWand], marks: list[MaskSource], count: int) -> Job[list[Level]]:
        wand = yield from part(prepared, 0.0, 0.3)
        return (yield from part(beside_job(areas_job(wand, marks, count)), 0.3, 1.0))

    def finish(self, context: bpy.types.Context, result: list[Level]) -> None:
        photo = context.scene.fresco.photos[self._photo]
        bridge.discard_all(context.scene, {"PHOTO"}, photo.name)
        whole = photo.size[0] * photo.size[1]
        for number, level in enumerate(result, 1):
            note = f"{100 * level.area / whole:.1f} % of {photo.name}"
            bridge.add_outlines(context.scene, photo, [level.outline], f"Area {number}", note)
        self.report({"INFO"}, f"{len(result)} areas proposed in {photo.name}")


def areas_job(wand: PhotoWand, marks: list[MaskSource], count: int) -> Job[list[Level]]:
    """Areas of a photo with finished outlines, without those that are marked already."""
    found = yield from part(propose_image_regions_job(wand, count), 0.0, 0.8)
    taken = [mark.read()[::8, ::8] for mark in marks]
    height, width = wand.image.shape[:2]
    levels = []
    for number, level in enumerate(found):
        yield Progress(0.8 + 0.2 * number / len(found), "Finishing outlines")
        area = polygon_mask([level.outline], width, height)[::8, ::8]
        if all(np.count_nonzero(area & mask) < _TAKEN * np.count_nonzero(area) for mask in taken):
            (outline,) = wand.finished(level)
            levels.append(Level(outline, level.area, level.score, level.straight))
    return levels


def worked_photo(context: bpy.types.Context) -> FrescoPhoto | None:
    """Return the photo in this Image Editor, else the one chosen in the list."""
    return targets.shown_photo(context) or context.scene.fresco.active_photo


class ProposalOperator(StepOperator):
    """Mixin: something done to proposals, which lie over photo and scan."""

    bl_options = {"UNDO"}
    step = "regions"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Nothing is proposed")
        if context.scene.fresco_marking.active_proposal is None:
            return False
        scan = context.scene.fresco.scan
        cls.poll_message_set("Leave Edit Mode first")
        return scan is None or scan.mode == "OBJECT"

    def execute(self, context: bpy.types.Context) -> set[str]:
        done = super().execute(context)
        redraw_views(context.window_manager)
        return done


class FRESCO_OT_accept_proposal(ProposalOperator):
    bl_idname = "fresco.accept_proposal"
    bl_label = "Accept"
    bl_description = "Accept the proposal chosen in the list"

    def run(self, context: bpy.types.Context) -> None:
        bridge.accept(context.scene, context.scene.fresco_marking.proposal_index)


class FRESCO_OT_accept_all_proposals(ProposalOperator):
    bl_idname = "fresco.accept_all_proposals"
    bl_label = "Accept All"
    bl_description = "Accept all proposed regions; partners are accepted one by one"

    def run(self, context: bpy.types.Context) -> None:
        proposals = context.scene.fresco_marking.proposals
        for index in reversed(range(len(proposals))):
            if proposals[index].kind != "PARTNERS":
                bridge.accept(context.scene, index)


class FRESCO_OT_discard_proposal(ProposalOperator):
    bl_idname = "fresco.discard_proposal"
    bl_label = "Discard"
    bl_description = "Refuse the proposal chosen in the list"

    def run(self, context: bpy.types.Context) -> None:
        bridge.discard(context.scene, context.scene.fresco_marking.proposal_index)


class FRESCO_OT_discard_all_proposals(ProposalOperator):
    bl_idname = "fresco.discard_all_proposals"
    bl_label = "Discard All"
    bl_description = "Refuse all proposals in the list"

    def run(self, context: bpy.types.Context) -> None:
        marking = context.scene.fresco_marking
        for index in reversed(range(len(marking.proposals))):
            bridge.discard(context.scene, index)


class FRESCO_OT_select_proposal(ProposalOperator):
    bl_idname = "fresco.select_proposal"
    bl_label = "Select Faces"
    bl_description = "Select the proposed facet's faces on the scan, in Edit Mode, to look at or change them"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not super().ready(context):
            return False
        cls.poll_message_set("Choose a facet in the list of proposals")
        return context.scene.fresco_marking.active_proposal.kind == "FACET"

    def run(self, context: bpy.types.Context) -> None:
        scan, proposal = context.scene.fresco.scan, context.scene.fresco_marking.active_proposal
        context.view_layer.objects.active = scan
        meshes.select_faces(scan.data, meshes.read_face_attribute(scan.data, proposal.attribute))
        bpy.ops.object.mode_set(mode="EDIT")
        context.tool_settings.mesh_select_mode = (False, False, True)


CLASSES = (
    FRESCO_OT_propose_surface,
    FRESCO_OT_propose_photo,
    FRESCO_OT_accept_proposal,
    FRESCO_OT_accept_all_proposals,
    FRESCO_OT_discard_proposal,
    FRESCO_OT_discard_all_proposals,
    FRESCO_OT_select_proposal,
)
