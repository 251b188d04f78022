"""The textured scan as .obj and .mtl whose textures are the original photos."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ...arrays import AnyArray, ArrayLike, FloatArray, IntArray
from ...errors import TextureError
from ...files import replacing
from ...jobs import Job, Progress, drain
from ...photos.view import View
from ..selection import Selection
from ..surface import checked_mesh
from ..views.images import view_name

NEUTRAL = "unseen"
"""Material of the faces that no photo sees."""
_LINES = 50_000


def write_obj(
    path: Path | str,
    vertices: ArrayLike,
    faces: ArrayLike,
    selection: Selection,
    views: Sequence[View],
    offset: ArrayLike = (0.0, 0.0, 0.0),
) -> Path:
    """Run `write_obj_job` to its end."""
    return drain(write_obj_job(path, vertices, faces, selection, views, offset))


def write_obj_job(
    path: Path | str,
    vertices: ArrayLike,
    faces: ArrayLike,
    selection: Selection,
    views: Sequence[View],
    offset: ArrayLike = (0.0, 0.0, 0.0),
) -> Job[Path]:
    """Write a textured mesh as `path` and a .mtl beside it; one material per photo, unseen faces neutral.

    Vertices (V,3) m are written as `vertices + offset`, in double precision. The photos are not copied: the
    materials name the originals relative to the .mtl, with forward slashes. Both files appear complete or not
    at all. Returns the path. Raises OutputError, TextureError.
    """
    target = Path(path)
    points, triangles = checked_mesh(vertices, faces)
    if selection.view.shape != (len(triangles),):
        raise TextureError(
            f"The texture belongs to {len(selection.view)} faces, the mesh has {len(triangles)}."
        )
    materials = material_names(views)
    library = target.with_suffix(".mtl")
    with replacing(library) as mtl, replacing(target) as obj:
        mtl.write(_material_library(materials, views, selection, target.parent).encode())
        obj.write(f"# metres; textures are the original photos\nmtllib {library.name}\n".encode())
        shift = np.asarray(offset, dtype=np.float64)
        for done, text in _rows(b"v %.6f %.6f %.6f\n", points + shift):
            yield Progress(0.3 * done, "Writing vertices")
            obj.write(text)
        corner_uv, uv = _shared_uv(triangles, selection, views)
        for done, text in _rows(b"vt %.8f %.8f\n", uv):
            yield Progress(0.3 + 0.3 * done, "Writing texture coordinates")
            obj.write(text)
        for done, text in _face_rows(triangles, corner_uv, selection.view, materials):
            yield Progress(0.6 + 0.4 * done, "Writing faces")
            obj.write(text)
    return target


def material_names(views: Sequence[View]) -> list[str]:
    """One distinct name per photo, without spaces: OBJ readers end a name there."""
    names: list[str] = []
    taken = {NEUTRAL}
    for number, view in enumerate(views):
        stem = re.sub(r"\s+", "_", Path(view_name(view, number)).stem) or f"photo_{number + 1}"
        name, copy = stem, 2
        while name in taken:
            name, copy = f"{stem}_{copy}", copy + 1
        taken.add(name)
        names.append(name)
    return names


def _material_library(
    materials: Sequence[str], views: Sequence[View], selection: Selection, folder: Path
) -> str:
    used = np.unique(selection.view)
    text = [f"newmtl {NEUTRAL}\nKa 0 0 0\nKd 0.5 0.5 0.5\nKs 0 0 0\nillum 1\n"] if -1 in used else []
    for number in used[used >= 0]:
        gain = " ".join(f"{factor:.6f}" for factor in selection.gain[number])
        photo = _relative(views[number], int(number), folder)
        text.append(
            f"newmtl {materials[number]}\n# linear gain that equals this photo to the others: {gain}\n"
            f"Ka 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {photo}\n"
        )
    return "\n".join(text)


def _relative(view: View, number: int, folder: Path) -> str:
    if isinstance(view.image, np.ndarray):
        raise TextureError(
            f"{view_name(view, number)}: only a photo that is a file can be a texture of an OBJ."
        )
    photo = Path(view.image).resolve()
    try:
        return Path(os.path.relpath(photo, folder.resolve())).as_posix()
    except ValueError:  # another drive on Windows
        return photo.as_posix()


def _shared_uv(faces: IntArray, selection: Selection, views: Sequence[View]) -> tuple[IntArray, FloatArray]:
    """UVs once per vertex and photo: -> index per corner (F,3), -1 where unseen, and UVs (T,2).

    OBJ counts from the lower left corner of the image, so the centre of the top-left pixel (0, 0) lies at
    (0.5 / width, 1 - 0.5 / height).
    """
    seen = np.flatnonzero(selection.view >= 0)
    vertex_count = int(faces.max()) + 1
    key = selection.view[seen, None].astype(np.int64) * vertex_count + faces[seen]
    # A vertex beside a panorama's seam lies at its left side for some faces, at its right for others.
    width = np.array([view.camera.width for view in views])[selection.view[seen]]
    turn = np.floor((selection.uv[seen, :, 0] + 0.5) / width[:, None]).astype(np.int64)
    key = key * 3 + np.clip(turn, -1, 1) + 1
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    size = np.array([(view.camera.width, view.camera.height) for view in views], dtype=np.float64)
    pixel = selection.uv[seen].reshape(-1, 2)[first]
    uv = (pixel + 0.5) / size[np.repeat(selection.view[seen], 3)[first]]
    uv[:, 1] = 1 - uv[:, 1]
    corners = np.full(faces.shape, -1, dtype=np.int32)
    corners[seen] = index.reshape(-1, 3)
    return corners, uv


def _rows(pattern: bytes, values: AnyArray) -> Iterator[tuple[float, bytes]]:
    """Lines of text, many at a time, each with the share done."""
    for start in range(0, len(values), _LINES):
        chunk = values[start : start + _LINES]
        yield (start + len(chunk)) / len(values), pattern * len(chunk) % tuple(chunk.ravel().tolist())


def _face_rows(
    faces: IntArray, corner_uv: IntArray, view: IntArray, materials: Sequence[str]
) -> Iterator[tuple[float, bytes]]:
    """Face lines, photo by photo; OBJ counts from 1."""
    order = np.argsort(view, kind="stable")
    numbers, starts = np.unique(view[order], return_index=True)
    done = 0
    for number, chosen in zip(numbers, np.split(order, starts[1:]), strict=True):
        yield done / len(view), f"usemtl {materials[number] if number >= 0 else NEUTRAL}\n".encode()
        for _, text in _numbered(faces[chosen], corner_uv[chosen] if number >= 0 else None):
            yield done / len(view), text
        done += len(chosen)


def _numbered(faces: IntArray, corner_uv: IntArray | None) -> Iterator[tuple[float, bytes]]:
    if corner_uv is None:
        return _rows(b"f %d %d %d\n", faces + 1)
    both: AnyArray = np.stack([faces, corner_uv], axis=2).reshape(len(faces), 6) + 1
    return _rows(b"f %d/%d %d/%d %d/%d\n", both)
