"""How many photos are looked at together and remembered per face, so that the memory allowed is enough.

The figures are those of `tests/benchmarks/texture_scale.py`, rounded up: what the whole choice of photos
takes at its peak, not only while photos are looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...errors import TextureError
from ...photos.view import View
from ...settings import TextureSettings
from .parallel import CORES

GIB = float(1 << 30)
_PROGRAM = 0.2 * GIB
_PER_FACE = 420.0
"""Bytes per face for the mesh, its ray tree, its neighbours and the result."""
_PER_CANDIDATE = 45.0
"""Bytes per face and remembered photo, those of comparing colours and of the minimum cuts included."""
_PER_ANALYSED_PIXEL = 25.0
_PER_DECODED_PIXEL = 6.0
"""Bytes per pixel of a photo that is decoded whole; JPEGs are decoded smaller."""
_PER_MEASURED_PIXEL = 14.0
"""Bytes per pixel where the published focus measure looks at the whole photo."""
_FEWEST = 3
"""Candidates below which gains, strangers and seams would suffer."""


@dataclass(frozen=True)
class MemoryPlan:
    """`photos_together` looked at, `candidates` remembered per face, and the `peak` in bytes expected."""

    photos_together: int
    candidates: int
    peak: float


def plan_memory(face_count: int, views: Sequence[View], settings: TextureSettings) -> MemoryPlan:
    """Plan within `settings.memory_limit`; without a limit as much as is useful.

    First fewer photos are looked at together, then fewer are remembered per face. Raises TextureError when
    even the least does not fit.
    """
    threads = settings.threads or CORES
    candidates = min(settings.max_candidates, max(len(views), 1))
    photo = max((photo_bytes(view, settings) for view in views), default=0.0)

    def peak(together: int, remembered: int) -> float:
        faces = face_count * (_PER_FACE + _PER_CANDIDATE * remembered)
        return _PROGRAM + faces + together * photo

    limit = settings.memory_limit * GIB
    if limit > 0:
        while threads > 1 and peak(threads, candidates) > limit:
            threads -= 1
        while candidates > _FEWEST and peak(threads, candidates) > limit:
            candidates -= 1
        if peak(threads, candidates) > limit:
            raise TextureError(
                f"Choosing photos for {face_count} faces takes about {peak(threads, candidates) / GIB:.1f} "
                f"GiB, but {settings.memory_limit:g} GiB are allowed: simplify or divide the scan, use "
                "smaller photos, or raise memory_limit."
            )
    return MemoryPlan(threads, candidates, peak(threads, candidates))


def photo_bytes(view: View, settings: TextureSettings) -> float:
    """Bytes that looking at a photo takes for a moment."""
    pixels = float(view.camera.width * view.camera.height)
    whole = isinstance(view.image, (str, Path)) and Path(view.image).suffix.lower() not in (".jpg", ".jpeg")
    decoded = pixels * _PER_DECODED_PIXEL if whole else 0.0
    if settings.sharpness == "published":
        decoded = pixels * _PER_MEASURED_PIXEL
    return decoded + _PER_ANALYSED_PIXEL * min(pixels, settings.analysed_pixels)
