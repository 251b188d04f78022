"""Camera pose from regions: the stages in order."""

from __future__ import annotations

from collections.abc import Sequence

from ...arrays import ArrayLike
from ...cameras.base import Camera
from ...jobs import Job, Progress, drain
from ...regions import ImageRegion, SurfaceRegion
from ...settings import PoseSettings
from ..pose import Pose
from .algebraic import Candidates
from .ambiguity import chosen, plausible, unlike
from .covariance import moment_covariance
from .fitting import LEVELS, Contours, OutlineFit, fit_outlines
from .overlap import overlap_errors
from .problem import Problem, make_problem
from .region_pose import RegionPose
from .search import MOST_FITTED, moment_candidates

Regions = ImageRegion | Sequence[ImageRegion]
Surfaces = SurfaceRegion | Sequence[SurfaceRegion]


def estimate_pose(
    camera: Camera,
    image_regions: Regions,
    surface_regions: Surfaces,
    paired: bool = True,
    up: ArrayLike | None = None,
    initial: Pose | None = None,
    settings: PoseSettings | None = None,
) -> RegionPose:
    """Pose of a photo from regions seen in it and on the scan.

    Parameters
    ----------
    camera
        Any central camera.
    image_regions, surface_regions
        One or several; with `paired` the i-th of one belongs to the i-th of the other, otherwise only their
        unions show the same and the numbers may differ (eq. 3.22).
    up
        Direction (3,) in the world that points up in the photo, roughly; it decides between solutions.
    initial
        A rough pose, tried first and preferred among solutions that explain the regions equally well.

    Raises
    ------
    RegionError
        A region that cannot be used.
    PoseNotFound
        No pose makes the regions overlap; the text says what was reached.

    Source: Alg. 2 and 3 in a chart per region, with the stages that the package describes.
    """
    return drain(estimate_pose_job(camera, image_regions, surface_regions, paired, up, initial, settings))


def estimate_pose_job(
    camera: Camera,
    image_regions: Regions,
    surface_regions: Surfaces,
    paired: bool = True,
    up: ArrayLike | None = None,
    initial: Pose | None = None,
    settings: PoseSettings | None = None,
) -> Job[RegionPose]:
    """Like `estimate_pose`, in steps."""
    settings = settings or PoseSettings()
    photo = [image_regions] if isinstance(image_regions, ImageRegion) else list(image_regions)
    surfaces = [surface_regions] if isinstance(surface_regions, SurfaceRegion) else list(surface_regions)
    yield Progress(0.0, "Reading the regions' outlines")
    problem = make_problem(camera, photo, surfaces, paired)
    yield Progress(0.2, "Searching for poses that fit the regions")
    candidates = moment_candidates(problem, problem.sketches[0], up, initial)
    fits = yield from _fits(problem, candidates)
    good = _overlapping(problem, fits, settings.overlap_limit)
    if len(problem.sketches) > 1 and not any(fit.near == LEVELS[0].near for fit in good):
        yield Progress(0.7, "Searching from every region")
        others = moment_candidates(problem, problem.sketches[1], up, initial)
        fits += yield from _fits(problem, unlike(others, candidates))
        good = _overlapping(problem, fits, settings.overlap_limit)
    return chosen(problem, good or fits, initial, settings)


def _overlapping(problem: Problem, fits: Sequence[OutlineFit], limit: float) -> list[OutlineFit]:
    """Fits with at most `limit` % of the regions apart: pieces of outline coincide in wrong poses, too."""
    return [fit for fit in fits if overlap_errors(problem.moments, fit.rotation, fit.translation)[0] <= limit]


def _fits(problem: Problem, candidates: Candidates) -> Job[list[OutlineFit]]:
    """Candidates that explain the moments, after the outline stage."""
    fits: list[OutlineFit] = []
    contours = Contours(problem)
    for number, index in enumerate(_plausible(problem, candidates)):
        yield Progress(0.4 + 0.1 * number, "Fitting the outlines")
        rotation, translation = candidates.rotations[index], candidates.translations[index]
        covariance = moment_covariance(problem.moments, rotation, translation)
        fits.append(fit_outlines(contours, rotation, translation, covariance))
    return fits


def _plausible(problem: Problem, candidates: Candidates) -> list[int]:
    """Indices of the candidates worth fitting."""
    return [int(k) for k in plausible(candidates.costs, problem.equations)[:MOST_FITTED]]
