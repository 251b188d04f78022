"""Outputs that a repeated run need not make again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..cameras.files.dictionary import camera_to_dict
from ..jobs import Job, Progress
from .digest import code_digest, digest
from .stages.textures import TexturedScan
from .store import Store

_PACKAGE = Path(__file__).resolve().parents[2]


def unchanged_job(store: Store, path: Path, key: str, make: Callable[[], Job[Any]]) -> Job[None]:
    """Make the file at `path`, unless it is the one that was made from the same inputs (`key`).

    What was written is recognised by its size and time, so that a file that was changed or replaced since
    is made again.
    """
    yield Progress(0.0, f"Looking for {path.name}")
    name, key = f"output {path.name}", digest(code_digest(), key, str(path.resolve()))
    saved = store.load(name, key)
    if saved is not None and saved == _state(path):
        return
    yield from make()
    store.save(name, key, _state(path))


def outputs_key(provenance: Mapping[str, Any]) -> str:
    """Fingerprint of all that a run has found and of the programs that write it down."""
    what = {name: value for name, value in provenance.items() if name not in ("written", "seconds")}
    programs = [path.read_text(encoding="utf-8") for path in sorted(_PACKAGE.rglob("addon/**/*.py"))]
    return digest(what, programs)


def are_unchanged(store: Store, paths: Sequence[Path], key: str) -> bool:
    """Whether all files are there as they were written from the same inputs."""
    saved = store.load("outputs", key)
    return saved is not None and saved == {path.name: _state(path) for path in paths} and all(saved.values())


def keep_unchanged(store: Store, paths: Sequence[Path], key: str) -> None:
    """Note what was written, so that the next run need not write it again; raises OutputError."""
    store.save("outputs", key, {path.name: _state(path) for path in paths})


def textured_key(textured: TexturedScan) -> str:
    """Fingerprint of a texture and what it refers to."""
    selection = textured.selection
    views = [
        (camera_to_dict(view.camera), view.rotation, view.translation, str(view.image), _stamp(view.image))
        for view in textured.views
    ]
    arrays = (textured.vertices, textured.faces, selection.view, selection.uv, selection.gain)
    return digest(*arrays, selection.photo_name.tolist(), views)


def _stamp(image: object) -> str:
    if isinstance(image, np.ndarray):
        return digest(image)
    state = _state(Path(str(image)))
    return digest(state)


def _state(path: Path) -> dict[str, Any]:
    """Size and time of a file; empty when it is not there."""
    try:
        status = path.stat()
    except OSError:
        return {}
    return {"size": status.st_size, "time": status.st_mtime_ns}
