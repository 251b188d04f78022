"""Regions of the scan in a project file: [regions] and [[region]]."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...arrays import FloatArray
from ..entries import LabelSource, RegionEntries
from .table import Table


def read_regions(root: Table) -> RegionEntries:
    """Regions of the scan: [regions] for many at once, [[region]] for single ones; else all face sets."""
    many = root.table("regions")
    single = root.tables("region")
    labels = [*_label_array(many), *(source for table in single for source in _single_label(table))]
    face_sets = {table.text("name"): table.text("face_set") for table in single if "face_set" in table}
    outlines = {table.text("name"): _outline(table) for table in single if "outline" in table}
    many.offer(("kept",))
    chosen = many.get("face_sets", not labels and not face_sets and not outlines and "kept" not in many)
    if isinstance(chosen, list):
        face_sets |= {str(name): str(name) for name in chosen}
    elif not isinstance(chosen, bool):
        many.fail("face_sets", "has to be true, false, or a list of names")
    kept, unplaced = many.path("kept") if "kept" in many else None, many.texts("unplaced")
    many.finish()
    names = [*face_sets, *outlines, *unplaced, *(name for source in labels for name in source.region_names)]
    for name in names:
        if names.count(name) > 1:
            root.fail("region", f"“{name}” is there twice")
    return RegionEntries(tuple(labels), face_sets, chosen is True, kept, outlines, unplaced)


def _outline(table: Table) -> FloatArray:
    """Corners (n,3) of an opening."""
    rows = table.get("outline")
    if not isinstance(rows, list) or len(rows) < 3:
        table.fail("outline", "has to be a list of three or more corners [x, y, z]")
    return np.array(table.matrix("outline", len(rows), 3))


def _label_array(table: Table) -> list[LabelSource]:
    if "labels" not in table:
        table.offer(("labels", "key", "names"))
        if "names" in table:
            table.fail("labels", "is missing; names belong to the numbers of a label array")
        return []
    names = table.table("names", required=True)
    meaning: dict[int, str] = {}
    for name in names.values:
        number = names.number(name, 0)
        if number != int(number) or int(number) in meaning:
            names.fail(name, "has to be a whole number that no other name has")
        meaning[int(number)] = name
    if not meaning:
        table.fail("names", "is empty; give name = number for every region")
    return [LabelSource(_array_file(table, "labels"), table.text("key", ""), meaning)]


def _single_label(table: Table) -> list[LabelSource]:
    """One [[region]]: `labels` with `id`, `faces` (indices); none for a `face_set` or an `outline`."""
    name = table.text("name")
    given = [key for key in ("labels", "faces", "face_set", "outline") if key in table]
    table.offer(("labels", "faces", "face_set", "outline", "id", "key"))
    table.finish()
    if len(given) != 1:
        table.fail("face_set", "give one of face_set, labels (with id), faces, outline")
    if given[0] in ("face_set", "outline"):
        return []
    path, key = _array_file(table, given[0]), table.text("key", "")
    if given == ["faces"]:
        return [LabelSource(path, key, name=name)]
    number = table.number("id", 0)
    if number != int(number):
        table.fail("id", f"has to be a whole number, not {number:g}")
    return [LabelSource(path, key, {int(number): name})]


def _array_file(table: Table, key: str) -> Path:
    path = table.path(key)
    if path.suffix.lower() not in (".npz", ".npy"):
        table.fail(key, f"has to be a .npy or .npz file, not {path.name}")
    return path
