"""What a user has marked in a photo: the outline of a region, as a mask file, a mask or a polygon.

Marks are read when they are needed: the masks of hundreds of photos do not fit into memory together.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np

from ..arrays import AnyArray, BoolArray, FloatArray
from ..errors import RegionError
from ..geometry.outlines import fill_loops

Shape: TypeAlias = tuple[Sequence[Sequence[FloatArray]], Sequence[FloatArray]]
"""Pieces of a region, each an outline (n,2) and its holes, and what hides parts of it, as closed loops."""


@dataclass(frozen=True, eq=False)
class RegionMark:
    """The mark of region `name` in one photo: one of a mask file, a mask (H,W), a polygon.

    A polygon is its `outline` (n,2) and `holes`, in pixels; the centre of the top-left pixel is (0, 0).
    `hidden` (H,W), or the mask file `hidden_path`, is true where something stands before the region: its
    outline is a guess there.
    """

    name: str
    path: Path | None = None
    mask: BoolArray | None = None
    outline: FloatArray | None = None
    holes: tuple[FloatArray, ...] = ()
    hidden: BoolArray | None = None
    hidden_path: Path | None = None

    def read_mask(self, width: int, height: int) -> BoolArray | None:
        """Mask (H,W) of the mark, None for a polygon; raises RegionError when it does not fit the photo."""
        if self.outline is not None:
            return None
        mask = read_mask(self.path) if self.path is not None else self.mask
        if mask is None:
            raise RegionError(f"Region “{self.name}” has neither mask nor polygon.")
        check_mask(mask, width, height, str(self.path or self.name))
        check_outline(mask, str(self.path or self.name))
        return mask

    def read_hidden(self, width: int, height: int) -> BoolArray | None:
        """Mask (H,W) of what stands before the region or None; RegionError when it does not fit the photo."""
        if self.hidden_path is None:
            return self.hidden
        mask = read_mask(self.hidden_path)
        check_mask(mask, width, height, str(self.hidden_path))
        return mask


def read_mask(path: Path | str) -> BoolArray:
    """Mask (H,W) from an image: true where it is bright, or opaque when its transparency varies.

    Raises RegionError when the file is missing or no image.
    """
    path = Path(path)
    try:
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except FileNotFoundError:
        raise RegionError(f"{path}: no such mask") from None
    except OSError as error:
        raise RegionError(f"{path}: the mask cannot be read ({error.strerror or error})") from error
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION) if len(data) else None
    if image is None or (bytes(data[:4]) == b"\x89PNG" and b"IEND" not in bytes(data[-4096:])):
        raise RegionError(f"{path}: not a mask that can be read, or it is damaged")
    return _bright(_one_channel(image))


def _one_channel(image: AnyArray) -> AnyArray:
    if image.ndim == 2:
        return image
    alpha = image[:, :, 3] if image.shape[2] == 4 else None
    if alpha is not None and alpha.min() != alpha.max():
        return alpha
    brightest: AnyArray = image[:, :, :3].max(axis=2)
    return brightest


def _bright(image: AnyArray) -> BoolArray:
    """More than half of full brightness; a mask of 0 and 1 counts 1 as full."""
    full = 1 if image.max() <= 1 or image.dtype.kind not in "iu" else np.iinfo(image.dtype).max
    bright: BoolArray = image > full / 2
    return bright


def check_mask(mask: BoolArray, width: int, height: int, name: str) -> None:
    """Raise RegionError when a mask is of another size than its photo, or empty."""
    rows, columns = mask.shape
    if (columns, rows) == (height, width) and width != height:
        raise RegionError(
            f"{name}: the mask is {columns} x {rows} pixels, the photo {width} x {height} as stored; the "
            "mask was made on the turned photo (EXIF orientation), turn it back"
        )
    if (columns, rows) != (width, height):
        raise RegionError(
            f"{name}: the mask is {columns} x {rows} pixels, but its photo {width} x {height}; both must "
            "have the same size"
        )
    if not mask.any():
        raise RegionError(f"{name}: the mask is empty; paint the region white")


def check_outline(mask: BoolArray, name: str) -> None:
    """Raise RegionError when a region's mask shows no outline inside the photo, or its surroundings instead.

    An inverted mask is true along most of the frame, on all four sides; a region that is cut off by the
    frame is not.
    """
    if mask.all():
        raise RegionError(
            f"{name}: the mask is white everywhere, it has no outline inside the photo; paint only the "
            "region white"
        )
    sides = (mask[0], mask[-1], mask[:, 0], mask[:, -1])
    if all(side.any() for side in sides) and np.concatenate(sides).mean() > 0.5:
        raise RegionError(
            f"{name}: the mask is white around most of the frame, on all four sides: is the mask inverted? "
            "The region has to be white"
        )


def touches_frame(mask: BoolArray) -> bool:
    """Whether a mask reaches the edge of the photo, where the region's true outline is cut off."""
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())


def read_polygons(path: Path | str) -> dict[str, RegionMark]:
    """Polygons from a GeoJSON feature collection, by name.

    Every feature has `properties.name` and a `Polygon` geometry: outline, then holes, each a list of (u, v)
    in pixels with (0, 0) at the centre of the top-left pixel; or a `MultiPolygon` of such. What stands before
    it may be given beside the geometry in `hidden`, a list of rings. Where there is either, the collection
    tells the photo's `width` and `height`. Raises RegionError for anything else.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise RegionError(f"{path}: the polygons cannot be read ({error.strerror or error})") from error
    except ValueError as error:
        raise RegionError(f"{path}: not a JSON file ({error})") from error
    features = content.get("features") if isinstance(content, dict) else None
    if not isinstance(features, list):
        raise RegionError(f"{path}: not a GeoJSON feature collection (no “features”)")
    marks: dict[str, RegionMark] = {}
    for number, feature in enumerate(features):
        size = content.get("width"), content.get("height")
        mark = _polygon(feature, size, f"{path}: feature {number}")
        if mark.name in marks:
            raise RegionError(f"{path}: region “{mark.name}” is there twice")
        marks[mark.name] = mark
    return marks


def _polygon(feature: Any, size: tuple[Any, Any], where: str) -> RegionMark:
    properties = feature.get("properties") if isinstance(feature, dict) else None
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    if not isinstance(properties, dict) or not isinstance(properties.get("name"), str):
        raise RegionError(f"{where}: has no properties.name")
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if not isinstance(geometry, dict) or kind not in ("Polygon", "MultiPolygon"):
        raise RegionError(f"{where}: is no Polygon or MultiPolygon")
    coordinates = geometry.get("coordinates")
    if not isinstance(coordinates, list) or not coordinates:
        raise RegionError(f"{where}: has no coordinates")
    name, hidden = properties["name"], _rings_mask(feature.get("hidden"), size, where)
    if kind == "MultiPolygon":
        if not all(isinstance(piece, list) for piece in coordinates):
            raise RegionError(f"{where}: a MultiPolygon is a list of polygons")
        mask = _rings_mask([ring for piece in coordinates for ring in piece], size, where)
        return RegionMark(name, mask=mask, hidden=hidden)
    loops = [_ring(ring, where) for ring in coordinates]
    return RegionMark(name, outline=loops[0], holes=tuple(loops[1:]), hidden=hidden)


def _rings_mask(rings: Any, size: tuple[Any, Any], where: str) -> BoolArray | None:
    if not rings:
        return None
    if not all(isinstance(side, int) and side > 0 for side in size):
        raise RegionError(
            f"{where}: hidden parts and MultiPolygons need the photo's width and height in the file"
        )
    return fill_loops([_ring(ring, where) for ring in rings], size[0], size[1])


def _ring(ring: Any, where: str) -> FloatArray:
    """Corners (n,2); GeoJSON repeats the first corner at the end."""
    try:
        corners = np.array(ring, dtype=np.float64)
    except (TypeError, ValueError):
        corners = np.empty(0)
    if corners.ndim != 2 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        raise RegionError(f"{where}: coordinates have to be a list of [u, v]")
    if len(corners) > 1 and (corners[0] == corners[-1]).all():
        corners = corners[:-1]
    return corners


def polygons_to_geojson(shapes: Mapping[str, Shape], size: tuple[int, int]) -> dict[str, Any]:
    """GeoJSON feature collection of shapes by name, in a photo of `size`, as `read_polygons` reads it."""
    features = [_feature(name, *shape) for name, shape in shapes.items()]
    width, height = size
    return {"type": "FeatureCollection", "width": width, "height": height, "features": features}


def _feature(
    name: str, pieces: Sequence[Sequence[FloatArray]], hidden: Sequence[FloatArray]
) -> dict[str, Any]:
    polygons = [[_closed(loop) for loop in piece] for piece in pieces]
    geometry: dict[str, Any] = {"type": "Polygon", "coordinates": polygons[0]}
    if len(polygons) > 1:
        geometry = {"type": "MultiPolygon", "coordinates": polygons}
    feature = {"type": "Feature", "properties": {"name": name}, "geometry": geometry}
    return feature | {"hidden": [_closed(loop) for loop in hidden]} if hidden else feature


def _closed(loop: FloatArray) -> list[list[float]]:
    corners: list[list[float]] = loop.tolist()
    return [*corners, corners[0]]
