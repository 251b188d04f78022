"""Image regions as files that other programs read: masks as PNG, polygons as GeoJSON in pixel coordinates.

Pixels are (u, v); the centre of the top-left pixel is (0, 0). The polygon file says so itself, in
`pixel_origin`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..arrays import ArrayLike, BoolArray, FloatArray
from ..errors import OutputError, RegionError
from ..files import replacing
from ..geometry.outlines import fill_loops, loop_area
from .image_region import ImageRegion
from .outline import mask_polygons

PIXEL_ORIGIN = "centre of the top-left pixel"


def write_mask(path: Path | str, mask: ArrayLike) -> None:
    """Write a mask (H,W) as an 8-bit PNG: 255 inside, 0 outside; the file is replaced only when complete."""
    pixels = (np.asarray(mask) != 0).astype(np.uint8) * 255
    done, data = cv2.imencode(".png", pixels)
    if not done:
        raise OutputError(f"{path}: a mask of {pixels.shape} pixels cannot be written as PNG")
    with replacing(path) as file:
        file.write(data.tobytes())


def write_polygons(path: Path | str, regions: Sequence[ImageRegion], width: int, height: int) -> None:
    """Write regions as a GeoJSON feature collection in pixels of a photo of `width` x `height`.

    Every region is a feature with `properties.name`; its hidden parts stand beside the geometry in
    `hidden`, as a list of rings (even-odd rule).
    """
    content = {
        "type": "FeatureCollection",
        "pixel_origin": PIXEL_ORIGIN,
        "width": width,
        "height": height,
        "features": [_feature(region) for region in regions],
    }
    with replacing(path) as file:
        file.write(json.dumps(content, indent=1).encode())


def read_polygon_regions(path: Path | str) -> list[ImageRegion]:
    """Regions of a polygon file, as `write_polygons` writes it.

    Other `pixel_origin`s than ours are converted.

    Raises
    ------
    RegionError
        The file is missing, no JSON, no feature collection, or has geometry other than polygons.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RegionError(f"{path}: the polygons cannot be read ({error})") from error
    features = content.get("features") if isinstance(content, dict) else None
    if not isinstance(features, list):
        raise RegionError(f"{path}: not a GeoJSON feature collection (no “features”)")
    origin = content.get("pixel_origin", PIXEL_ORIGIN)
    shift = 0.0 if origin == PIXEL_ORIGIN else -0.5  # the corner of the top-left pixel is (0, 0)
    if origin not in (PIXEL_ORIGIN, "corner of the top-left pixel"):
        raise RegionError(
            f"{path}: pixel_origin has to be “{PIXEL_ORIGIN}” or “corner of the top-left pixel”"
        )
    size = content.get("width"), content.get("height")
    return [
        _region(feature, shift, size, f"{path}: feature {number}") for number, feature in enumerate(features)
    ]


def _feature(region: ImageRegion) -> dict[str, Any]:
    polygons = [[_ring_out(ring) for ring in polygon] for polygon in nested(region.loops)]
    geometry: dict[str, Any] = {"type": "Polygon", "coordinates": polygons[0]}
    if len(polygons) > 1:
        geometry = {"type": "MultiPolygon", "coordinates": polygons}
    feature: dict[str, Any] = {"type": "Feature", "properties": {"name": region.name}, "geometry": geometry}
    if region.hidden is not None and region.hidden.any():
        feature["hidden"] = [_ring_out(loop) for loop in mask_polygons(region.hidden)]
    return feature


def _ring_out(loop: FloatArray) -> list[list[float]]:
    return [*loop.tolist(), loop[0].tolist()]


def nested(loops: Sequence[FloatArray]) -> list[list[FloatArray]]:
    """Outlines (positive area) each with the holes (negative area) whose first corner lies in it."""
    outer = [loop for loop in loops if loop_area([loop]) > 0]
    polygons = [[loop] for loop in outer]
    for hole in loops:
        if loop_area([hole]) > 0:
            continue
        corner = (float(hole[0, 0]), float(hole[0, 1]))
        around = [
            k
            for k, loop in enumerate(outer)
            if cv2.pointPolygonTest(loop.astype(np.float32)[:, None], corner, False) >= 0
        ]
        if around:  # of several the smallest: an island in a hole has its own
            polygons[min(around, key=lambda k: loop_area([outer[k]]))].append(hole)
    return polygons


def _region(feature: Any, shift: float, size: tuple[Any, Any], where: str) -> ImageRegion:
    properties = feature.get("properties") if isinstance(feature, dict) else None
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str) or not isinstance(geometry, dict):
        raise RegionError(f"{where}: needs properties.name and a geometry")
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    if kind not in ("Polygon", "MultiPolygon") or not isinstance(coordinates, list) or not coordinates:
        raise RegionError(f"{where}: is no Polygon or MultiPolygon")
    polygons = [coordinates] if kind == "Polygon" else coordinates
    loops: list[FloatArray] = []
    for polygon in polygons:
        rings = [_ring(ring, shift, where) for ring in polygon]
        loops.extend(ImageRegion.from_polygon(rings[0], rings[1:], name).loops)
    return ImageRegion(tuple(loops), name, hidden=_hidden(feature.get("hidden"), shift, size, where))


def _hidden(rings: Any, shift: float, size: tuple[Any, Any], where: str) -> BoolArray | None:
    if not rings:
        return None
    if not all(isinstance(side, int) and side > 0 for side in size):
        raise RegionError(f"{where}: hidden parts need the photo's width and height in the file")
    return fill_loops([_ring(ring, shift, where) for ring in rings], size[0], size[1])


def _ring(ring: Any, shift: float, where: str) -> FloatArray:
    """Corners (n,2) without the repeated last one."""
    try:
        corners = np.array(ring, dtype=np.float64)
    except (TypeError, ValueError):
        corners = np.empty(0)
    if corners.ndim != 2 or corners.shape[1:] != (2,) or len(corners) < 3 or not np.isfinite(corners).all():
        raise RegionError(f"{where}: coordinates have to be a list of at least three [u, v]")
    if np.array_equal(corners[0], corners[-1]):
        corners = corners[:-1]
    shifted: FloatArray = corners + shift
    return shifted
