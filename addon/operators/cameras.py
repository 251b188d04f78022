"""Cameras from and to other programs, in the menus File > Import and File > Export."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy

from ...core.cameras.exchange import PosedCamera
from ...core.errors import CameraError
from ...core.jobs import Job, Progress, part
from ...core.pose import Pose
from ...core.project import PhotoPose
from ...core.project.imported import ImportedCameras, match_photos, read_cameras
from ...core.project.stages.exported import FORMATS, solved_cameras, write_cameras
from ...core.project.stages.placing import place, unsure
from ...core.scans import Scan
from ..bridge import photos as bridge
from ..bridge.previews import preview_job
from ..bridge.scans import read_scan
from ..jobs import JobOperator, StepOperator
from ..preferences import preview_size
from .photos import OpenedPhoto
from .regions import has_scan

ENDINGS = ("*.xml", "*.csv", "*.xmp", "*.out", "*.nvm", "*.json", "*.sfm", "*.bin", "*.txt")
NAMES = {
    "colmap": ("COLMAP (text)", "Folder with cameras.txt, images.txt, points3D.txt"),
    "colmap-binary": ("COLMAP (binary)", "Folder with cameras.bin, images.bin, points3D.bin"),
    "metashape": ("Metashape (.xml)", "Cameras of Agisoft Metashape"),
    "realityscan-xmp": ("RealityScan (.xmp)", "Folder with one XMP file per photo"),
    "realityscan-csv": ("RealityScan (.csv)", "Internal and external camera parameters in one table"),
    "bundler": ("Bundler (.out)", "bundle.out with list.txt beside it"),
}
PROGRAMS = [(name, *NAMES[name]) for name in FORMATS]


@dataclass(frozen=True, eq=False)
class TakenCameras:
    """What an import has found, by the photo's name: its poses on the scan, its opened photo."""

    poses: dict[str, PhotoPose]
    opened: dict[str, OpenedPhoto]


class FRESCO_OT_import_cameras(JobOperator):
    bl_idname = "fresco.import_cameras"
    bl_label = "Import Cameras"
    bl_description = (
        "Take lenses and poses of the photos in the list from COLMAP, Metashape, RealityScan, Bundler, NVM, "
        "OpenMVG or AliceVision"
    )
    bl_options = {"UNDO"}
    step = "photos"

    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: bpy.props.StringProperty(default=";".join(ENDINGS), options={"HIDDEN"})
    placing: bpy.props.EnumProperty(
        name="Onto the scan",
        items=[
            ("same", "Same World", "The other program's coordinates are those of the scan's file"),
            ("poses", "By Solved Photos", "Three or more of the photos have a pose on the scan already"),
            ("surface", "By Surface", "Its sparse points are laid onto the scan, from nearly the same world"),
        ],
    )
    lenses: bpy.props.BoolProperty(
        name="Take lenses", default=True, description="Take the calibration, too, not only the poses"
    )

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_scan(cls, context):
            return False
        cls.poll_message_set("Import the photos first (step 2)")
        return context.mode == "OBJECT" and len(context.scene.fresco.photos) > 0

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return super().invoke(context, event) if self.filepath else self.choose_file(context)

    def start(self, context: bpy.types.Context) -> Job[TakenCameras]:
        scene = context.scene
        context.view_layer.update()
        items = list(scene.fresco.photos)
        path = reconstruction_path(Path(bpy.path.abspath(self.filepath)))
        files = [Path(item.path) for item in items]
        imported = ImportedCameras(path, read_cameras(path, files), self.placing)
        found = {items[n].name: c for n, c in match_photos(imported.reconstruction, files).items()}
        if not found:
            names = ", ".join(camera.name for camera in imported.reconstruction.cameras[:3])
            raise CameraError(f"{path}: none of its photos is in the list; its names are {names}, …")
        known = {
            item.name: bridge.read_solution(scene, item).pose
            for item in items
            if item.is_posed and item.camera is not None
        }
        paths = {item.name: Path(item.path) for item in items}
        scan = read_scan(scene)
        return take_job(imported, found, known, scan, paths, preview_size(context) if self.lenses else 0)

    def finish(self, context: bpy.types.Context, result: TakenCameras) -> None:
        items = context.scene.fresco.photos
        for name, opened in result.opened.items():
            bridge.write_camera(context, items[name], opened.camera, opened.note, opened.preview)
        for name, pose in result.poses.items():
            bridge.write_solution(context.scene, items[name], pose)
        missing = len(items) - len(result.poses)
        self.report({"INFO"}, f"{len(result.poses)} photos have their cameras")
        if missing:
            self.warn(
                context, f"{missing} of {len(items)} photos are not in the file; they stay as they are."
            )


def reconstruction_path(path: Path) -> Path:
    """Return what a chosen file stands for: the files of a COLMAP model mean their folder."""
    return path.parent if path.suffix.lower() in {".bin", ".txt"} and path.is_file() else path


def take_job(
    imported: ImportedCameras,
    found: dict[str, PosedCamera],
    known: dict[str, Pose],
    scan: Scan,
    paths: dict[str, Path],
    size: int,
) -> Job[TakenCameras]:
    """Bring imported cameras onto the scan and make the photos' backgrounds; `size` 0 keeps their lenses."""
    yield Progress(0.0, "Placing the cameras on the scan")
    cameras = {name: (camera.rotation, camera.translation) for name, camera in found.items()}
    placed = place(imported, cameras, known, scan)
    poses = {name: unsure(name, placed, *pose) for name, pose in cameras.items()}
    opened = {}
    for number, (name, posed) in enumerate(found.items() if size else ()):
        span = 0.1 + 0.9 * number / len(found), 0.1 + 0.9 * (number + 1) / len(found)
        preview = yield from part(preview_job(paths[name], posed.camera, size), *span)
        opened[name] = OpenedPhoto(paths[name], posed.camera, f"Imported from {imported.path.name}.", preview)
    return TakenCameras(poses, opened)


class FRESCO_OT_export_cameras(StepOperator):
    bl_idname = "fresco.export_cameras"
    bl_label = "Export Cameras"
    bl_description = "Write lenses and poses of all placed photos for another program, in true coordinates"
    step = "photos"

    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    file_format: bpy.props.EnumProperty(name="Program", items=PROGRAMS, default="colmap")

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_scan(cls, context):
            return False
        cls.poll_message_set("No photo has a pose yet")
        return any(photo.is_posed and photo.camera for photo in context.scene.fresco.photos)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def run(self, context: bpy.types.Context) -> None:
        scene = context.scene
        context.view_layer.update()
        items = [photo for photo in scene.fresco.photos if photo.is_posed and photo.camera]
        poses = [bridge.read_solution(scene, item) for item in items]
        cameras = solved_cameras([bridge.read_photo(scene, item) for item in items], poses, read_scan(scene))
        path = Path(bpy.path.abspath(self.filepath))
        write_cameras(path, cameras, self.file_format)
        self.report({"INFO"}, f"{len(items)} cameras written to {path}")


def _draw_import(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.operator("fresco.import_cameras", text="Cameras for Fresco (COLMAP, Metashape, …)")


def _draw_export(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.operator("fresco.export_cameras", text="Cameras of Fresco (COLMAP, Metashape, …)")


def attach() -> None:
    """Put the operators into Blender's menus."""
    bpy.types.TOPBAR_MT_file_import.append(_draw_import)
    bpy.types.TOPBAR_MT_file_export.append(_draw_export)


def detach() -> None:
    """Take them out of the menus."""
    bpy.types.TOPBAR_MT_file_import.remove(_draw_import)
    bpy.types.TOPBAR_MT_file_export.remove(_draw_export)


CLASSES = (FRESCO_OT_import_cameras, FRESCO_OT_export_cameras)
