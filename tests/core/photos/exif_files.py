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


def with_exif(data, tags=None, exif=None, gps=None):
    """JPEG (bytes) with EXIF tags of the image, the exposure and the position."""
    pointers = ({0x8769: exif} if exif else {}) | ({0x8825: gps} if gps else {})
    if not tags and not pointers:
        return data
    block = exif_block(tags or {}, pointers)
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + data[2:]


def photo_file(path, width=90, height=60, tags=None, exif=None, gps=None):
    rng = np.random.default_rng(1)
    data = cv2.imencode(".jpg", rng.integers(0, 255, (height, width, 3), dtype=np.uint8))[1].tobytes()
    path.write_bytes(with_exif(data, tags, exif, gps))
    return path


def degrees(value):
    """Degrees, minutes and seconds of an angle as EXIF has them."""
    whole = int(value)
    return [(whole, 1), (0, 1), (round((value - whole) * 3600 * 1000), 1000)]


def position_tags(latitude, longitude, height=530.2, heading=None, true=True, error=None):
    """Tags of a place (north, east), metres above the sea, heading in degrees, and its error in m."""
    gps = {
        1: (TEXT, "N"),
        2: (RATIO, degrees(latitude)),
        3: (TEXT, "E"),
        4: (RATIO, degrees(longitude)),
        6: (RATIO, [(round(height * 10), 10)]),
    }
    if heading is not None:
        gps |= {0x10: (TEXT, "T" if true else "M"), 0x11: (RATIO, [(round(heading * 10), 10)])}
    return gps if error is None else gps | {0x1F: (RATIO, [(round(error * 10), 10)])}


def place_of(zone, east, north):
    """Latitude and longitude (degrees) of a place in a northern UTM zone, by Newton's method."""
    from fresco.core.geometry.transverse_mercator import utm_zone

    projection, place = utm_zone(32600 + zone), np.array([north / 111e3, 6.0 * zone - 183])
    for _ in range(8):
        here = np.array(projection.plane(*place))
        columns = [(np.array(projection.plane(*(place + step))) - here) / 1e-6 for step in np.eye(2) * 1e-6]
        place = place + np.linalg.solve(np.stack(columns, axis=1), [east, north] - here)
    return place.tolist()
