"""Over the photo in the Image Editor: marked regions, what hides them, proposals, and how the pose fits."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import bpy
import cv2
import numpy as np

from ...core.arrays import FloatArray
from ...core.errors import FrescoError
from ...core.regions.photo.outline import mask_polygons
from ...core.regions.transfer import project_region
from ..bridge import photos as bridge
from ..bridge.images import MaskSource, mask_source
from ..bridge.proposals import read_outlines
from ..bridge.regions import region_of
from ..properties import FrescoMark, FrescoPhoto, FrescoRegion
from ..tools.targets import shown_photo, to_region
from .kept import Kept
from .lines import WIDTH, Labels, draw_dashes, draw_loops, draw_segments, hatching
from .scan import SHAPES

_LIMIT = 60  # outlines kept: those of all photos between which a user goes back and forth
PROPOSED = (1.0, 1.0, 1.0)
_Size = tuple[int, int]


@dataclass(frozen=True, eq=False)
class MaskOutline:
    """Closed outlines (n,2) of a mask in its pixels, its size (width, height), and hatching (m,2,2) of it."""

    loops: Sequence[FloatArray]
    size: _Size
    hatching: FloatArray


class Outlines(Kept[MaskOutline]):
    """Outlines of mask images, found once per mask: every stroke makes a new mask image."""

    def of_image(self, image: bpy.types.Image, mark: str) -> MaskOutline:
        """Outline of a mask, the one of several that a `mark` had in turn.

        Empty where its file is gone; while a large one is looked at, the one that the mark had before.
        """
        stored = image.packed_file.size if image.packed_file is not None else _LARGE + 1

        def gather() -> Callable[[], MaskOutline]:
            source = mask_source(image)
            return lambda: _outline(source)

        found = self.of(mark, image.session_uid, stored > _LARGE, gather)
        return _NOTHING if found is None else found


def _outline(source: MaskSource) -> MaskOutline:
    try:
        mask = source.read()
    except FrescoError:  # the panel of step 4 says which file is missing
        return _NOTHING
    u, v, columns, rows = cv2.boundingRect(mask.view(np.uint8))
    found = mask_polygons(mask[v : v + rows, u : u + columns]) if columns else []
    loops = [loop + np.array([u, v]) for loop in found]
    lines = hatching(loops, max(columns / 30, rows / 30, 2.0)) if loops else _NOTHING.hatching
    return MaskOutline(loops, mask.shape[::-1], lines)


_NOTHING = MaskOutline((), (1, 1), np.zeros((0, 2, 2)))
_LARGE = 4_000  # bytes of a packed mask from which its outline is found beside the window
OUTLINES = Outlines(_LIMIT)


def draw() -> None:
    """Draw what is known and proposed of the shown photo; the chosen region's outline is thicker."""
    context = bpy.context
    photo = shown_photo(context)
    if photo is None:
        return
    labels = Labels()
    errors = region_errors(photo)
    for region in context.scene.fresco.regions:
        mark = photo.mark(region.uid)
        if mark is not None and mark.image is not None:
            _draw_mark(context, photo.name, mark, region, labels, errors.get(region.name))
    if photo.is_posed:
        rotation, translation, _ = bridge.read_pose(context.scene, photo)
        _draw_projections(context, photo, list(context.scene.fresco.regions), rotation, translation)
    _draw_proposals(context, photo, labels)


def region_errors(photo: FrescoPhoto) -> dict[str, float]:
    """Overlap error (%) of every region that the photo's pose was solved from, by name."""
    if photo.state != "SOLVED" or not photo.solution_json:
        return {}
    solution = json.loads(photo.solution_json)
    pose = solution["pose"] or {}
    errors = dict(zip(solution["regions"], pose.get("region_errors", ()), strict=False))
    return {name: error for name, error in errors.items() if error == error}  # NaN: it did not count


def _draw_mark(
    context: bpy.types.Context,
    photo: str,
    mark: FrescoMark,
    region: FrescoRegion,
    labels: Labels,
    error: float | None,
) -> None:
    name = f"{photo} {region.uid}"
    outline = OUTLINES.of_image(mark.image, name)
    loops = [to_region(context, loop, outline.size) for loop in outline.loops]
    chosen = region == context.scene.fresco.active_region
    draw_loops(loops, region.color, width=WIDTH + (1.5 if chosen else 0.0))
    if mark.hidden is not None:
        hidden = OUTLINES.of_image(mark.hidden, f"{name} hidden")
        lines = to_region(context, hidden.hatching.reshape(-1, 2), hidden.size).reshape(-1, 2, 2)
        draw_segments(lines, region.color)
    if loops:
        text = region.name if error is None else f"{region.name}   {error:.1f} %"
        labels.draw(text, middle(loops), region.color)


def middle(loops: Sequence[FloatArray]) -> FloatArray:
    """Where a name is written: the middle (2,) of the longest loop's extent."""
    longest = max(loops, key=len)
    return (longest.min(axis=0) + longest.max(axis=0)) / 2


def _draw_projections(
    context: bpy.types.Context,
    photo: FrescoPhoto,
    regions: Sequence[FrescoRegion],
    rotation: FloatArray,
    translation: FloatArray,
) -> None:
    """Draw the scan's regions as a pose shows them, dashed: what differs from the marks is the residual."""
    scan = context.scene.fresco.scan
    if scan is None or not photo.camera_json:
        return
    camera = bridge.read_camera(photo)
    for region in regions:
        for loop in SHAPES.loops(context.scene, region):
            try:
                (projected,) = project_region(camera, rotation, translation, _Loop(loop, region.name))
            except FrescoError:  # behind the camera: nothing to draw
                continue
            if np.all(camera.in_frame(projected, margin=-camera.width)):
                draw_dashes([to_region(context, projected, photo.size)], region.color, width=1.0)


@dataclass(frozen=True, eq=False)
class _Loop:
    """One boundary loop (n,3), in metres, that is projected like a region."""

    loop: FloatArray
    name: str

    @property
    def loops(self) -> tuple[FloatArray, ...]:
        return (self.loop,)


def _draw_proposals(context: bpy.types.Context, photo: FrescoPhoto, labels: Labels) -> None:
    marking = context.scene.fresco_marking
    for proposal in marking.proposals:
        chosen = proposal == marking.active_proposal
        if proposal.photo != photo.name:
            continue
        if proposal.kind == "PARTNERS":
            if chosen and proposal.pose_json:
                pose = json.loads(proposal.pose_json)
                pairs = json.loads(proposal.pairs_json)
                regions = [region_of(context.scene, on_scan) for _, on_scan in pairs]
                at = np.array(pose["rotation"]), np.array(pose["translation"])
                _draw_projections(context, photo, [r for r in regions if r is not None], *at)
            continue
        loops = [to_region(context, loop, photo.size) for loop in read_outlines(proposal)]
        draw_dashes(loops, PROPOSED, width=WIDTH + (1.0 if chosen else -0.5))
        labels.draw(f"{proposal.name}?", middle(loops), PROPOSED)
