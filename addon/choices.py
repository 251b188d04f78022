"""What the user chooses for refinement, maps, delivery and export, beside core's own settings."""

from __future__ import annotations

import json
from pathlib import Path

import bpy


def redraw(_self: object, context: bpy.types.Context) -> None:
    """Draw photos and views again: what is drawn over them has changed."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"VIEW_3D", "IMAGE_EDITOR"}:
                area.tag_redraw()


# Blender 4.5 warns of relative paths in properties that do not say that they take them.
RELATIVE_PATH = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()


class FrescoExportSettings(bpy.types.PropertyGroup):
    """What an export writes."""

    folder: bpy.props.StringProperty(
        name="Folder",
        subtype="DIR_PATH",
        default="//fresco/",
        options=RELATIVE_PATH,
        description="Folder for all exported files; // is that of the .blend",
    )
    name: bpy.props.StringProperty(
        name="File name", default="", description="Name of the files, without ending; empty: the scan's name"
    )
    write_glb: bpy.props.BoolProperty(
        name="glTF (.glb)", default=True, description="One file with scan, texture and cameras"
    )
    write_obj: bpy.props.BoolProperty(
        name="OBJ (.obj)",
        default=True,
        description="Scan in true coordinates, its materials naming the original photos",
    )
    write_report: bpy.props.BoolProperty(
        name="Report (.html)", default=True, description="One page with pictures and numbers"
    )
    write_blend: bpy.props.BoolProperty(
        name="Blender (.blend)", default=False, description="A copy of this .blend beside the rest"
    )

    @staticmethod
    def default_name(scene: bpy.types.Scene) -> str:
        """File name without ending where the user gave none: the scan file's."""
        fresco = scene.fresco
        if fresco.scan_path:
            return Path(fresco.scan_path).stem
        return bpy.path.clean_name(fresco.scan.name) if fresco.scan is not None else "scan"


class FrescoCompare(bpy.types.PropertyGroup):
    """How a refinement is done, and looked at over the photo."""

    lenses: bpy.props.BoolProperty(
        name="Adjust Lenses",
        description="Refining all together adjusts focal length, principal point and radial distortion, too",
    )

    blend: bpy.props.FloatProperty(
        name="Before / After",
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=redraw,
        description="The scan's edges as the pose before refinement (0) and the present one (1) put them",
    )
    edges: bpy.props.BoolProperty(
        name="Edges of the scan", default=True, update=redraw, description="Draw them over the photo"
    )
    residuals: bpy.props.BoolProperty(
        name="Residuals",
        default=True,
        update=redraw,
        description="Draw lines from the scan's edges to where the photo shows them, in the Image Editor",
    )
    ties: bpy.props.BoolProperty(
        name="Ties",
        default=True,
        update=redraw,
        description="Draw lines from where the pose puts what other photos show to where this one shows it",
    )
    scale: bpy.props.FloatProperty(
        name="Enlarged",
        default=10.0,
        min=1.0,
        max=1000.0,
        update=redraw,
        description="Residuals are drawn so many times as long as they are, of edges, ties and points",
    )


class FrescoMaps(bpy.types.PropertyGroup):
    """The map that is shown, and what was asked of coverage."""

    legend: bpy.props.StringProperty(description="Legend of the map that is shown, as JSON")
    coverage: bpy.props.StringProperty(description="Numbers of the coverage, one line each")
    wanted_texel: bpy.props.FloatProperty(
        name="Wanted pixel",
        default=0.002,
        min=1e-5,
        subtype="DISTANCE",
        precision=4,
        description="Size on the surface that a photo's pixel should have at most",
    )
    count: bpy.props.IntProperty(
        name="Places", default=5, min=1, max=50, description="Number of places for further photos"
    )


class FrescoDelivery(bpy.types.PropertyGroup):
    """What is done to colours in atlas and vertex colours."""

    level: bpy.props.BoolProperty(
        name="Level seams", default=True, description="Level the seams that one gain per photo leaves"
    )
    untouched: bpy.props.BoolProperty(
        name="Untouched colours",
        description="Keep the pixels' colours as they are: no gains, no levelling, no blending",
    )
    simplify_by: bpy.props.EnumProperty(
        name="Simplify to",
        items=[
            ("FACES", "Faces", "A number of faces"),
            ("TOLERANCE", "Tolerance", "The fewest faces that stay within a distance of the scan"),
        ],
    )
    simplify_faces: bpy.props.IntProperty(
        name="Faces", default=50_000, min=4, description="Faces of the simplified model"
    )
    simplify_tolerance: bpy.props.FloatProperty(
        name="Tolerance",
        default=0.002,
        min=1e-6,
        subtype="DISTANCE",
        precision=4,
        description="Distance from the scan that 95 % of the simplified model's surface keep within",
    )
    charts_json: bpy.props.StringProperty(description="The colour charts that were found, by layer, as JSON")

    @property
    def chart_told(self) -> str:
        """What the colour charts do, in words; nothing without one."""
        charts = json.loads(self.charts_json or "{}")
        return "; ".join(
            f"{layer}: {chart['told']}" if layer else chart["told"] for layer, chart in charts.items()
        )


CLASSES = (FrescoExportSettings, FrescoCompare, FrescoMaps, FrescoDelivery)
