"""Core's settings as Blender properties: one group per dataclass, made from its fields and their texts.

The unit is read from the field's text, "(m)", "(degrees)", "(%)" or "(pixels)", so that a settings dataclass
is written once, in core.
"""

from __future__ import annotations

import dataclasses
import typing
from typing import Any, TypeVar

import bpy
import numpy as np

from ..core.settings import (
    AtlasSettings,
    EdgeSettings,
    JointSettings,
    PointSettings,
    PoseSettings,
    ScanSettings,
    TextureSettings,
    field_texts,
)

Settings = TypeVar("Settings")
NONE = -1
"""Blender's number for None in settings that may have none."""
_LABELS = {"epsg": "EPSG"}


def _number(default: float, text: str, common: dict[str, Any]) -> Any:
    if "(m)" in text:
        return bpy.props.FloatProperty(default=default, min=0, subtype="DISTANCE", precision=4, **common)
    if "(%)" in text:
        return bpy.props.FloatProperty(
            default=default, min=0, max=100, subtype="PERCENTAGE", precision=1, **common
        )
    if "(pixels)" in text:
        return bpy.props.FloatProperty(default=default, min=0, subtype="PIXEL", precision=2, **common)
    return bpy.props.FloatProperty(default=default, precision=3, **common)


def _property(field: dataclasses.Field[Any], kind: Any, text: str) -> Any:
    """Blender property for a field of a settings dataclass, or None for a kind that has no widget."""
    default = field.default
    if type(None) in typing.get_args(kind):
        kind = next(part for part in typing.get_args(kind) if part is not type(None))
        default, text = (
            NONE if kind is int and default is None else default,
            f"{text.rstrip('.')}; {NONE} is none",
        )
    common = {
        "name": _LABELS.get(field.name, field.name.replace("_", " ").capitalize()),
        "description": " ".join(text.split()).rstrip("."),
    }
    if typing.get_origin(kind) is typing.Literal:
        words = [str(word) for word in typing.get_args(kind)]  # Blender's choices are texts
        items = [(word, word.replace("_", " ").capitalize(), "") for word in words]
        return bpy.props.EnumProperty(items=items, default=str(default), **common)
    if isinstance(default, bool):
        return bpy.props.BoolProperty(default=default, **common)
    if isinstance(default, int):
        return bpy.props.IntProperty(default=default, **common)
    if isinstance(default, float):
        return _number(default, text, common)
    if isinstance(default, str):
        return bpy.props.StringProperty(default=default, **common)
    return None


def mirror(dataclass: type) -> type[bpy.types.PropertyGroup]:
    """Make the property group of a settings dataclass."""
    texts = field_texts(dataclass)
    kinds = typing.get_type_hints(dataclass)
    fields = dataclasses.fields(dataclass)
    properties = {f.name: _property(f, kinds[f.name], texts.get(f.name, "")) for f in fields}
    annotations = {name: value for name, value in properties.items() if value is not None}
    namespace = {"__annotations__": annotations, "__doc__": dataclass.__doc__, "__module__": __name__}
    return type(f"Fresco{dataclass.__name__}", (bpy.types.PropertyGroup,), namespace)


FrescoScanSettings = mirror(ScanSettings)
FrescoPoseSettings = mirror(PoseSettings)
FrescoEdgeSettings = mirror(EdgeSettings)
FrescoJointSettings = mirror(JointSettings)
FrescoPointSettings = mirror(PointSettings)
FrescoTextureSettings = mirror(TextureSettings)
FrescoAtlasSettings = mirror(AtlasSettings)


def _as_typed(value: Any, kind: Any) -> Any:
    """Undo Blender's single precision: 0.1 is kept as 0.100000001; its shortest text gives 0.1 again."""
    if value == NONE and type(None) in typing.get_args(kind):
        return None
    if typing.get_origin(kind) is typing.Literal:
        return next(word for word in typing.get_args(kind) if str(word) == value)
    return float(str(np.float32(value))) if isinstance(value, float) else value


def to_core(group: bpy.types.PropertyGroup, dataclass: type[Settings]) -> Settings:
    """Core's settings with the values of a property group."""
    names = [f.name for f in dataclasses.fields(dataclass) if f.name in group.__annotations__]
    kinds = typing.get_type_hints(dataclass)
    return dataclass(**{name: _as_typed(getattr(group, name), kinds[name]) for name in names})


def from_core(group: bpy.types.PropertyGroup, values: Any) -> None:
    """Give a property group the values of core's settings."""
    for field in dataclasses.fields(values):
        if field.name in group.__annotations__:
            value = getattr(values, field.name)
            if group.bl_rna.properties[field.name].type == "ENUM":
                value = str(value)
            setattr(group, field.name, NONE if value is None else value)


def draw_settings(layout: bpy.types.UILayout, group: bpy.types.PropertyGroup) -> None:
    """Draw all settings of a group."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    column = layout.column()
    for name in group.__annotations__:
        column.prop(group, name)


CLASSES = (
    FrescoScanSettings,
    FrescoPoseSettings,
    FrescoEdgeSettings,
    FrescoJointSettings,
    FrescoPointSettings,
    FrescoTextureSettings,
    FrescoAtlasSettings,
)
