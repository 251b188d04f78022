"""What the marking tools are set to, and what they propose, in the scene."""

from __future__ import annotations

import bpy

PROPOSAL_KINDS = (
    ("FACET", "Facet", "A smooth part of the scan", "MESH_PLANE", 0),
    ("OPENING", "Opening", "A window, door or niche in the scan", "MOD_BOOLEAN", 1),
    ("PHOTO", "Area", "A frame or closed area of a photo", "IMAGE_DATA", 2),
    ("TRANSFER", "Transfer", "A region of the scan as another photo shows it", "UV_SYNC_SELECT", 3),
    ("PARTNERS", "Partners", "Regions of photo and scan that may be the same patches", "LINKED", 4),
)


class FrescoProposal(bpy.types.PropertyGroup):
    """Something found that becomes a region, a mark or a partnership only when it is accepted."""

    uid: bpy.props.IntProperty(description="Number that no other proposal has")
    kind: bpy.props.EnumProperty(name="Kind", items=PROPOSAL_KINDS)
    note: bpy.props.StringProperty(description="Its size or score, for the list")
    photo: bpy.props.StringProperty(description="Name of the photo that it was found in")
    region_id: bpy.props.IntProperty(description="Region that it marks; 0 for a new one")
    outlines_json: bpy.props.StringProperty(description="Closed outlines in pixels of the photo")
    opening_json: bpy.props.StringProperty(description="As a region's opening_json")
    pairs_json: bpy.props.StringProperty(description="Partners: region of the photo, region of the scan")
    pose_json: bpy.props.StringProperty(description="Rotation and translation (Blender's world) of a pairing")

    @property
    def attribute(self) -> str:
        """Name of the scan's face attribute that is true in a proposed facet."""
        return f"fresco_proposal_{self.uid}"


class FrescoMarking(bpy.types.PropertyGroup):
    """Settings of the marking tools, and the proposals."""

    kind: bpy.props.EnumProperty(
        name="Look for",
        items=(
            ("auto", "Best", "A straight frame or an area of one colour, whatever the photo supports better"),
            ("frame", "Frames", "Straight-sided frames of three or four sides: panels, windows, doors"),
            ("colour", "Colour", "A closed area of like colour: openings, painted fields"),
        ),
        description="What the wand looks for around a click",
    )
    part: bpy.props.EnumProperty(
        name="Mark",
        items=(
            ("REGION", "Region", "Strokes mark the region"),
            (
                "HIDDEN",
                "Hidden Part",
                "Strokes mark what stands before the chosen region, a scaffold or tree: there its outline "
                "does not count for the pose",
            ),
        ),
        description="What strokes in the photo mark",
    )
    redo: bpy.props.BoolProperty(
        name="Redo",
        description="Strokes replace the chosen region's mark, instead of beginning a new region",
    )
    radius: bpy.props.IntProperty(
        name="Radius", default=30, min=1, max=2000, subtype="PIXEL", description="Brush radius on the screen"
    )
    snap: bpy.props.BoolProperty(
        name="Snap to Edges", default=False, description="Move a drawn outline onto the photo's edges nearby"
    )
    reach: bpy.props.IntProperty(
        name="Reach",
        default=8,
        min=1,
        max=100,
        subtype="PIXEL",
        description="How far (pixels of the photo) an outline may move to meet an edge",
    )
    grow: bpy.props.IntProperty(
        name="Distance",
        default=5,
        min=1,
        max=1000,
        subtype="PIXEL",
        description="How far (pixels of the photo) Grow and Shrink move an outline",
    )
    wand_steps: bpy.props.IntProperty(description="Steps from the best region that the last click stands at")
    proposals: bpy.props.CollectionProperty(type=FrescoProposal)
    proposal_index: bpy.props.IntProperty(name="Proposal")

    @property
    def active_proposal(self) -> FrescoProposal | None:
        """The proposal chosen in the list."""
        count = len(self.proposals)
        return self.proposals[self.proposal_index] if 0 <= self.proposal_index < count else None


CLASSES = (FrescoProposal, FrescoMarking)


def attach() -> None:
    """Hang the settings on the scene."""
    bpy.types.Scene.fresco_marking = bpy.props.PointerProperty(type=FrescoMarking)


def detach() -> None:
    """Remove their definition."""
    del bpy.types.Scene.fresco_marking
