"""Settings dataclasses from the tables of a project file."""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from typing import Any, TypeVar

from ...settings import (
    AtlasSettings,
    EdgeSettings,
    JointSettings,
    PointSettings,
    PoseSettings,
    ScanSettings,
    TextureSettings,
)
from .table import Table

Settings = TypeVar(
    "Settings",
    ScanSettings,
    PoseSettings,
    PointSettings,
    EdgeSettings,
    JointSettings,
    TextureSettings,
    AtlasSettings,
)

_RANGES = {
    "weld_distance": (0.0, 1.0),
    "unit": (1e-6, 1e4),
    "overlap_limit": (0.01, 50.0),
    "max_angle": (1.0, 90.0),
    "uv_tolerance": (0.01, 100.0),
    "visible_share": (0.0, 1.0),
    "clipped_level": (1.0, 255.0),
    "max_candidates": (1.0, 1000.0),
    "confidence": (0.5, 1.0),
    "photo_size": (64.0, 65536.0),
    "min_share": (0.0, 1.0),
    "max_parallax": (1.0, 180.0),
    "page_size": (64.0, 32768.0),
    "padding": (0.0, 256.0),
    "blend_rings": (0.0, 64.0),
}
"""Range of the settings that have an upper end too; other numbers are at least 0."""


def read_settings(table: Table, kind: type[Settings]) -> Settings:
    """Settings from the keys of a table; keys that are not there keep their default.

    Raises ProjectError for a value of the wrong type or out of range.
    """
    hints = typing.get_type_hints(kind)
    values: dict[str, Any] = {
        field.name: _value(table, field.name, hints[field.name])
        for field in dataclasses.fields(kind)
        if field.name in table
    }
    table_knows = {field.name for field in dataclasses.fields(kind)}
    table.offer(table_knows)
    return kind(**values)


def _value(table: Table, key: str, hint: Any) -> Any:
    """Value of a key, of the type that the dataclass declares."""
    origin = typing.get_origin(hint)
    if origin in (types.UnionType, typing.Union):  # optional: to leave it out is the way to say None
        hint = next(part for part in typing.get_args(hint) if part is not type(None))
        origin = typing.get_origin(hint)
    if origin is typing.Literal:
        return _choice(table, key, typing.get_args(hint))
    if origin is tuple:
        return table.numbers(key, [len(typing.get_args(hint))])
    if hint is bool:
        return table.flag(key, False)
    if hint is str:
        return table.text(key)
    low, high = _RANGES.get(key, (0.0, math.inf))
    number = table.number(key, low, high)
    if hint is int and number != int(number):
        table.fail(key, f"has to be a whole number, not {number:g}")
    return int(number) if hint is int else number


def _choice(table: Table, key: str, options: tuple[Any, ...]) -> Any:
    """One of some words or numbers."""
    if all(isinstance(option, str) for option in options):
        return table.choice(key, options, "")
    number = table.number(key)
    if number not in options:
        table.fail(key, f"has to be one of {', '.join(map(str, options))}, not {number:g}")
    return options[options.index(number)]
