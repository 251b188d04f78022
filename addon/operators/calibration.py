"""Give photos the calibration of the camera that took them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ...core.cameras import Camera, PerspectiveCamera
from ...core.cameras.files import read_camera
from ...core.cameras.presets import preset_names
from ...core.jobs import Job, part
from ...core.photos import camera_from_exif, camera_matrix, focal_from_sensor, image_size, read_exif
from ...core.photos.intrinsics import PROJECTIONS, camera_from_body
from ..bridge import photos as bridge
from ..bridge.previews import preview_job
from ..jobs import JobOperator
from ..preferences import preview_size
from .photos import OpenedPhoto


def _listed_bodies(_self: object, _context: bpy.types.Context, _text: str) -> list[str]:
    return preset_names()


def _projections(_self: object, _context: bpy.types.Context, _text: str) -> tuple[str, ...]:
    return PROJECTIONS


class FRESCO_OT_set_calibration(JobOperator):
    bl_idname = "fresco.set_calibration"
    bl_label = "Set Calibration"
    bl_description = "Give photos the lens and sensor that they were taken with"
    bl_options = {"UNDO"}
    step = "photos"

    source: bpy.props.EnumProperty(
        name="From",
        items=[
            ("BODY", "Body", "A listed camera body and its lens"),
            ("LENS", "Sensor", "Focal length and sensor width in millimetres"),
            ("PIXELS", "Values", "Calibrated values in pixels, as OpenCV counts them"),
            ("FILE", "File", "A calibration file of OpenCV, Metashape, COLMAP, OCamCalib or Fresco"),
            ("EXIF", "EXIF", "What the camera wrote into each photo"),
        ],
        default="LENS",
    )
    all_alike: bpy.props.BoolProperty(
        name="All photos of this size", description="Also all other photos with the same number of pixels"
    )
    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", description="Calibration file")
    body: bpy.props.StringProperty(
        name="Body", search=_listed_bodies, description="As the camera writes it into its photos"
    )
    lens: bpy.props.StringProperty(
        name="Lens",
        search=_projections,
        description="Name or projection of the lens; empty is a perspective one",
    )
    focal_mm: bpy.props.FloatProperty(name="Focal length (mm)", default=24, min=1, max=5000, precision=2)
    sensor_mm: bpy.props.FloatProperty(
        name="Sensor width (mm)",
        default=36,
        min=1,
        max=200,
        precision=2,
        description="Longer side of the sensor",
    )
    focal: bpy.props.FloatVectorProperty(
        name="Focal length", size=2, default=(4000, 4000), min=1, precision=3, description="fx and fy, pixels"
    )
    principal: bpy.props.FloatVectorProperty(
        name="Principal point",
        size=2,
        precision=3,
        description="Pixels from the centre of the top-left pixel; 0, 0 is the middle of the photo",
    )
    radial: bpy.props.FloatVectorProperty(
        name="Radial k1, k2, k3", size=3, precision=6, description="Radial distortion, OpenCV's coefficients"
    )
    tangential: bpy.props.FloatVectorProperty(
        name="Tangential p1, p2",
        size=2,
        precision=6,
        description="Tangential distortion, OpenCV's coefficients",
    )

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Choose a photo in the list")
        return context.scene.fresco.active_photo is not None

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self._interactive = True
        photo = context.scene.fresco.active_photo
        if photo.camera_json:
            self._show_camera(bridge.read_camera(photo))
        return context.window_manager.invoke_props_dialog(self, width=380)

    def _show_camera(self, camera: Camera) -> None:
        """Fill the dialog with a photo's present calibration."""
        if not isinstance(camera, PerspectiveCamera):
            return
        K = camera.K
        self.focal, self.principal = (K[0, 0], K[1, 1]), (K[0, 2], K[1, 2])
        self.focal_mm = K[0, 0] * self.sensor_mm / max(camera.width, camera.height)
        k1, k2, p1, p2, k3 = (*camera.distortion.opencv, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        self.radial, self.tangential = (k1, k2, k3), (p1, p2)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "source", expand=True)
        names = {
            "BODY": ("body", "lens", "focal_mm"),
            "LENS": ("focal_mm", "sensor_mm"),
            "PIXELS": ("focal", "principal", "radial", "tangential"),
            "FILE": ("filepath",),
            "EXIF": (),
        }[self.source]
        for name in names:
            layout.prop(self, name)
        layout.prop(self, "all_alike")

    def _camera(self, path: Path) -> tuple[Camera, str]:
        width, height = image_size(path)
        if self.source == "EXIF":
            return camera_from_exif(read_exif(path), width, height)
        if self.source == "FILE":
            file = Path(bpy.path.abspath(self.filepath))
            return read_camera(file, (width, height)), f"Calibration file {file.name}"
        if self.source == "BODY":
            return camera_from_body(self.body, width, height, self.focal_mm, self.lens)
        if self.source == "LENS":
            focal = focal_from_sensor(self.focal_mm, self.sensor_mm, width, height)
            note = f"{self.focal_mm:g} mm on a sensor {self.sensor_mm:g} mm wide, no distortion"
            return PerspectiveCamera(width, height, camera_matrix(width, height, focal)), note
        principal = tuple(self.principal) if any(self.principal) else None
        matrix = camera_matrix(width, height, tuple(self.focal), principal)
        k1, k2, k3 = self.radial
        return PerspectiveCamera(width, height, matrix, (k1, k2, *self.tangential, k3)), "Calibrated values"

    def start(self, context: bpy.types.Context) -> Job[Any]:
        fresco = context.scene.fresco
        chosen = Path(fresco.active_photo.path)
        size = image_size(chosen)
        paths = [Path(p.path) for p in fresco.photos] if self.all_alike else [chosen]
        cameras = {path: self._camera(path) for path in paths if image_size(path) == size}
        return self._previews_job(cameras, preview_size(context))

    def _previews_job(self, cameras: dict[Path, tuple[Camera, str]], size: int) -> Job[list[OpenedPhoto]]:
        opened = []
        for number, (path, (camera, note)) in enumerate(cameras.items()):
            span = number / len(cameras), (number + 1) / len(cameras)
            preview = yield from part(preview_job(path, camera, size), *span)
            opened.append(OpenedPhoto(path, camera, note, preview))
        return opened

    def finish(self, context: bpy.types.Context, result: list[OpenedPhoto]) -> None:
        opened = {photo.path: photo for photo in result}
        for item in context.scene.fresco.photos:
            one = opened.get(Path(item.path))
            if one is not None:
                bridge.write_camera(context, item, one.camera, one.note, one.preview)
        bridge.frame_photo(context.scene, context.scene.fresco.active_photo)


CLASSES = (FRESCO_OT_set_calibration,)
