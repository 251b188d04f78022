"""Camera pose from regions: the stages in order."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ...arrays import ArrayLike
from ...cameras.base import Camera
from ...errors import PoseNotFound
from ...jobs import Job, Progress, drain
from ...regions import ImageRegion, SurfaceRegion
from ...settings import PoseSettings
from ..pose import Pose
from .algebraic import Candidates, joined
from .ambiguity import MISFIT, chosen, plausible, unlike
from .covariance import moment_covariance
from .fitting import LEVELS, Contours, Level, OutlineFit, Rigid, fit_like, fit_outlines, unlocked
from .misfits import misfits_told, pose_without_misfit
from .overlap import ROUGHLY, overlap_errors
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
        Direction (3,) in the world that points up in the photo, roughly; it decides between solutions that
        explain the regions equally well.
    initial
        A rough pose, tried as well; it decides between such solutions if it is much nearer to one of them.

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
    solve = partial(_solved, up=up, initial=initial, settings=settings)
    try:
        pose = yield from solve(problem)
    except PoseNotFound:
        found = yield from pose_without_misfit(problem, solve)
        if found is None:
            raise
        return found
    if pose.overlap_error <= MISFIT or (pose.locked and not pose.ambiguous):
        return misfits_told(problem, pose)
    return (yield from pose_without_misfit(problem, solve)) or pose


def _solved(
    problem: Problem, up: ArrayLike | None, initial: Pose | None, settings: PoseSettings
) -> Job[RegionPose]:
    """Pose of a problem as it stands."""
    yield Progress(0.2, "Searching for poses that fit the regions")
    candidates = moment_candidates(problem, problem.sketches[0], initial)
    contours = Contours(problem)
    fits = yield from _fits(contours, candidates, LEVELS[:1], settings.overlap_limit, 0.4)
    if not fits and len(problem.sketches) > 1:
        yield Progress(0.6, "Searching from every region")
        others = unlike(moment_candidates(problem, problem.sketches[1], initial), candidates)
        fits = yield from _fits(contours, others, LEVELS[:1], settings.overlap_limit, 0.6)
        candidates = joined([candidates, others]).sorted()
    if not fits:
        fits = yield from _fits(contours, candidates, LEVELS[1:], settings.overlap_limit, 0.7)
    yield Progress(0.9, "Comparing the poses found")
    return chosen(contours, fits or _by_moments(contours, candidates), up, initial, settings)


def _fits(
    contours: Contours, candidates: Candidates, levels: Sequence[Level], limit: float, progress: float
) -> Job[list[OutlineFit]]:
    """Fits of candidates that explain the moments, at the first level at which outlines coincide.

    More than `limit` % of the regions apart is none: pieces of outline coincide in wrong poses, too.
    """
    problem = contours.problem
    for level in levels:
        fits: list[OutlineFit] = []
        starts: list[Rigid] = []  # of each fit
        poses = [
            (candidates.rotations[k], candidates.translations[k]) for k in _plausible(problem, candidates)
        ]
        for pose in poses:
            yield Progress(progress, "Fitting the outlines")
            found = fit_outlines(level, contours, *pose, moment_covariance(problem.moments, *pose))
            fits, starts = fits + found, starts + [pose] * len(found)
        if fits:
            best = max(range(len(fits)), key=lambda k: fits[k].evidence)
            others = [pose for pose in poses if pose is not starts[best]]
            for other in others:
                fits += fit_like(level, contours, fits[best], starts[best], other)
        fits = [fit for fit in fits if _apart(problem, fit) <= limit]
        if fits:
            return fits
    return []


def _apart(problem: Problem, fit: OutlineFit) -> float:
    """Overlap error in percent, roughly."""
    return overlap_errors(problem.coarse, fit.rotation, fit.translation, ROUGHLY)[0]


def _by_moments(contours: Contours, candidates: Candidates) -> list[OutlineFit]:
    """Candidates that explain the moments, as they are."""
    moments = contours.problem.moments
    poses = [
        (candidates.rotations[k], candidates.translations[k])
        for k in _plausible(contours.problem, candidates)
    ]
    return [unlocked(contours, *pose, moment_covariance(moments, *pose)) for pose in poses]


def _plausible(problem: Problem, candidates: Candidates) -> list[int]:
    """Indices of the candidates worth fitting."""
    return [int(k) for k in plausible(candidates.costs, problem.equations)[:MOST_FITTED]]
