"""What the first directory of a TIFF file says, without decoding it. Source: TIFF 6.0, section 2."""

from __future__ import annotations

import struct
from dataclasses import dataclass

_WIDTH, _HEIGHT, _BITS, _COLOURS, _SAMPLES, _FORMAT = 256, 257, 258, 262, 277, 339
_FLOAT, _RGB, _LOG = 3, 2, (32844, 32845)


@dataclass(frozen=True)
class TiffHeader:
    """`width`, `height` in pixels; whether samples are floating-point, and whether one is transparency."""

    width: int
    height: int
    is_float: bool
    has_alpha: bool


def is_tiff(data: bytes) -> bool:
    """Whether a file's first bytes are those of a TIFF."""
    return data[:4] in (b"II*\x00", b"MM\x00*")


def tiff_header(data: bytes) -> TiffHeader | None:
    """Read what the first directory says; None when it lies beyond `data` or lacks the size."""
    order = "<" if data.startswith(b"II") else ">"
    (at,) = struct.unpack_from(order + "I", data, 4)
    if at + 2 > len(data):
        return None
    (count,) = struct.unpack_from(order + "H", data, at)
    tags = {}
    for entry in range(at + 2, min(at + 2 + 12 * count, len(data) - 11), 12):
        tag, kind, length = struct.unpack_from(order + "HHI", data, entry)
        short = kind == 3
        if short and length * 2 > 4:  # the values stand elsewhere; those of all samples are alike
            (entry_at,) = struct.unpack_from(order + "I", data, entry + 8)
            if entry_at + 2 <= len(data):
                (tags[tag],) = struct.unpack_from(order + "H", data, entry_at)
        else:
            (tags[tag],) = struct.unpack_from(order + ("H" if short else "I"), data, entry + 8)
    if _WIDTH not in tags or _HEIGHT not in tags:
        return None
    alpha = tags.get(_COLOURS) == _RGB and tags.get(_SAMPLES) == 4
    floating = tags.get(_FORMAT) == _FLOAT or tags.get(_BITS, 8) > 16 or tags.get(_COLOURS) in _LOG
    return TiffHeader(int(tags[_WIDTH]), int(tags[_HEIGHT]), floating, alpha)
