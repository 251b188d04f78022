"""A photo as the project and the window know it: its file, its camera, what is marked in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ..arrays import BoolArray
from ..cameras.base import Camera
from ..errors import PhotoError
from .exif import Exif, read_exif
from .image import image_size
from .intrinsics import camera_from_exif
from .marks import RegionMark, check_mask, read_mask


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo with its camera, not yet posed (see `View`).

    `regions` are the marked regions; `mask` is a file that is bright where the photo may be used for texture.
    `notes` holds what the user should know, one sentence each; `camera_source` says where the camera is from,
    which is a note as well where it is nominal only.
    """

    path: Path
    name: str
    camera: Camera
    regions: tuple[RegionMark, ...] = ()
    mask: Path | None = None
    exif: Exif = field(default_factory=Exif)
    notes: tuple[str, ...] = ()
    camera_source: str = ""

    def read_mask(self) -> BoolArray | None:
        """Mask (H,W) of the usable pixels or None; raises RegionError when it does not fit the photo."""
        if self.mask is None:
            return None
        mask = read_mask(self.mask)
        check_mask(mask, self.camera.width, self.camera.height, str(self.mask))
        return mask


def open_photo(
    path: Path | str,
    camera: Camera | None = None,
    regions: tuple[RegionMark, ...] = (),
    mask: Path | None = None,
    name: str = "",
) -> Photo:
    """Open a photo: its header is read, its pixels are not.

    Without a camera the EXIF data has to tell the focal length. Raises PhotoError when the file is missing,
    no photo, or of another size than its camera; CameraError when no camera can be made.
    """
    path = Path(path)
    width, height = image_size(path)
    exif = read_exif(path)
    source, notes = "", [note for note in [exif.orientation_note(width, height)] if note]
    if camera is None:
        camera, source = camera_from_exif(exif, width, height)
        notes.append(source)
    if (camera.width, camera.height) != (width, height):
        raise PhotoError(
            f"{path}: the photo is {width} x {height} pixels, but its camera is calibrated for "
            f"{camera.width} x {camera.height}; use the original photo or the right calibration"
        )
    return Photo(path, name or path.stem, camera, regions, mask, exif, tuple(notes), source)
