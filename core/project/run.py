"""A whole project from its file to a textured scan: the stages one after the other."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, TypeVar

import numpy as np

from ..arrays import IntArray
from ..errors import FrescoError, PhotoError, PoseNotFound, ProjectError, ScanError
from ..files import output_error
from ..jobs import Job, Progress, drain, part
from ..photos.image import check_complete
from ..photos.photo import Photo
from ..pose.pose import Pose
from ..regions.surface_region import SurfaceRegion
from ..scans.read import read_scan_job
from ..scans.scan import Scan
from ..settings import ScanSettings, TextureSettings
from .digest import file_digest
from .entries import PhotoEntry, Project
from .provenance import local_translation, provenance, write_photo_per_face, write_provenance
from .stages.cloud import ColouredCloud, check_cloud, colour_cloud_job, write_coloured_cloud
from .stages.colour_chart import ChartResult, correction_for, read_chart_job
from .stages.exported import cameras_path, check_exportable, solved_cameras, write_cameras
from .stages.models import layer_ending, models_job, output_path
from .stages.photo_pose import PhotoPose
from .stages.placing import place_cameras
from .stages.point_poses import PointsEntry, solve_points_job
from .stages.poses import solve_poses_job
from .stages.refinement import RefineSettings, refine_poses_job, view_of, with_lenses
from .stages.simplified import SimplifiedModel
from .stages.surfaces import check_partners, opening_regions, region_faces, surface_regions
from .stages.telephoto import pose_telephoto_job
from .stages.textures import TexturedScan, settings_among, texture_layers_job
from .store import Store

Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class ProjectResult:
    """What a run has found. All coordinates are local to the scan: world = local + `scan.offset`.

    `poses` has one result per photo of `project.photos`; `region_faces` the scan's faces of every region;
    `provenance` is what the JSON file beside the output says; `seconds` the time of every stage. `layers` has
    the texture of every set of photos by its name; `textured` is that of the photos without a `layer`, else
    the first one. `charts` has the colour chart of every layer that names one, `simplified` the layers'
    simplified models. A point cloud has no texture: `textured` is None, and `clouds` has the coloured points
    of every layer.
    """

    project: Project
    scan: Scan
    region_faces: dict[str, IntArray]
    surfaces: dict[str, SurfaceRegion]
    poses: list[PhotoPose]
    textured: TexturedScan | None
    provenance: dict[str, Any]
    seconds: dict[str, float]
    occluders: tuple[Scan, ...] = ()
    layers: dict[str, TexturedScan] = field(default_factory=dict)
    charts: dict[str, ChartResult] = field(default_factory=dict)
    simplified: dict[str, SimplifiedModel] = field(default_factory=dict)
    clouds: dict[str, ColouredCloud] = field(default_factory=dict)

    @property
    def photos(self) -> list[Photo]:
        """Photos of the project, in the order of `poses`."""
        return [entry.photo for entry in self.project.photos]


def run_project(project: Project, versions: Mapping[str, str] | None = None) -> ProjectResult:
    """Run `run_project_job` to its end."""
    return drain(run_project_job(project, versions))


def run_project_job(project: Project, versions: Mapping[str, str] | None = None) -> Job[ProjectResult]:
    """Solve the poses of a project and texture its scan.

    Writes models, cameras, the photo per face and the provenance into the output folder; what else is wanted
    is made from the result. `versions` of programs beside this one go into the provenance. All input is
    checked before the output folder is touched; finished work is kept in its folder `cache` and taken over by
    the next run when its inputs are unchanged. Raises the FrescoError that says what is wrong.
    """
    clock: dict[str, float] = {}
    _check_texturable(project)
    photos = [entry.photo for entry in project.photos]
    _told(project, "output.cameras", check_exportable, photos, project.output.cameras)
    digests = yield from part(_timed(check_inputs_job(project), clock, "check"), 0.0, 0.04)
    charts = yield from part(charts_job(project), 0.04, 0.05)
    scan, occluders = yield from part(_timed(read_scans_job(project), clock, "scan"), 0.05, 0.15)
    if scan.is_cloud:
        check_cloud(project, scan)
    faces = region_faces(project, scan)
    surfaces = surface_regions(scan, faces) | opening_regions(project, scan)
    check_partners(project, surfaces)
    _check_writable(project)
    store = Store(project.output.folder / "cache")
    poses = yield from part(_timed(_pose_job(project, scan, surfaces, store), clock, "poses"), 0.15, 0.35)
    if project.refine != RefineSettings():
        job = _timed(_refine_job(project, scan, poses, store), clock, "refinement")
        poses = yield from part(job, 0.35, 0.55)
        project = _with_lenses(project, poses)
    layers: dict[str, TexturedScan] = {}
    clouds: dict[str, ColouredCloud] = {}
    simplified: dict[str, SimplifiedModel] = {}
    if scan.is_cloud:
        colour_job = _cloud_job(project, scan, poses, charts)
        clouds = yield from part(_timed(colour_job, clock, "colours"), 0.55, 1.0)
    else:
        texture_job = _texture_job(project, scan, poses, occluders, store)
        layers = yield from part(_timed(texture_job, clock, "texture"), 0.55, 0.9)
        models = models_job(project, scan, layers, store, charts, occluders)
        simplified = yield from part(_timed(models, clock, "models"), 0.9, 1.0)
    textured = layers.get("") or next(iter(layers.values()), None)
    record = provenance(project, digests, scan, poses, textured, clock, layers, versions or {})
    record["clouds"] = {name: {"coverage": cloud.coverage} for name, cloud in clouds.items()}
    record["colour_charts"] = {name: chart.told for name, chart in charts.items()}
    record["simplified"] = {name: model.told for name, model in simplified.items()}
    for name, of_layer in layers.items():
        write_photo_per_face(output_path(project, layer_ending(name, "_faces.npz")), scan, of_layer)
    write_provenance(output_path(project, "_provenance.json"), record)
    _write_cameras(project, scan, poses)
    hiding = tuple(occluders)
    found = (layers, charts, simplified, clouds)
    return ProjectResult(project, scan, faces, surfaces, poses, textured, record, clock, hiding, *found)


def _write_cameras(project: Project, scan: Scan, poses: list[PhotoPose]) -> None:
    """Write the solved cameras for the programs that are asked for."""
    for file_format in project.output.cameras:
        path = cameras_path(project.output.folder, project.output.name, file_format)
        write_cameras(path, solved_cameras([e.photo for e in project.photos], poses, scan), file_format)


def charts_job(project: Project) -> Job[dict[str, ChartResult]]:
    """Read the colour chart of every layer; one that is not found is refused before anything is computed."""
    found = {}
    for entry in project.charts:
        try:
            found[entry.layer] = yield from read_chart_job(entry)
        except PhotoError as error:
            raise ProjectError(project.path, "colour_chart", str(error)) from error
    return found


def _check_texturable(project: Project) -> None:
    """Refuse a project whose photos may all be posed but not used: it would find out at the very end."""
    if all(entry.use == "pose" for entry in project.photos):
        reason = 'all photos have "pose", so none gives texture; write use = "texture" for those that may'
        raise ProjectError(project.path, "photo.use", reason)


def _timed(job: Job[Result], clock: dict[str, float], stage: str) -> Job[Result]:
    """Run a job and note its seconds, without the time its caller takes between the steps."""
    spent, start = 0.0, time.perf_counter()
    try:
        while True:
            try:
                progress = next(job)
            except StopIteration as stop:
                clock[stage] = spent + time.perf_counter() - start
                result: Result = stop.value
                return result
            spent += time.perf_counter() - start
            yield progress
            start = time.perf_counter()
    finally:
        job.close()


def check_inputs_job(project: Project) -> Job[dict[Path, str]]:
    """Read every input file once: photos have to be complete, masks to fit and not to be empty.

    Returns the fingerprint of every file. Raises ProjectError.
    """
    digests: dict[Path, str] = {}
    others = [project.path, project.scan.path, *project.scan.occluders, *_camera_files(project)]
    others += [chart.photo for chart in project.charts]
    others += [project.points.path] if project.points is not None else []
    others += [project.regions.kept] if project.regions.kept is not None else []
    for path in [*others, *(source.path for source in project.regions.labels)]:
        yield Progress(0.0, f"Checking {path.name}")
        digests[path] = _told(project, "scan", file_digest, path)
    for number, entry in enumerate(project.photos):
        yield Progress(number / len(project.photos), f"Checking {entry.photo.name}")
        data = _told(project, "photo.path", entry.photo.path.read_bytes)
        _told(project, "photo.path", check_complete, entry.photo.path, data)
        digests[entry.photo.path] = file_digest(entry.photo.path, data)
        for path in _check_masks(project, entry):
            digests[path] = file_digest(path)
    return digests


def _camera_files(project: Project) -> list[Path]:
    """Files that cameras were imported from."""
    if project.cameras is None:
        return []
    path = project.cameras.path
    files = [path] if path.is_file() else sorted(file for file in path.iterdir() if file.is_file())
    return [*files, *(project.cameras.points or ())]


def _check_masks(project: Project, entry: PhotoEntry) -> list[Path]:
    """Decode the masks of a photo; return their files."""
    camera = entry.photo.camera
    for mark in entry.photo.regions:
        _told(project, "photo.regions", mark.read_mask, camera.width, camera.height)
        _told(project, "photo.regions", mark.read_hidden, camera.width, camera.height)
    _told(project, "photo.mask", entry.photo.read_mask)
    files = [path for mark in entry.photo.regions for path in (mark.path, mark.hidden_path)]
    paths = [path for path in files if path is not None]
    return paths if entry.photo.mask is None else [*paths, entry.photo.mask]


def _told(project: Project, key: str, read: Callable[..., Result], *arguments: Any) -> Result:
    """Return what `read` returns; what it complains about is told with the project file and key."""
    try:
        return read(*arguments)
    except (FrescoError, OSError) as error:
        raise ProjectError(project.path, key, str(error)) from error


def read_scans_job(project: Project) -> Job[tuple[Scan, list[Scan]]]:
    """Read the scan and its occluders, which get the same offset."""
    files = [project.scan.path, *project.scan.occluders]
    job = _scan_job(project, "scan.path", files[0], project.scan.settings)
    scan = yield from part(job, 0.0, 1 / len(files))
    settings = ScanSettings(**{**vars(project.scan.settings), "offset": tuple(scan.offset.tolist())})
    occluders = []
    for number, path in enumerate(files[1:], 1):
        job = _scan_job(project, "scan.occluders", path, settings)
        occluders.append((yield from part(job, number / len(files), (number + 1) / len(files))))
    return scan, occluders


def _scan_job(project: Project, key: str, path: Path, settings: ScanSettings) -> Job[Scan]:
    """Read a scan; what is wrong with its file is told as any other wrong input is."""
    try:
        scan: Scan = yield from read_scan_job(path, settings)
    except ScanError as error:
        raise ProjectError(project.path, key, str(error)) from error
    return scan


def _check_writable(project: Project) -> None:
    """Find out before the long computation whether its result can be kept. Raises OutputError."""
    folder = project.output.folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise output_error(folder, error) from error


def _pose_job(
    project: Project, scan: Scan, surfaces: dict[str, SurfaceRegion], store: Store
) -> Job[list[PhotoPose]]:
    """Pose of every photo, given or solved. Raises PoseNotFound when no photo has one."""
    by_poses = project.cameras is not None and project.cameras.placing == "poses"
    unknown = [
        entry.photo
        for entry in project.photos
        if entry.pose is None and (entry.imported is None or (by_poses and entry.photo.regions))
    ]
    solved: list[PhotoPose] = yield from solve_poses_job(unknown, surfaces, project.pose, project.up, store)
    by_name = {result.photo: result for result in solved}
    by_name |= {entry.photo.name: _given(entry, scan) for entry in project.photos if entry.pose is not None}
    if project.cameras is not None:
        by_name |= place_cameras(project.cameras, project.photos, by_name, scan)
    poses = [by_name[entry.photo.name] for entry in project.photos]
    if project.points is not None:
        poses = yield from _points_job(project, project.points, poses, scan, store)
    shots = {e.photo.name for e in project.photos if e.telephoto and e.pose is None and e.imported is None}
    if shots:
        poses = yield from pose_telephoto_job(scan, [e.photo for e in project.photos], poses, shots)
    if not any(pose.solved for pose in poses):
        reasons = "\n".join(" ".join([f"{pose.photo}: {pose.failure}", *pose.notes]) for pose in poses[:5])
        raise PoseNotFound(f"None of the {len(poses)} photos found its place.\n{reasons}")
    return poses


def _points_job(
    project: Project, entry: PointsEntry, poses: list[PhotoPose], scan: Scan, store: Store
) -> Job[list[PhotoPose]]:
    """Poses from points, of all photos but those whose pose is given."""
    chosen = [number for number, photo in enumerate(project.photos) if photo.pose is None]
    photos = [project.photos[number].photo for number in chosen]
    picks = [project.photos[number].picks for number in chosen]
    before = [poses[number] for number in chosen]
    found = yield from solve_points_job(photos, picks, before, entry, scan.offset, store)
    return [dict(zip(chosen, found, strict=True)).get(n, pose) for n, pose in enumerate(poses)]


def _refine_job(project: Project, scan: Scan, poses: list[PhotoPose], store: Store) -> Job[list[PhotoPose]]:
    held = {entry.photo.name for entry in project.photos if not entry.refine}
    photos = [entry.photo for entry in project.photos]
    return refine_poses_job(scan, photos, poses, project.refine, held, store)


def _with_lenses(project: Project, poses: list[PhotoPose]) -> Project:
    """The project with the lenses that refinement has adjusted, which all that follows uses."""
    photos = with_lenses([entry.photo for entry in project.photos], poses)
    entries = zip(project.photos, photos, strict=True)
    return replace(project, photos=tuple(replace(entry, photo=photo) for entry, photo in entries))


def _given(entry: PhotoEntry, scan: Scan) -> PhotoPose:
    """Return the pose that the project file gives, in local coordinates; its uncertainty is not known."""
    assert entry.pose is not None
    rotation, translation = entry.pose
    local = local_translation(rotation, translation, scan.offset)
    return PhotoPose(entry.photo.name, Pose(rotation, local, np.full((6, 6), np.nan)), given=True)


def _used(project: Project, poses: list[PhotoPose]) -> list[tuple[PhotoEntry, PhotoPose]]:
    """Photos that have a pose and may be used for texture."""
    pairs = zip(project.photos, poses, strict=True)
    return [(entry, result) for entry, result in pairs if entry.use == "texture" and result.solved]


def _texture_settings(project: Project, used: list[tuple[PhotoEntry, PhotoPose]]) -> TextureSettings:
    """The project's settings, which count all its photos, for those that are used."""
    names = [entry.photo.name for entry in project.photos]
    return settings_among(project.texture, [names.index(entry.photo.name) for entry, _ in used])


def _cloud_job(
    project: Project, scan: Scan, poses: list[PhotoPose], charts: Mapping[str, ChartResult]
) -> Job[dict[str, ColouredCloud]]:
    """Colour the points of a cloud from every layer, and write them."""
    used = _used(project, poses)
    views = [view_of(entry.photo, result) for entry, result in used]
    settings, layers = _texture_settings(project, used), [entry.layer for entry, _ in used]
    clouds = yield from colour_cloud_job(scan, views, layers, settings)
    entries = {entry.layer: entry for entry in project.charts}
    for name, cloud in clouds.items():
        path = output_path(project, layer_ending(name, "_colours.ply"))
        true = correction_for(charts[name], entries[name], cloud) if name in charts else None
        write_coloured_cloud(path, cloud, scan.offset, true)
    return clouds


def _texture_job(
    project: Project, scan: Scan, poses: list[PhotoPose], occluders: list[Scan], store: Store
) -> Job[dict[str, TexturedScan]]:
    """Texture every layer from the photos that have a pose and may be used for it."""
    used = _used(project, poses)
    return texture_layers_job(
        scan,
        [view_of(entry.photo, result) for entry, result in used],
        [entry.layer for entry, _ in used],
        _texture_settings(project, used),
        occluders,
        store,
        [entry.priority for entry, _ in used],
    )
