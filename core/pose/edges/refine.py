"""Refine the pose of one photo by the edges of the scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import ArrayLike, FloatArray
from ...cameras.resolution import angular_resolution
from ...jobs import Job, Progress, drain
from ...photos.view import View
from ...settings import EdgeSettings
from ..points.pictures import read_view, read_view_mask
from ..pose import Pose
from .alignment import Alignment, Photo, PosePrior, align_edges, edge_agreement
from .checks import disagreement_of_halves, far_move, few_edges, halves_apart, image_shift, no_agreement
from .photo_edges import photo_edge_field
from .rendering import Scan
from .scan_edges import ScanEdges, find_scan_edges

COARSEST = 480.0
"""Longer side (pixels) below which the finest level is not reduced, however coarse the scan is."""


ROUGH = 10.0
"""Angle (degrees) between faces and averaged normals at which a scan counts as noisy."""


@dataclass(frozen=True, eq=False)
class EdgePose(Pose):
    """A pose refined by edges.

    `score_before`, `score_after`: how much stronger the photo's edges are where the scan's fall than beside
    them, 1 where they have nothing to do with each other, measured on edges that took no part in the fit.
    `edges`: edge points that hold the pose. `note`: why the pose was kept, empty when it was refined.
    """

    score_before: float
    score_after: float
    edges: int
    note: str

    @property
    def refined(self) -> bool:
        """Whether the pose was moved."""
        return not self.note


def refine_pose_by_edges(
    view: View,
    vertices: ArrayLike,
    faces: ArrayLike,
    vertex_colors: ArrayLike | None = None,
    settings: EdgeSettings | None = None,
) -> EdgePose:
    """Pose of a photo, moved until the edges of the scan fall on those of the photo.

    vertices (V,3) m, world; faces (F,3); vertex_colors (V,3) or intensities (V,), bytes or 0 to 1: their
    edges are used as well. The pose is kept, and `note` says why, where edges are few, crowded or agree no
    better than before, where it would move further than `view.covariance` (without one: the settings) makes
    likely, and where two halves of the photo contradict each other; a small contradiction widens the
    covariance. Raises `PhotoError` for a photo that cannot be read. Source: method.md 2.6.
    """
    return drain(refine_pose_by_edges_job(view, vertices, faces, vertex_colors, settings))


def refine_pose_by_edges_job(
    view: View,
    vertices: ArrayLike,
    faces: ArrayLike,
    vertex_colors: ArrayLike | None = None,
    settings: EdgeSettings | None = None,
) -> Job[EdgePose]:
    """Job of `refine_pose_by_edges`."""
    settings = settings or EdgeSettings()
    yield Progress(0.0, "Preparing the scan")
    points = np.asarray(vertices, dtype=np.float64)
    # relative to the scan's middle: world coordinates may be millions of metres
    origin = points.mean(axis=0) if len(points) else np.zeros(3)
    scan = Scan.of_mesh(points - origin, faces, vertex_colors)
    prior = _prior(view, origin, settings)
    rotation, centre = prior.rotation, prior.centre
    rng = np.random.default_rng(settings.seed)
    triangle = _triangle_size(view, prior, scan)
    rounds = _rounds(_finest_scale(view, triangle, settings), settings)
    alignment, photo, last_scale = None, None, 0.0
    for number, (scale, widths) in enumerate(rounds):
        yield Progress(0.1 + 0.8 * number / len(rounds), f"Aligning edges at {scale:.0%} of the photo")
        if photo is None or scale != last_scale:
            photo, last_scale = _photo(view, scale, scan, settings), scale
        edges = find_scan_edges(photo.camera, rotation, centre, scan, settings)
        fit, _ = _divided(edges, settings, rng)
        alignment = align_edges(photo, fit, rotation, centre, prior, widths)
        rotation, centre = alignment.rotation, alignment.centre
    yield Progress(0.9, "Comparing with the pose before")
    assert photo is not None and alignment is not None
    return _decide(view, origin, photo, scan, prior, alignment, settings)


def _photo(view: View, scale: float, scan: Scan, settings: EdgeSettings) -> Photo:
    """The photo's edges at `scale`; those of a noisy scan are doubted more."""
    field = photo_edge_field(read_view(view, scale), read_view_mask(view, scale))
    doubt = 0.75 * settings.search * min(1.0, scan.noise / np.radians(ROUGH))
    return Photo(view.camera.scaled(scale), field, settings.search, float(doubt))


def _triangle_size(view: View, prior: PosePrior, scan: Scan) -> float:
    """Median side of the scan's triangles as seen from the pose, in pixels of the full photo."""
    camera = view.camera
    columns, rows = np.linspace(0, camera.width - 1, 48), np.linspace(0, camera.height - 1, 48)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    hits = scan.caster.first_hit(prior.centre, camera.unproject(pixels) @ prior.rotation)
    struck = hits.face >= 0
    if not struck.any():
        return 1.0
    corners = scan.vertices[scan.faces[hits.face[struck]]]
    side = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
    return float(np.nanmedian(side / hits.distance[struck] / angular_resolution(camera, pixels[struck])))


def _finest_scale(view: View, triangle: float, settings: EdgeSettings) -> float:
    """Largest image scale that makes sense: pixels not finer than the scan's triangles."""
    largest = max(view.camera.width, view.camera.height)
    scale = min(1.0, settings.photo_size / largest)
    return float(np.clip(1.0 / triangle, min(COARSEST / largest, scale), scale))


def _rounds(finest: float, settings: EdgeSettings) -> list[tuple[float, tuple[float, ...]]]:
    """Image scale and matching widths (px) of each round; the scan is rendered anew in each."""
    wide, narrow = (settings.search / 2, 2.0), (2.0, 1.0)
    return [
        (finest / 4, wide),
        (finest / 4, narrow),
        (finest / 2, narrow),
        (finest / 2, narrow),
        (finest, narrow),
        (finest, (1.0,)),
    ]


def _prior(view: View, origin: FloatArray, settings: EdgeSettings) -> PosePrior:
    covariance = view.covariance
    if covariance is None:
        sigma = np.repeat([np.radians(settings.rotation_sigma), settings.centre_sigma], 3)
        covariance = np.diag(sigma**2)
    return PosePrior(view.rotation, view.centre - origin, covariance)


def _divided(
    edges: ScanEdges, settings: EdgeSettings, rng: np.random.Generator
) -> tuple[ScanEdges, ScanEdges]:
    """Edges for the fit and those held back for the score: one tile of 32 pixels in four."""
    tile = (edges.pixels // 32).astype(np.int64)
    held = (tile[:, 0] + 2 * tile[:, 1]) % 4 == 0
    return _at_most(edges.select(~held), settings.max_edges, rng), _at_most(
        edges.select(held), settings.max_edges, rng
    )


def _at_most(edges: ScanEdges, count: int, rng: np.random.Generator) -> ScanEdges:
    if len(edges) <= count:
        return edges
    return edges.select(np.sort(rng.choice(len(edges), count, replace=False)))


def _decide(
    view: View,
    origin: FloatArray,
    photo: Photo,
    scan: Scan,
    prior: PosePrior,
    alignment: Alignment,
    settings: EdgeSettings,
) -> EdgePose:
    """The refined pose, its covariance widened by the checks, or the old one where the evidence is thin."""
    poses = [(prior.rotation, prior.centre), (alignment.rotation, alignment.centre)]
    rng = np.random.default_rng(settings.seed)
    # both poses are judged by the edges seen from either
    seen = [_divided(find_scan_edges(photo.camera, *pose, scan, settings), settings, rng) for pose in poses]
    before, after = (float(np.mean([edge_agreement(photo, held, *p) for _, held in seen])) for p in poses)
    note = (
        few_edges(alignment, settings) or no_agreement(before, after, settings) or far_move(alignment, prior)
    )
    if not note:
        widths = (settings.search / 2, 2.0, 1.0)
        fit = seen[1][0]
        disagreement = disagreement_of_halves(photo, fit, alignment, prior, widths)
        # the first round matches at a quarter of this level, half of the search wide
        reach = 4 * settings.search / 2
        note = halves_apart(disagreement, image_shift(photo, fit, alignment, prior), reach)
    if note:
        return EdgePose(view.rotation, view.translation, prior.covariance, before, before, 0, note)
    centre = alignment.centre + origin
    return EdgePose(
        alignment.rotation,
        -alignment.rotation @ centre,
        alignment.widened(disagreement),
        before,
        after,
        alignment.matched,
        "",
    )
