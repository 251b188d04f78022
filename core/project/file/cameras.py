"""Cameras of a project file: from numbers, a calibration file, a preset, or what the photo tells itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...cameras import Camera
from ...cameras.files.dictionary import camera_from_dict
from ...cameras.files.reader import read_camera
from ...errors import CameraError
from ...photos.exif import Exif
from ...photos.intrinsics import (
    camera_from_body,
    camera_from_exif,
    camera_matrix,
    focal_from_sensor,
)
from .table import Table

_SHORTEST = 0.05
"""Focal length in parts of the photo's longer side; 0.05 is a fisheye lens that sees round three times."""

_SOURCES = ("file", "preset", "exif", "focal", "focal_mm", "K")
_MODEL_KEYS = ("distortion", "coefficients", "centre", "stretch", "xi", "alpha", "beta", "k", "omega")


@dataclass(frozen=True)
class CameraEntry:
    """A camera definition; the camera itself depends on the size and EXIF data of the photo."""

    table: Table
    name: str = ""

    @classmethod
    def from_table(cls, table: Table) -> CameraEntry:
        """Check the keys of a [[camera]] table: one source only, nothing unknown, sizes whole."""
        name = table.text("name", "")
        table.offer((*_SOURCES, *_MODEL_KEYS, "model", "principal", "sensor_width_mm", "lens", "size"))
        table.finish()
        given = [key for key in _SOURCES if key in table and not (key == "focal_mm" and "preset" in table)]
        if len(given) > 1:
            table.fail(given[1], f"cannot stand beside “{given[0]}”; give one of them")
        model = table.text("model", "perspective")
        if not given and model in ("perspective", "fisheye", "catadioptric"):
            table.fail("", "says nothing of the lens; give focal, K, focal_mm, preset, file, or exif = true")
        return cls(table, name)

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height that the numbers were calibrated for, None when not told."""
        if "size" not in self.table:
            return None
        width, height = self.table.numbers("size", [2])
        if width != int(width) or height != int(height) or min(width, height) < 1:
            self.table.fail("size", "has to be the width and height in pixels")
        return int(width), int(height)

    @property
    def depends_on_size(self) -> bool:
        """Whether the numbers are in pixels, so that they hold for photos of one size only."""
        return "focal" in self.table or "K" in self.table or "principal" in self.table

    @property
    def is_nominal(self) -> bool:
        """Whether the camera is what its body and lens should be, not calibrated."""
        return "preset" in self.table or "exif" in self.table

    def make(self, width: int, height: int, exif: Exif) -> tuple[Camera, str]:
        """Camera for a photo (size in pixels), and a sentence on where it comes from.

        Raises ProjectError for numbers that make no sense or a photo that does not tell enough.
        """
        try:
            return self._make(width, height, exif)
        except CameraError as error:
            self.table.fail("", str(error))

    def _make(self, width: int, height: int, exif: Exif) -> tuple[Camera, str]:
        if "file" in self.table:
            path = self.table.path("file")
            return read_camera(path, (width, height)), f"Camera from {path.name}."
        if self.table.flag("exif", False):
            return camera_from_exif(exif, width, height)
        if "preset" in self.table:
            return self._preset(width, height, exif)
        width, height = self.size or (width, height)
        self._check_distortion()
        numbers = {key: self.table.get(key) for key in _MODEL_KEYS if key in self.table}
        model = self.table.text("model", "perspective")
        matrix = self._matrix(width, height)
        if matrix is not None:
            numbers["K"] = matrix
        what = f"{width} x {height} pixels"
        camera = camera_from_dict({"model": model, "width": width, "height": height, **numbers}, what)
        return camera, "Camera from the numbers of the project file."

    def _preset(self, width: int, height: int, exif: Exif) -> tuple[Camera, str]:
        """Nominal camera of a listed body; focal length and lens are the photo's where the file is silent."""
        focal_mm = exif.focal_length or 0.0  # panoramas need none
        if "focal_mm" in self.table:
            focal_mm = self.table.number("focal_mm", 0.1, 1e5)
        lens = self.table.text("lens", exif.lens)
        return camera_from_body(self.table.text("preset"), width, height, focal_mm, lens)

    def _matrix(self, width: int, height: int) -> list[list[float]] | None:
        """Camera matrix (3,3), None where nothing is said about the focal length."""
        if "K" in self.table:
            return self.table.matrix("K", 3, 3)
        principal = self.table.numbers("principal", [2]) if "principal" in self.table else None
        if "focal_mm" in self.table:
            focal_mm = self.table.number("focal_mm", 0.1, 1e5)
            sensor = self.table.number("sensor_width_mm", 0.1, 1e4)
            focal: float | tuple[float, ...] = focal_from_sensor(focal_mm, sensor, width, height)
        elif "focal" in self.table:
            value = self.table.get("focal")
            several = isinstance(value, list)
            focal = self.table.numbers("focal", [1, 2]) if several else self.table.number("focal", 1e-3)
            focal = (focal * 2)[:2] if isinstance(focal, tuple) else focal
            self._check_pixels(min(focal) if isinstance(focal, tuple) else focal, max(width, height))
        else:
            return None
        matrix: list[list[float]] = camera_matrix(width, height, focal, principal).tolist()
        return matrix

    def _check_pixels(self, focal: float, side: int) -> None:
        """Refuse a focal length (pixels) that is the lens's in millimetres: no lens sees that wide."""
        if focal < _SHORTEST * side:
            self.table.fail(
                "focal",
                f"is {focal:g} pixels for a photo of {side}: is this in millimetres? Use focal_mm and "
                "sensor_width_mm",
            )

    def _check_distortion(self) -> None:
        """Refuse three numbers: the third may be meant as p1 or as k3."""
        value = self.table.get("distortion")
        if isinstance(value, list) and len(value) == 3:
            self.table.fail(
                "distortion",
                "needs 2, 4, 5 or 8 numbers in the order k1, k2, p1, p2, k3, …, not 3; for k1, k2, k3 write "
                "[k1, k2, 0, 0, k3]",
            )


def check_one_size(entry: CameraEntry, sizes: dict[tuple[int, int], Path]) -> None:
    """Refuse pixel numbers without a size for photos of several sizes: they can be right for one only."""
    if entry.size is None and entry.depends_on_size and len(sizes) > 1:
        (first, one), (second, other) = list(sizes.items())[:2]
        entry.table.fail(
            "size",
            f"is missing, and the photos differ: {one.name} is {first[0]} x {first[1]}, "
            f"{other.name} is {second[0]} x {second[1]}",
        )
