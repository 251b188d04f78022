"""What the adjustment leaves of the ties of a photo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray, IndexArray


@dataclass(frozen=True, eq=False)
class TieResiduals:
    """Ties of one photo, and how far off it shows them.

    `pixels` (N,2) where the pose puts their points, `offsets` (N,2) px from there to where the photo shows
    them. (0, 0) is the centre of the top-left pixel.
    """

    pixels: FloatArray
    offsets: FloatArray

    @classmethod
    def none(cls) -> TieResiduals:
        """No ties."""
        return cls(np.zeros((0, 2)), np.zeros((0, 2)))

    def __len__(self) -> int:
        return len(self.pixels)

    def length_at(self, share: float) -> float:
        """Length (px) that a share of the residuals does not exceed: 0.5 is the median; NaN without any."""
        return float(np.quantile(np.linalg.norm(self.offsets, axis=1), share)) if len(self) else float("nan")

    def spread(self, cells: int) -> TieResiduals:
        """One residual for each cell of a grid with `cells` cells along the longer side of what is tied."""
        if not len(self):
            return self
        low = self.pixels.min(axis=0)
        size = max(float((self.pixels - low).max()) / cells, 1.0)
        _, first = np.unique(((self.pixels - low) // size).astype(np.int64), axis=0, return_index=True)
        kept: IndexArray = np.sort(first)
        return TieResiduals(self.pixels[kept], self.offsets[kept])
