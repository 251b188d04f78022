"""The best few photos for every face, collected photo by photo in bounded memory."""

from __future__ import annotations

import threading

import numpy as np

from ...arrays import BoolArray, Float32Array, IndexArray
from ...settings import TextureSettings
from .samples import PhotoSamples
from .visibility import SeenFaces

EMPTY = -1


class CandidateTable:
    """At most K photos for each of F faces, those of the lowest cost; all arrays are (F,K) or (F,K,...).

    `view` is -1 in empty slots. `cost` is in octaves of texel size (one photo twice as fine as another is
    cheaper by 1). `pixel` is the face's centre in the photo, `colour` its mean sRGB colour there. `seen_by`
    (F,) counts all photos that see the face, also those for which there was no room.
    """

    def __init__(self, face_count: int, slots: int) -> None:
        self.view = np.full((face_count, slots), EMPTY, dtype=np.int16)
        self.cost = np.full((face_count, slots), np.inf, dtype=np.float32)
        self.texel = np.full((face_count, slots), np.inf, dtype=np.float32)
        self.pixel = np.zeros((face_count, slots, 2), dtype=np.uint16)
        self.colour = np.zeros((face_count, slots, 3), dtype=np.uint8)
        self.seen_by = np.zeros(face_count, dtype=np.int16)
        self._index: tuple[IndexArray, IndexArray] | None = None
        self._indexing = threading.Lock()

    @property
    def slots(self) -> int:
        """K."""
        return self.view.shape[1]

    @property
    def filled(self) -> BoolArray:
        """Slots that hold a photo: (F,K)."""
        filled: BoolArray = self.view != EMPTY
        return filled

    def add(self, view: int, seen: SeenFaces, cost: Float32Array, samples: PhotoSamples) -> None:
        """Enter a photo where it beats the worst of the slots. Ties keep the earlier photo."""
        self._index = None
        self.seen_by[seen.face] += 1
        known = self.cost[seen.face]
        slot = np.argmax(known, axis=1)
        better = cost < known[np.arange(len(slot)), slot]
        at = seen.face[better], slot[better]
        self.view[at] = view
        self.cost[at] = cost[better]
        self.texel[at] = seen.texel[better]
        self.colour[at] = samples.colour[better]
        self.pixel[at] = np.clip(np.rint(seen.centre[better]), 0, 65535).astype(np.uint16)

    def of_view(self, view: int) -> tuple[IndexArray, IndexArray]:
        """Faces and slots where `view` is a candidate: (n,), (n,)."""
        order, bounds = self._by_view()
        if view + 1 >= len(bounds):
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        at = order[bounds[view] : bounds[view + 1]]
        at = at[self.view.ravel()[at] == view]  # some may have been dropped since
        return at // self.slots, at % self.slots

    def _by_view(self) -> tuple[IndexArray, IndexArray]:
        """Slots in the order of their photos, and where each photo's begin; several threads may ask."""
        with self._indexing:
            if self._index is None:
                flat = self.view.ravel()
                order: IndexArray = np.argsort(flat, kind="stable")
                bounds: IndexArray = np.searchsorted(flat[order], np.arange(int(flat.max(initial=-1)) + 2))
                self._index = order, bounds
            return self._index

    def drop(self, face: IndexArray | BoolArray, slot: IndexArray | slice = slice(None)) -> None:
        """Empty slots."""
        self.view[face, slot] = EMPTY
        self.cost[face, slot] = np.inf


def candidate_cost(
    seen: SeenFaces, clipped: Float32Array, priority: float, settings: TextureSettings
) -> Float32Array:
    """Cost of using a photo on each face in octaves of texel size: (n,).

    `score = "texel"`: the logarithm of the texel size on the surface, which holds distance, focal length,
    distortion and foreshortening in one figure. It falls with cos^1/2 of the angle, so beyond 60 degrees a
    term is added for what texel size does not show: glare, and the shift that a small pose error causes on
    the surface, which grows with 1/cos.
    `score = "published"`: eq. 3.39, `res / theta'`, with `res` from the true pixel density of the lens.
    Hidden and burnt-out parts add to each; the photo's priority subtracts.
    """
    if settings.score == "published":
        theta = np.arccos(np.clip(seen.cosine, -1, 1)) / (np.pi / 2)
        cost = np.log2(seen.texel * np.sqrt(seen.cosine) * np.maximum(theta, 1e-3))
    else:
        cost = np.log2(seen.texel) + np.log2(np.maximum(0.5 / seen.cosine, 1.0))
    cost = (
        cost
        + settings.hidden_penalty * np.sqrt(1 - seen.share)
        + settings.clipped_penalty * clipped
        - priority
    )
    result: Float32Array = np.asarray(cost, dtype=np.float32)
    return result
