"""Mark regions: faces of the scan from the selection, patches of photos from mask files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...core.arrays import BoolArray
from ...core.errors import RegionError
from ...core.jobs import Job, Progress
from ...core.photos import RegionMark, check_mask, check_outline, image_size, read_mask
from ..bridge import meshes
from ..bridge import regions as bridge
from ..jobs import JobOperator, StepOperator
from ..properties import FrescoPhoto

MASK_SUFFIXES = (".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg")


@contextmanager
def object_mode(scan: bpy.types.Object) -> Iterator[None]:
    """Leave Edit Mode for a moment: attributes can only be read and written outside."""
    editing = scan.mode == "EDIT"
    if editing:
        bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        if editing:
            bpy.ops.object.mode_set(mode="EDIT")


def selected_faces(scan: bpy.types.Object) -> BoolArray:
    """Selected faces (or points of a cloud) of the scan, in Object Mode; `RegionError` if there are none."""
    selected = meshes.read_selected_faces(scan.data)
    if not selected.any():
        name = meshes.element_name(scan.data)
        raise RegionError(f"No {name} of the scan are selected: select some in Edit Mode.")
    return selected


def has_scan(cls: type, context: bpy.types.Context) -> bool:
    """Poll: there is a scan in this scene."""
    scan = context.scene.fresco.scan
    cls.poll_message_set("Import a scan first (step 1)")
    return scan is not None and scan.name in context.scene.objects


def has_faces(cls: type, context: bpy.types.Context) -> bool:
    """Poll: there is a scan with faces, not points only."""
    if not has_scan(cls, context):
        return False
    cls.poll_message_set("This needs faces, but the scan is a point cloud: mesh it in your scanning program")
    return not meshes.is_cloud(context.scene.fresco.scan.data)


class FRESCO_OT_region_from_selection(StepOperator):
    bl_idname = "fresco.region_from_selection"
    bl_label = "Region from Selected Faces"
    bl_description = "Make a region of the faces, or points of a cloud, that are selected in Edit Mode"
    bl_options = {"REGISTER", "UNDO"}
    step = "regions"

    name: bpy.props.StringProperty(
        name="Name", default="Region", description="As the region's masks are named"
    )

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        return has_scan(cls, context)

    def run(self, context: bpy.types.Context) -> None:
        scan = context.scene.fresco.scan
        with object_mode(scan):
            selected = selected_faces(scan)
            region = bridge.add_region(context.scene, self.name)
            bridge.write_faces(context.scene, region, selected)


def group_items(_self: object, context: bpy.types.Context) -> list[tuple[str, str, str, str, int]]:
    """Vertex groups and materials of the scan, as items of a menu."""
    scan = context.scene.fresco.scan
    if scan is None:
        return []
    items = [
        (f"G{group.index}", group.name, "Faces whose corners are all in this vertex group", "GROUP_VERTEX")
        for group in scan.vertex_groups
    ]
    items += [
        (f"M{number}", slot.name or f"Material {number + 1}", "Faces with this material", "MATERIAL")
        for number, slot in enumerate(scan.material_slots)
    ]
    group_items.kept = [(*item, number) for number, item in enumerate(items)]
    return group_items.kept


class FRESCO_OT_region_from_group(StepOperator):
    bl_idname = "fresco.region_from_group"
    bl_label = "Region from Group"
    bl_description = "Make a region of a vertex group's or a material's faces"
    bl_options = {"REGISTER", "UNDO"}
    step = "regions"

    source: bpy.props.EnumProperty(name="Faces of", items=group_items)

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_scan(cls, context):
            return False
        scan = context.scene.fresco.scan
        cls.poll_message_set("The scan has no vertex groups and no materials")
        return bool(scan.vertex_groups) or bool(scan.material_slots)

    def run(self, context: bpy.types.Context) -> None:
        scan, number = context.scene.fresco.scan, int(self.source[1:])
        with object_mode(scan):
            if self.source[0] == "G":
                name, inside = scan.vertex_groups[number].name, meshes.read_group_faces(scan, number)
            else:
                name = scan.material_slots[number].name or f"Material {number + 1}"
                slots = meshes.read_face_attribute(scan.data, "material_index")
                inside = np.full(meshes.element_count(scan.data), number == 0)
                inside = inside if slots is None else slots == number
            if not inside.any():
                raise RegionError(f"No face of the scan belongs to {name}.")
            bridge.write_faces(context.scene, bridge.add_region(context.scene, name), inside)


class RegionOperator(StepOperator):
    """Mixin: something done to the region chosen in the list."""

    bl_options = {"UNDO"}
    step = "regions"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_scan(cls, context):
            return False
        cls.poll_message_set("Choose a region in the list")
        return context.scene.fresco.active_region is not None


class FRESCO_OT_replace_region(RegionOperator):
    bl_idname = "fresco.replace_region"
    bl_label = "Set Faces"
    bl_description = "Replace the chosen region's faces by those selected on the scan"

    def run(self, context: bpy.types.Context) -> None:
        scan = context.scene.fresco.scan
        with object_mode(scan):
            selected = selected_faces(scan)
            bridge.write_faces(context.scene, context.scene.fresco.active_region, selected)


class FRESCO_OT_select_region(RegionOperator):
    bl_idname = "fresco.select_region"
    bl_label = "Select Faces"
    bl_description = "Select the chosen region's faces on the scan, in Edit Mode"

    def run(self, context: bpy.types.Context) -> None:
        fresco = context.scene.fresco
        scan = fresco.scan
        if context.object is not None and context.object.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        context.view_layer.objects.active = scan
        meshes.select_faces(scan.data, bridge.read_faces(context.scene, fresco.active_region))
        bpy.ops.object.mode_set(mode="EDIT")
        context.tool_settings.mesh_select_mode = (False, False, True)


class FRESCO_OT_duplicate_region(RegionOperator):
    bl_idname = "fresco.duplicate_region"
    bl_label = "Duplicate Region"
    bl_description = "Make another region with the same faces and marks, to change it and keep this one"

    def run(self, context: bpy.types.Context) -> None:
        with object_mode(context.scene.fresco.scan):
            bridge.duplicate_region(context.scene, context.scene.fresco.active_region)


class FRESCO_OT_remove_region(RegionOperator):
    bl_idname = "fresco.remove_region"
    bl_label = "Remove Region"
    bl_description = "Take the chosen region off the scan and out of all photos; mask files stay"

    def run(self, context: bpy.types.Context) -> None:
        with object_mode(context.scene.fresco.scan):
            bridge.remove_region(context.scene, context.scene.fresco.region_index)


class FRESCO_OT_remove_mask(RegionOperator):
    bl_idname = "fresco.remove_mask"
    bl_label = "Remove Mask"
    bl_description = "The chosen region is no longer marked in the chosen photo; the mask file stays"

    def run(self, context: bpy.types.Context) -> None:
        fresco = context.scene.fresco
        if fresco.active_photo is not None:
            bridge.remove_mark(fresco.active_photo, fresco.active_region)


class MaskImport(JobOperator):
    """Mixin: mask files mark regions in photos. A mask is named after its region."""

    step = "regions"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Import photos first (step 2)")
        return context.scene.fresco.active_photo is not None

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return self.choose_file(context)

    def finish(self, context: bpy.types.Context, result: CheckedMasks) -> None:
        photos = context.scene.fresco.photos
        for name, mark in result.marks:
            region = bridge.named_region(context.scene, mark.name)
            bridge.write_mark(photos[name], region, mark, result.sizes[name])
        self.report({"INFO"}, f"{len(result.marks)} masks loaded")


@dataclass(frozen=True, eq=False)
class CheckedMasks:
    """Masks that fit: (photo, mark) each, and the photos' sizes."""

    marks: list[tuple[str, RegionMark]]
    sizes: dict[str, tuple[int, int]]


def check_masks_job(files: dict[str, Path], masks: list[tuple[str, Path]]) -> Job[CheckedMasks]:
    """Check mask files, (photo, mask file) each; `files` are the photos' files. Raises RegionError."""
    sizes = {name: image_size(path) for name, path in files.items()}
    checked = CheckedMasks([], sizes)
    for number, (photo, path) in enumerate(masks):
        yield Progress(number / len(masks), f"Checking {path.name}")
        mask = read_mask(path)
        check_mask(mask, *sizes[photo], str(path))
        check_outline(mask, str(path))
        checked.marks.append((photo, RegionMark(path.stem, path)))
    return checked


class FRESCO_OT_import_masks(MaskImport):
    bl_idname = "fresco.import_masks"
    bl_label = "Masks for This Photo"
    bl_description = (
        "Choose mask files for the chosen photo, each named after its region and as large as the photo"
    )
    bl_options = {"UNDO"}

    files: bpy.props.CollectionProperty(
        type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"}
    )
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{s}" for s in MASK_SUFFIXES), options={"HIDDEN"}
    )

    def start(self, context: bpy.types.Context) -> Job[CheckedMasks]:
        photo = context.scene.fresco.active_photo
        folder = Path(bpy.path.abspath(self.directory))
        paths = sorted(folder / file.name for file in self.files if file.name)
        if not paths:
            raise RegionError("Choose one or more mask files.")
        return check_masks_job({photo.name: Path(photo.path)}, [(photo.name, path) for path in paths])


class FRESCO_OT_import_mask_folder(MaskImport):
    bl_idname = "fresco.import_mask_folder"
    bl_label = "Masks from Folder"
    bl_description = "Choose a folder that has one folder of masks per photo: PHOTO/REGION.png"
    bl_options = {"UNDO"}

    directory: bpy.props.StringProperty(name="Folder", subtype="DIR_PATH")
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})

    def start(self, context: bpy.types.Context) -> Job[CheckedMasks]:
        folder = Path(bpy.path.abspath(self.directory))
        if not folder.is_dir():
            raise RegionError(f"{folder}: there is no such folder")
        photos = context.scene.fresco.photos
        masks = [(photo.name, path) for photo in photos for path in masks_of(photo, folder)]
        if not masks:
            raise RegionError(
                f"{folder}: there are no masks for these photos. Give each photo a folder with its name, "
                "and in it one mask per region, named after the region."
            )
        return check_masks_job({photo.name: Path(photo.path) for photo in photos}, masks)


def masks_of(photo: FrescoPhoto, folder: Path) -> list[Path]:
    """Mask files of a photo: in the folder named after it, with or without its ending."""
    path = Path(photo.path)
    for name in (path.stem, path.name):
        if (folder / name).is_dir():
            return sorted(p for p in (folder / name).iterdir() if p.suffix.lower() in MASK_SUFFIXES)
    return []


CLASSES = (
    FRESCO_OT_region_from_selection,
    FRESCO_OT_replace_region,
    FRESCO_OT_region_from_group,
    FRESCO_OT_select_region,
    FRESCO_OT_duplicate_region,
    FRESCO_OT_remove_region,
    FRESCO_OT_remove_mask,
    FRESCO_OT_import_masks,
    FRESCO_OT_import_mask_folder,
)
