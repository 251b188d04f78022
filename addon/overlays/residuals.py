"""Edges of the scan over the chosen photo: where the poses before and after refinement put them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...core.arrays import FloatArray
from ...core.cameras import Camera
from ...core.pose.joint import TieResiduals
from ...core.project.stages.residuals import EdgeResiduals, pose_between, tie_residuals
from ..bridge import photos as bridge
from ..bridge.cameras import read_pose
from ..properties import FrescoPhoto
from ..tools.targets import shown_photo, to_region

BEFORE, AFTER, RESIDUAL, TIE = (1.0, 0.45, 0.05), (0.1, 0.85, 1.0), (1.0, 0.9, 0.1), (1.0, 0.3, 0.85)
WIDTH = 1.5  # pixels
CELLS = 60  # residuals shown along the longer side of a photo

PoseOf = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class PhotoEdges:
    """Edges of a photo at both poses; `shown_for` is what the photo kept when they were found."""

    camera: Camera
    poses: tuple[PoseOf, PoseOf]
    residuals: tuple[EdgeResiduals, EdgeResiduals]
    shown_for: str

    @classmethod
    def of(
        cls, scene: bpy.types.Scene, photo: FrescoPhoto, before: EdgeResiduals, after: EdgeResiduals
    ) -> PhotoEdges:
        """Keep what was found for a photo as it stands now."""
        solution = bridge.read_solution(scene, photo)
        first, second = solution.first_pose, solution.pose
        poses = (first.rotation, first.translation), (second.rotation, second.translation)
        return cls(bridge.read_camera(photo), poses, (before, after), photo.pose_json)

    def pose_at(self, share: float) -> PoseOf:
        """Pose on the way from before (0) to after (1)."""
        return pose_between(*self.poses, share)

    def residuals_at(self, share: float) -> EdgeResiduals:
        """Residuals of the nearer pose."""
        return self.residuals[round(share)]


RESIDUALS: dict[str, PhotoEdges] = {}
"""By the photo's name; what belongs to another pose than the photo's is not drawn."""


def edges_of(photo: FrescoPhoto | None) -> PhotoEdges | None:
    """Return the edges found for a photo, None where its pose has changed since."""
    found = RESIDUALS.get(photo.name) if photo is not None else None
    return found if found is not None and found.shown_for == photo.pose_json else None


TIES: dict[str, tuple[str, TieResiduals | None]] = {}
"""By the photo's name: what it kept when they were read, and its ties."""


def ties_of(scene: bpy.types.Scene, photo: FrescoPhoto | None) -> TieResiduals | None:
    """Return what the joint refinement left of a photo's ties, None where it did not move the pose last."""
    if photo is None or not photo.is_refined:
        return None
    kept = photo.solution_json + photo.pose_json
    known = TIES.get(photo.name)
    if known is None or known[0] != kept:
        known = TIES[photo.name] = kept, tie_residuals(bridge.read_solution(scene, photo).refinements)
    return known[1]


def mixed(share: float) -> FloatArray:
    """Colour between that of the pose before and that of the pose after."""
    return (1 - share) * np.array(BEFORE) + share * np.array(AFTER)


def draw_segments(segments: FloatArray, color: Sequence[float], width: float = WIDTH) -> None:
    """Draw many short lines (N,2,2) in region pixels or (N,2,3) in the view's world."""
    if len(segments) == 0:
        return
    ends = segments.reshape(-1, segments.shape[2])
    if ends.shape[1] == 2:
        ends = np.column_stack([ends, np.zeros(len(ends))])
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    shader.uniform_float("lineWidth", width)
    shader.uniform_float("color", (*(float(part) for part in color[:3]), 1.0))
    batch_for_shader(shader, "LINES", {"pos": ends.astype(np.float32)}).draw(shader)
    gpu.state.blend_set("NONE")


def draw_on_photo() -> None:
    """Draw over the photo in the Image Editor."""
    context = bpy.context
    photo = shown_photo(context)
    found, compare = edges_of(photo), context.scene.fresco.compare
    ties = ties_of(context.scene, photo) if compare.ties else None
    if ties is not None:
        draw_ties(context, ties, photo.size, compare.scale)
    if found is None:
        return
    size = (found.camera.width, found.camera.height)
    if compare.edges:
        pixels = found.residuals[1].projected(found.camera, *found.pose_at(compare.blend))
        draw_segments(to_region(context, pixels.reshape(-1, 2), size).reshape(-1, 2, 2), mixed(compare.blend))
    if compare.residuals:
        vectors = residual_vectors(found.residuals_at(compare.blend), compare.scale)
        draw_segments(
            to_region(context, vectors.reshape(-1, 2), size).reshape(-1, 2, 2), RESIDUAL, WIDTH + 0.5
        )


def draw_ties(context: bpy.types.Context, ties: TieResiduals, size: tuple[int, int], scale: float) -> None:
    """Draw a dot where the pose puts each tie, and a line towards where it is, `scale` times as long."""
    ends = np.stack([ties.pixels, ties.pixels + scale * ties.offsets], axis=1)
    places = to_region(context, ends.reshape(-1, 2), size).reshape(-1, 2, 2)
    draw_segments(places, TIE, WIDTH + 0.5)
    dots = places[:, :1] + np.array([[-1.5, 0.0], [1.5, 0.0]])
    draw_segments(dots, TIE, 3.0)


def residual_vectors(residuals: EdgeResiduals, scale: float) -> FloatArray:
    """Lines (M,2,2) px from the scan's edges towards the photo's, `scale` times as long as they are."""
    known = np.flatnonzero(np.isfinite(residuals.offsets[:, 0]))
    if len(known) == 0:
        return np.zeros((0, 2, 2))
    # one in a cell: lines that lie on each other tell nothing
    cell = np.maximum(residuals.pixels[known].max() / CELLS, 1.0)
    _, first = np.unique(residuals.pixels[known] // cell, axis=0, return_index=True)
    start, way = residuals.pixels[known[first]], residuals.offsets[known[first]]
    return np.stack([start, start + scale * way], axis=1)


def draw_in_view() -> None:
    """Draw over the photo behind the scan, where the view looks through its camera."""
    context = bpy.context
    scene, view = context.scene, context.region_data
    photo = scene.fresco.active_photo
    found, compare = edges_of(photo), scene.fresco.compare
    through = view is not None and view.view_perspective == "CAMERA" and photo is not None
    if found is None or not compare.edges or not through or scene.camera != photo.camera:
        return
    rotation, translation = found.pose_at(compare.blend)
    own, own_translation = read_pose(photo.camera)
    # moved so that the camera, where it stands, sees them as it would from the other pose
    in_camera = found.residuals[1].segments.reshape(-1, 3) @ rotation.T + translation
    draw_segments(((in_camera - own_translation) @ own).reshape(-1, 2, 3), mixed(compare.blend))
