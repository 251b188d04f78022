"""Normals of a noisy mesh, averaged over neighbours."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, identity

from ...arrays import FloatArray, IndexArray


def averaged_normals(normals: FloatArray, faces: IndexArray, rounds: int) -> FloatArray:
    """Unit vertex normals (V,3) averaged `rounds` times with those of the neighbours along edges."""
    count = len(normals)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    link = csr_matrix((np.ones(len(start), np.float32), (start, end)), shape=(count, count))
    link = link + link.T + identity(count, dtype=np.float32, format="csr")
    out = normals
    for _ in range(rounds):
        total: FloatArray = np.asarray(link @ out)
        out = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)
    return out
