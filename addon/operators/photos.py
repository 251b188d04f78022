"""Bring photos into the scene, give them a calibration, look through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from ...core.arrays import ByteArray
from ...core.cameras import Camera
from ...core.errors import CameraError, PhotoError
from ...core.jobs import Job, Progress, part
from ...core.photos import (
    SUFFIXES,
    check_complete,
    open_photo,
)
from ...core.photos.exif import read_exif
from ...core.photos.position import read_position
from ..bridge import photos as bridge
from ..bridge.previews import preview_job
from ..jobs import JobOperator, StepOperator
from ..preferences import preview_size


@dataclass(frozen=True, eq=False)
class OpenedPhoto:
    """A photo read for the scene; without a camera `note` says what is missing."""

    path: Path
    camera: Camera | None
    note: str
    preview: ByteArray | None = None
    place: str = ""


@dataclass(frozen=True, eq=False)
class OpenedPhotos:
    """Photos that could be read, and a sentence for each one that could not."""

    photos: list[OpenedPhoto]
    refused: list[str]


def sentence(text: str) -> str:
    """Return a text as a sentence: with a capital and a full stop."""
    return text[:1].upper() + text[1:].rstrip(".") + "."


def open_photo_job(path: Path, size: int) -> Job[OpenedPhoto]:
    """Check a photo, make its camera from EXIF and its background. Raises PhotoError."""
    yield Progress(0.0, f"Opening {path.name}")
    check_complete(path)
    position = read_position(path, read_exif(path))
    place = "" if position is None else position.said
    try:
        photo = open_photo(path)
    except CameraError as error:
        return OpenedPhoto(path, None, sentence(str(error)), place=place)
    preview = yield from preview_job(path, photo.camera, size)
    return OpenedPhoto(path, photo.camera, " ".join(photo.notes), preview, place)


def open_photos_job(paths: Sequence[Path], size: int) -> Job[OpenedPhotos]:
    """Open all photos; those that cannot be read are told, not fatal."""
    opened: list[OpenedPhoto] = []
    refused: list[str] = []
    for number, path in enumerate(paths):
        try:
            job = open_photo_job(path, size)
            opened.append((yield from part(job, number / len(paths), (number + 1) / len(paths))))
        except PhotoError as error:
            refused.append(str(error))
    if not opened:
        raise PhotoError(refused[0])
    return OpenedPhotos(opened, refused)


class PhotoImport(JobOperator):
    """Mixin: photos become cameras."""

    step = "photos"

    def paths(self) -> list[Path]:
        """Return the files to import, sorted by name."""
        raise NotImplementedError

    def start(self, context: bpy.types.Context) -> Job[Any]:
        known = {Path(photo.path) for photo in context.scene.fresco.photos}
        paths = [path for path in self.paths() if path not in known]
        if not paths:
            raise PhotoError("There is no new photo here: these are in the list already.")
        return open_photos_job(paths, preview_size(context))

    def finish(self, context: bpy.types.Context, result: OpenedPhotos) -> None:
        for opened in result.photos:
            item = bridge.add_photo(context, opened.path, opened.path.stem)
            item.camera_source, item.place_told = opened.note, opened.place
            if opened.camera is not None:
                bridge.write_camera(context, item, opened.camera, opened.note, opened.preview)
        fresco = context.scene.fresco
        fresco.photo_index = len(fresco.photos) - len(result.photos)
        self.report({"INFO"}, f"{len(result.photos)} photos imported")
        if result.refused:
            count = len(result.refused)
            self.warn(
                context, f"{count} of {count + len(result.photos)} photos left out: {result.refused[0]}"
            )


class FRESCO_OT_import_photos(PhotoImport):
    bl_idname = "fresco.import_photos"
    bl_label = "Import Photos"
    bl_description = "Choose photos; each becomes a camera with the photo as its background"
    bl_options = {"UNDO"}

    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    files: bpy.props.CollectionProperty(
        type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"}
    )
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{suffix}" for suffix in SUFFIXES), options={"HIDDEN"}
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.files or self.filepath:  # dropped into the window
            return super().invoke(context, event)
        return self.choose_file(context)

    def paths(self) -> list[Path]:
        names = sorted(file.name for file in self.files if file.name)
        if names:
            return [Path(bpy.path.abspath(self.directory)) / name for name in names]
        return [Path(bpy.path.abspath(self.filepath))]


class FRESCO_OT_import_photo_folder(PhotoImport):
    bl_idname = "fresco.import_photo_folder"
    bl_label = "Import Folder of Photos"
    bl_description = "Choose a folder; every photo in it becomes a camera"
    bl_options = {"UNDO"}

    directory: bpy.props.StringProperty(name="Folder", subtype="DIR_PATH")
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})

    def paths(self) -> list[Path]:
        folder = Path(bpy.path.abspath(self.directory))
        if not folder.is_dir():
            raise PhotoError(f"{folder}: there is no such folder")
        found = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
        if not found:
            raise PhotoError(f"{folder}: there is no photo in this folder ({', '.join(SUFFIXES)})")
        return found

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return self.choose_file(context)


class FRESCO_OT_remove_photo(StepOperator):
    bl_idname = "fresco.remove_photo"
    bl_label = "Remove Photo"
    bl_description = "Take the chosen photo and its camera out of the scene; its file stays"
    bl_options = {"UNDO"}
    step = "photos"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Choose a photo in the list")
        return context.scene.fresco.active_photo is not None

    def run(self, context: bpy.types.Context) -> None:
        fresco = context.scene.fresco
        bridge.remove_camera(fresco.active_photo)
        fresco.photos.remove(fresco.photo_index)
        fresco.photo_index = max(0, min(fresco.photo_index, len(fresco.photos) - 1))


class FRESCO_OT_look_through(StepOperator):
    bl_idname = "fresco.look_through"
    bl_label = "Look Through"
    bl_description = "Look at the scan through this photo's camera"
    bl_options = {"UNDO"}
    step = "photos"

    index: bpy.props.IntProperty(default=-1, options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Import photos first")
        return len(context.scene.fresco.photos) > 0

    def run(self, context: bpy.types.Context) -> None:
        fresco = context.scene.fresco
        if 0 <= self.index < len(fresco.photos):
            fresco.photo_index = self.index
        photo = fresco.active_photo
        if photo.camera is None:
            raise PhotoError(f"{photo.name}: its camera was deleted. Remove the photo and import it again.")
        bridge.frame_photo(context.scene, photo)
        space = context.space_data
        if space is not None and space.type == "VIEW_3D":
            space.region_3d.view_perspective = "CAMERA"
            space.lock_camera = False


class FRESCO_FH_photos(bpy.types.FileHandler):
    bl_idname = "FRESCO_FH_photos"
    bl_label = "Fresco photos"
    bl_import_operator = "fresco.import_photos"
    bl_file_extensions = ";".join(SUFFIXES)

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"


CLASSES = (
    FRESCO_OT_import_photos,
    FRESCO_OT_import_photo_folder,
    FRESCO_OT_remove_photo,
    FRESCO_OT_look_through,
    FRESCO_FH_photos,
)
