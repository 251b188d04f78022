"""A project in the scene: scan, regions, photos with masks, settings; and what a run has found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np

from ...core.arrays import ByteArray, IntArray
from ...core.cameras import PerspectiveCamera
from ...core.errors import ProjectError
from ...core.jobs import Job, part
from ...core.photos import Photo
from ...core.photos.position import read_position
from ...core.project import Project, ProjectResult
from ...core.project.entries import OutputEntry, PhotoEntry, RegionEntries, ScanEntry
from ...core.project.stages.colour_chart import ChartResult, ColourChartEntry
from ...core.project.stages.delivery import DeliverySettings
from ...core.project.stages.point_poses import PointsEntry, read_points
from ...core.project.stages.refinement import RefineSettings
from ...core.project.stages.surfaces import opening_regions
from ...core.regions import SurfaceRegion
from ...core.scans import Scan
from ...core.settings import (
    EdgeSettings,
    JointSettings,
    PointSettings,
    PoseSettings,
    ScanSettings,
    TextureSettings,
)
from ..settings import from_core, to_core
from . import delivery, photos, points, regions, scans
from .images import load_mask
from .previews import preview_job
from .texture import show_layers
from .world import read_offset

Previews = Mapping[str, ByteArray | None]


@dataclass(frozen=True, eq=False)
class OpenedProject:
    """A project read for the scene, before anything is solved."""

    project: Project
    scan: Scan
    region_faces: Mapping[str, IntArray]
    previews: Previews
    occluders: Sequence[Scan] = ()
    charts: Mapping[str, ChartResult] = field(default_factory=dict)


def previews_job(project: Project, size: int) -> Job[Previews]:
    """Make the undistorted backgrounds of all photos, by name; None for photos that need none."""
    previews: dict[str, ByteArray | None] = {}
    count = len(project.photos)
    for number, entry in enumerate(project.photos):
        job = preview_job(entry.photo.path, entry.photo.camera, size)
        previews[entry.photo.name] = yield from part(job, number / count, (number + 1) / count)
    return previews


def clear_scene(scene: bpy.types.Scene) -> None:
    """Take photos, regions and the scan out of Fresco's lists, and their cameras out of the scene."""
    fresco = scene.fresco
    for photo in fresco.photos:
        photos.remove_camera(photo)
    for obj in [*scans.occluder_objects(scene), *([fresco.scan] if fresco.scan else [])]:
        mesh = obj.data
        bpy.data.objects.remove(obj)
        if mesh.users == 0:
            bpy.data.meshes.remove(mesh)
    fresco.photos.clear()
    fresco.regions.clear()
    fresco.texture_report = fresco.texture_warnings = fresco.scan_report = fresco.scan_path = ""


def show_project(context: bpy.types.Context, opened: OpenedProject) -> None:
    """Replace what Fresco has in the scene by a project."""
    project, fresco = opened.project, context.scene.fresco
    clear_scene(context.scene)
    scans.show_scan(context, opened.scan, opened.region_faces)
    show_openings(context.scene, project, opened.scan)
    scans.show_occluders(context, opened.occluders)
    for entry in project.photos:
        item = show_photo(context, entry.photo, opened.previews[entry.photo.name])
        item.use_texture = entry.use == "texture"
        if entry.pose is not None:
            photos.write_world_pose(context.scene, item, *entry.pose)
            item.state = "GIVEN"
        item.hold = not entry.refine
        item.layer, item.priority = entry.layer, entry.priority
    from_core(fresco.scan_settings, project.scan.settings)
    from_core(fresco.pose, project.pose)
    from_core(fresco.edges, project.refine.edges or EdgeSettings())
    from_core(fresco.joint, project.refine.joint or JointSettings())
    fresco.compare.lenses = project.refine.lenses
    from_core(fresco.texture, project.texture)
    show_points(context.scene, project, opened.scan)
    delivery.show_settings(context.scene, project.atlas or DeliverySettings(), project.simplify)
    fresco.delivery.charts_json = ""
    for entry in project.charts:
        delivery.write_chart(context.scene, entry, opened.charts[entry.layer])
    output = project.output
    fresco.export.folder, fresco.export.name = str(output.folder.resolve()), output.name
    fresco.export.write_glb, fresco.export.write_obj = output.glb, output.obj
    fresco.export.write_report, fresco.export.write_blend = output.report, output.blend
    fresco.photo_index = 0


def show_openings(scene: bpy.types.Scene, project: Project, scan: Scan) -> None:
    """Put a project's regions without faces into the list: openings, and those marked in photos only."""
    for name, surface in opening_regions(project, scan).items():
        regions.write_opening(scene, regions.named_region(scene, name), surface)
    for name in project.regions.unplaced:
        regions.named_region(scene, name)


def read_project(scene: bpy.types.Scene, path: Path) -> Project:
    """Return the scene as a project that is to be written to `path`; `ProjectError` if it cannot be one.

    Regions that have faces are not in it: `regions.keep_scan` tells where they lie.
    """
    fresco = scene.fresco
    if fresco.scan is None or not fresco.scan_path:
        raise ProjectError(path, "scan.path", "the scan was not read from a file: export it and import that")
    if not any(photo.use and photo.camera_json for photo in fresco.photos):
        raise ProjectError(path, "photo", "no photo is in use and calibrated: set the calibration first")
    survey = PointsEntry(path, settings=to_core(fresco.point_settings, PointSettings))
    charts = _charts(scene)
    return Project(
        path=path,
        scan=ScanEntry(Path(fresco.scan_path), to_core(fresco.scan_settings, ScanSettings)),
        regions=_region_entries(scene),
        photos=tuple(_photo_entry(scene, item) for item in fresco.photos),
        pose=to_core(fresco.pose, PoseSettings),
        up=None,
        refine=_refine_settings(scene),
        texture=to_core(fresco.texture, TextureSettings),
        output=_output_entry(scene, path),
        points=survey if len(fresco.points) else None,
        atlas=delivery.delivery_settings(scene) if charts or delivery.atlas_objects(scene) else None,
        simplify=delivery.simplify_settings(scene) if delivery.simplified_objects(scene) else None,
        charts=charts,
    )


def _charts(scene: bpy.types.Scene) -> tuple[ColourChartEntry, ...]:
    """Colour charts that what is baked follows."""
    layers = {item.layer.strip() for item in scene.fresco.photos if item.use}
    entries = [entry for entry, _ in delivery.read_charts(scene).values() if entry.layer in layers]
    return () if scene.fresco.delivery.untouched else tuple(entries)


def _refine_settings(scene: bpy.types.Scene) -> RefineSettings:
    """The refinements that the poses went through, for a run without a window to make them, too."""
    fresco = scene.fresco
    solutions = [photos.read_solution(scene, item) for item in fresco.photos if item.is_refined]
    made = {step.method for solved in solutions for step in solved.refinements}
    return RefineSettings(
        edges=to_core(fresco.edges, EdgeSettings) if "edges" in made else None,
        joint=to_core(fresco.joint, JointSettings) if "joint" in made else None,
        lenses="joint" in made and fresco.compare.lenses,
    )


def _region_entries(scene: bpy.types.Scene) -> RegionEntries:
    offset, outlines, unplaced = read_offset(scene), {}, []
    for region in scene.fresco.regions:
        if region.opening_json:
            corners, triangles = regions.read_opening(scene, region)
            outlines[region.name] = SurfaceRegion(corners, triangles, region.name).loops[0] + offset
        elif not region.is_on_scan:
            unplaced.append(region.name)
    return RegionEntries(outlines=outlines, unplaced=tuple(unplaced))


def _photo_entry(scene: bpy.types.Scene, item: photos.FrescoPhoto) -> PhotoEntry:
    if not item.use or not item.camera_json:
        camera = PerspectiveCamera(1, 1, np.eye(3))
        return PhotoEntry(Photo(Path(item.path), item.name, camera), use="none")
    pose = None
    if item.state == "GIVEN":
        rotation, translation, _ = photos.read_pose(scene, item)
        pose = rotation, translation - rotation @ read_offset(scene)
    return PhotoEntry(
        photos.read_photo(scene, item),
        use="texture" if item.use_texture else "pose",
        pose=pose,
        refine=not item.hold,
        layer=item.layer,
        priority=item.priority,
        picks=points.read_picks(item),
    )


def _output_entry(scene: bpy.types.Scene, path: Path) -> OutputEntry:
    export = scene.fresco.export
    beside_blend = export.folder.startswith("//") and not bpy.data.filepath
    folder = path.parent / "output" if beside_blend else Path(bpy.path.abspath(export.folder))
    wanted = export.write_blend, export.write_glb, export.write_obj, export.write_report
    return OutputEntry(folder, export.name.strip() or path.stem, *wanted)


def show_points(scene: bpy.types.Scene, project: Project, scan: Scan) -> None:
    """Put a project's surveyed points and what was picked of them into the scene."""
    scene.fresco.points.clear()
    if project.points is None:
        return
    survey = read_points(project.points, scan.offset)
    for name, place in zip(survey.names, survey.points, strict=True):
        points.write_point(scene, name, place)
    from_core(scene.fresco.point_settings, project.points.settings)
    for entry in project.photos:
        for name, pixel in entry.picks.items():
            points.write_pick(scene.fresco.photos[entry.photo.name], name, pixel)


def show_photo(context: bpy.types.Context, photo: Photo, preview: ByteArray | None) -> photos.FrescoPhoto:
    """Add one of a project's photos with its marks; a mark that is a polygon becomes a mask in the .blend."""
    item = photos.add_photo(context, photo.path.resolve(), photo.name)
    photos.write_camera(context, item, photo.camera, photo.camera_source, preview)
    item.message = " ".join(note for note in photo.notes if note != photo.camera_source)
    position = read_position(photo.path, photo.exif)
    item.place_told = "" if position is None else position.said
    if photo.mask is not None:
        item.mask = load_mask(photo.mask.resolve())
    for mark in photo.regions:
        region = regions.named_region(context.scene, mark.name)
        regions.write_mark(item, region, mark, (photo.camera.width, photo.camera.height))
    return item


def show_result(context: bpy.types.Context, result: ProjectResult, previews: Previews) -> None:
    """Show what a run has found: the project, its poses, its texture."""
    opened = OpenedProject(
        result.project, result.scan, result.region_faces, previews, result.occluders, result.charts
    )
    show_project(context, opened)
    items = context.scene.fresco.photos
    for solved in result.poses:
        photos.write_solution(context.scene, items[solved.photo], solved)
        for point in solved.points:
            points.write_pick(items[solved.photo], point.name, point.pixel)
        points.write_residuals(items[solved.photo], solved)
    show_layers(context.scene, result.layers)
    for model in result.simplified.values():
        delivery.show_simplified(context, model)
