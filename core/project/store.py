"""Results of finished stages, kept beside the output: an interrupted or repeated run takes them over.

Every result is kept with the fingerprint of all it was made from; with another one it counts as missing.
"""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import AnyArray
from ..files import replacing


class Store:
    """A folder of results; without folder it keeps nothing."""

    def __init__(self, folder: Path | None = None):
        self.folder = folder

    def load(self, name: str, key: str) -> dict[str, Any] | None:
        """Result saved under `name` with the fingerprint `key`, or None."""
        if self.folder is None:
            return None
        try:
            saved = json.loads((self.folder / f"{name}.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):  # not there, or cut off by a crash of the machine: computed again
            return None
        return saved["result"] if isinstance(saved, dict) and saved.get("key") == key else None

    def save(self, name: str, key: str, result: dict[str, Any]) -> None:
        """Keep plain numbers and texts; raises OutputError."""
        if self.folder is not None:
            with replacing(self.folder / f"{name}.json") as file:
                file.write(json.dumps({"key": key, "result": result}).encode())

    def load_arrays(self, name: str, key: str) -> dict[str, AnyArray] | None:
        """Arrays saved under `name` with the fingerprint `key`, or None."""
        if self.folder is None:
            return None
        try:
            with np.load(self.folder / f"{name}.npz", allow_pickle=False) as saved:
                if str(saved["key"]) != key:
                    return None
                return {part: saved[part] for part in saved.files if part != "key"}
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def save_arrays(self, name: str, key: str, arrays: dict[str, AnyArray]) -> None:
        """Keep arrays; raises OutputError."""
        if self.folder is not None:
            with replacing(self.folder / f"{name}.npz") as file:
                # One write of it all: on a full disk a half-open archive would complain once more at its end.
                file.write(packed({"key": np.array(key), **arrays}))


def packed(arrays: dict[str, AnyArray]) -> memoryview:
    """Arrays as an .npz file in memory."""
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getbuffer()
