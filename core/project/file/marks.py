"""Marks of photos in a project file: masks by name, patterns of masks, files of polygons."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from ...errors import FrescoError, RegionError
from ...photos.image import SUFFIXES, image_size
from ...photos.marks import RegionMark, read_polygons
from .table import Table

HIDDEN = ".hidden"
"""Ending of a mask's name that shows what stands before a region."""


def read_marks(table: Table | None, photo: str, size: tuple[int, int]) -> Iterator[RegionMark]:
    """Marks of a photo (its file name without suffix, its width and height).

    `regions` of its table is a table of masks by name, a pattern of masks, or a file of polygons. A mask
    named REGION.hidden shows what stands before that region. Raises ProjectError.
    """
    value = None if table is None else table.get("regions")
    if table is None:
        return
    if isinstance(value, dict):
        of_photo = table.table("regions")
        yield from _mask_marks({name: of_photo.path(name) for name in value}, table, size)
    elif isinstance(value, str) and "{region}" in value:
        yield from _mask_marks(dict(_matching(photo, table, value)), table, size)
    elif isinstance(value, str):
        yield from _polygons(photo, table, value)
    else:
        table.fail(
            "regions",
            "has to be a table { name = mask file }, a pattern like masks/{photo}/{region}.png, "
            "or a file of polygons",
        )


def _polygons(photo: str, table: Table, pattern: str) -> Iterator[RegionMark]:
    """Polygons from the file that a pattern with perhaps {photo} names; a photo may have none."""
    path = table.resolve(pattern.replace("{photo}", photo))
    if path.suffix.lower() in SUFFIXES:
        table.fail(
            "regions",
            f"{pattern} does not say which region it marks: put {{region}} into its file name, or write "
            f'{{ name = "{pattern}" }} with the name of the region',
        )
    try:
        yield from read_polygons(path).values() if path.is_file() else ()
    except RegionError as error:
        table.fail("regions", str(error))


def _matching(photo: str, table: Table, pattern: str) -> Iterator[tuple[str, Path]]:
    """Region names and masks that fit a pattern with {region} and perhaps {photo}; a photo may have none."""
    head, _, tail = pattern.replace("{photo}", photo).partition("{region}")
    if "/" in tail or "\\" in tail:
        table.fail("regions", "{region} has to be in the file name, the last part of the pattern")
    full = table.resolve(head + "x")
    begin = full.name[:-1]
    folder = full.parent
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.name.startswith(begin) and path.name.endswith(tail) and path.is_file():
            name = path.name[len(begin) : len(path.name) - len(tail)]
            if name:
                yield name, path


def _mask_marks(masks: Mapping[str, Path], table: Table, size: tuple[int, int]) -> Iterator[RegionMark]:
    """Marks by the names of their masks; those of hidden parts go to their regions."""
    for name, path in masks.items():
        check_mask_size(path, table, "regions", size)
        region = name.removesuffix(HIDDEN)
        if region == name:
            yield RegionMark(name, path, hidden_path=masks.get(name + HIDDEN))
        elif region not in masks:
            table.fail("regions", f"{path} shows what hides “{region}”, but that region is not marked there")


def check_mask_size(path: Path, table: Table, key: str, size: tuple[int, int]) -> None:
    """Compare a mask's header with its photo; whether it is empty shows when it is read."""
    try:
        width, height = image_size(path)
    except FrescoError as error:
        table.fail(key, str(error).replace("photo", "mask").replace(" from the camera", ""))
    if (width, height) != size:
        turned = " (it was made on the turned photo, turn it back)" if (height, width) == size else ""
        table.fail(key, f"{path} is {width} x {height} pixels, its photo {size[0]} x {size[1]}{turned}")
