"""What a user can be told: errors that carry a sentence a surveyor understands."""

from __future__ import annotations

from pathlib import Path


class FrescoError(Exception):
    """Something the user can mend; the text says what is wrong and what to do."""


class ScanError(FrescoError):
    """A scan that cannot be read or used."""


class PhotoError(FrescoError):
    """A photo that cannot be read or does not fit its camera."""


class CameraError(FrescoError):
    """Camera parameters or a camera file that make no sense."""


class RegionError(FrescoError):
    """A region that cannot be used: empty, of another size, without partner."""


class PoseNotFound(FrescoError):
    """No camera pose explains the input well enough; the text gives the reason."""


class TextureError(FrescoError):
    """Views or meshes that cannot be textured."""


class OutputError(FrescoError):
    """A result that cannot be written: read-only folder, full disk."""


class ProjectError(FrescoError):
    """A project file with a wrong or missing entry."""

    def __init__(self, path: Path | str, key: str, reason: str):
        super().__init__(f"{path}: {key}: {reason}" if key else f"{path}: {reason}")
        self.path = Path(path)
        self.key = key
        self.reason = reason
