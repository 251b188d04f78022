"""Photos with EXIF data of our own making."""

import struct

import cv2
import numpy as np

SHORT, LONG, RATIO, TEXT = 3, 4, 5, 2


def exif_entry(tag, kind, value, at):
    """One directory entry and the bytes that do not fit into it, which go to position `at`."""
    if kind == SHORT:
        return struct.pack(">HHIHH", tag, kind, 1, value, 0), b""
    if kind == LONG:
        return struct.pack(">HHII", tag, kind, 1, value), b""
    data = value.encode() + b"\0" if kind == TEXT else b"".join(struct.pack(">II", *part) for part in value)
    count = len(data) if kind == TEXT else len(value)
    if len(data) <= 4:
        return struct.pack(">HHI", tag, kind, count) + data.ljust(4, b"\0"), b""
    return struct.pack(">HHII", tag, kind, count, at), data


def exif_block(tags, pointers):
    """EXIF of our own making: `tags` of the image directory, `pointers` tag -> tags of another directory."""
    image = tags | {pointer: (LONG, 0) for pointer in pointers}
    at = 8
    starts = {}
    for key, items in [(None, image), *pointers.items()]:
        starts[key] = at
        at += 2 + 12 * len(items) + 4
    image |= {pointer: (LONG, starts[pointer]) for pointer in pointers}
    blob, extra = b"MM\0*\0\0\0\x08", b""
    for items in (image, *pointers.values()):
        blob += struct.pack(">H", len(items))
        for tag in sorted(items):
            entry, outside = exif_entry(tag, *items[tag], at + len(extra))
            blob, extra = blob + entry, extra + outside
        blob += bytes(4)
    return b"Exif\0\0" + blob + extra


def photo_file(path, width=90, height=60, tags=None, exif=None, gps=None):
    rng = np.random.default_rng(1)
    data = cv2.imencode(".jpg", rng.integers(0, 255, (height, width, 3), dtype=np.uint8))[1].tobytes()
    pointers = ({0x8769: exif} if exif else {}) | ({0x8825: gps} if gps else {})
    if tags or pointers:
        block = exif_block(tags or {}, pointers)
        data = data[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + data[2:]
    path.write_bytes(data)
    return path
