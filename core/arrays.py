"""Names for the arrays that the rooms hand to one another."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.float64]
Float32Array: TypeAlias = NDArray[np.float32]
IntArray: TypeAlias = NDArray[np.int32]
IndexArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
ByteArray: TypeAlias = NDArray[np.uint8]
AnyArray: TypeAlias = NDArray[Any]

__all__ = [
    "AnyArray",
    "ArrayLike",
    "BoolArray",
    "ByteArray",
    "Float32Array",
    "FloatArray",
    "IndexArray",
    "IntArray",
]
