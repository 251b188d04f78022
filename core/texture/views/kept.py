"""What photos have contributed, kept in files: an interrupted run goes on at the photo where it stopped."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...arrays import AnyArray
from ...files import replacing


@dataclass(frozen=True)
class KeptPhotos:
    """A folder with one file per photo, named by the fingerprint of all that its contents depend on.

    `keys` has one fingerprint per photo: of its pixels, mask, camera and pose, the mesh, the settings and the
    program code. With another one a photo counts as not kept. Without a folder nothing is kept.
    """

    folder: Path | None = None
    keys: Sequence[str] = ()

    def load(self, number: int) -> dict[str, AnyArray] | None:
        """Arrays kept for a photo, or None when there are none or they were cut off."""
        if self.folder is None:
            return None
        try:
            with np.load(self._path(number), allow_pickle=False) as saved:
                return {name: saved[name] for name in saved.files}
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def save(self, number: int, arrays: Mapping[str, AnyArray]) -> None:
        """Keep arrays of a photo, all or nothing. Raises OutputError."""
        if self.folder is None:
            return
        with replacing(self._path(number)) as target:
            # One write of it all: a half-open archive would complain once more about a full disk.
            file = io.BytesIO()
            np.savez(file, **dict(arrays))
            target.write(file.getbuffer())

    def clear(self) -> None:
        """Remove everything in the folder that this class has written: the run is finished."""
        if self.folder is None or not self.folder.is_dir():
            return
        for path in self.folder.glob("*.photo.npz"):
            path.unlink(missing_ok=True)
        if not any(self.folder.iterdir()):
            self.folder.rmdir()

    def _path(self, number: int) -> Path:
        assert self.folder is not None
        return self.folder / f"{self.keys[number]}.photo.npz"
