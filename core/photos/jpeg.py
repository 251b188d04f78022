"""The structure of a JPEG file: its size, and whether it is complete, without decoding.

Source: ITU-T T.81, annex B (markers and segments).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator

_FRAMES = {0xC0, 0xC1, 0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF}
_SCAN, _END = 0xDA, 0xD9
_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xD9)}
_MARKER = re.compile(rb"\xff[^\x00\x01\xd0-\xd8]", re.DOTALL)


def _segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Marker and position of every segment's contents; ends with the end marker or where the data ends."""
    at = 2
    while (at := data.find(b"\xff", at)) >= 0 and at + 1 < len(data):
        marker = data[at + 1]
        if marker == 0xFF:  # padding
            at += 1
        elif marker == 0 or marker in _WITHOUT_LENGTH:  # stuffed byte or restart inside coded data
            at += 2
        elif marker == _END:
            yield marker, at + 2
            return
        else:
            yield marker, at + 4
            if at + 4 > len(data):
                return
            at += 2 + struct.unpack_from(">H", data, at + 2)[0]
            if marker == _SCAN:
                at = _after_coded_data(data, at)


def _after_coded_data(data: bytes, at: int) -> int:
    """Position of the first marker after coded data: 0xFF that neither a zero nor a restart follows."""
    found = _MARKER.search(data, at)
    return found.start() if found else len(data)


def jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Width and height of a JPEG from its first bytes, or None."""
    for marker, at in _segments(data):
        if marker in _FRAMES and at + 5 <= len(data):
            height, width = struct.unpack_from(">HH", data, at + 1)
            return int(width), int(height)
    return None


def jpeg_complete(data: bytes) -> bool:
    """Whether coded data is there and closed by the end marker; bytes after it do not matter."""
    markers = [marker for marker, _ in _segments(data)]
    return _SCAN in markers and markers[-1] == _END
