"""A project as its file describes it, checked: what to read, what to solve, what to write.

Nothing here holds pixels or vertices. Poses are in the world of the scan's file, in metres.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from ..arrays import FloatArray
from ..photos.photo import Photo
from ..settings import PoseSettings, ScanSettings, TextureSettings
from .imported import ImportedCameras
from .stages.colour_chart import ColourChartEntry
from .stages.delivery import DeliverySettings
from .stages.point_poses import Picks, PointsEntry
from .stages.refinement import RefineSettings
from .stages.simplified import SimplifySettings

Use = Literal["texture", "pose", "none"]


@dataclass(frozen=True)
class ScanEntry:
    """The scan and what only hides it (`occluders`: they get no texture)."""

    path: Path
    settings: ScanSettings = field(default_factory=ScanSettings)
    occluders: tuple[Path, ...] = ()


@dataclass(frozen=True)
class LabelSource:
    """An array in a file (.npy, or .npz with its `key`) that says which faces of the scan make a region.

    With `names` it holds a number per face and `names` says what the numbers mean; without, it holds the
    indices of the faces of the region `name`.
    """

    path: Path
    key: str = ""
    names: Mapping[int, str] = field(default_factory=dict)
    name: str = ""

    @property
    def region_names(self) -> list[str]:
        """Names of the regions it defines."""
        return list(self.names.values()) or [self.name]


@dataclass(frozen=True)
class RegionEntries:
    """Where the scan's regions come from: label arrays and face sets (region name -> face set's name).

    `all_face_sets` takes every named face set of the scan. `kept` is a file of regions that are found again
    by where they lie (see `regions.surface_files`). `outlines` are the openings, which have no faces: region
    name -> corners (n,3), metres, in the world of the scan's file. `unplaced` are regions that are marked in
    photos only.
    """

    labels: tuple[LabelSource, ...] = ()
    face_sets: Mapping[str, str] = field(default_factory=dict)
    all_face_sets: bool = False
    kept: Path | None = None
    outlines: Mapping[str, FloatArray] = field(default_factory=dict)
    unplaced: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class PhotoEntry:
    """A photo of the project; a given `pose` (rotation (3,3), translation (3,)) is not solved again.

    `imported` is its pose in the world of the program that its camera was imported from. `refine` tells
    whether its pose may be moved by refinement; others are tied to one that may not. `layer` names the set of
    photos that it belongs to (raking light, infrared); `priority` prefers it for texture, in octaves of texel
    size. `picks` are the pixels of surveyed points, by name. A `telephoto` shot is placed by the others.
    """

    photo: Photo
    use: Use = "texture"
    pose: tuple[FloatArray, FloatArray] | None = None
    refine: bool = True
    imported: tuple[FloatArray, FloatArray] | None = None
    layer: str = ""
    priority: float = 0.0
    picks: Picks = field(default_factory=dict)
    telephoto: bool = False


@dataclass(frozen=True)
class OutputEntry:
    """What is written, and where; `name` begins the name of every file.

    `cameras` are the formats of other programs that the solved cameras are written in; `colours` asks for a
    .ply with a colour per vertex.
    """

    folder: Path
    name: str
    blend: bool = True
    glb: bool = True
    obj: bool = True
    report: bool = True
    cameras: tuple[str, ...] = ()
    colours: bool = False


@dataclass(frozen=True, eq=False)
class Project:
    """A checked project file; `up` (3,) is the direction that points up in upright photos, if told."""

    path: Path
    scan: ScanEntry
    regions: RegionEntries
    photos: tuple[PhotoEntry, ...]
    pose: PoseSettings
    up: FloatArray | None
    refine: RefineSettings
    texture: TextureSettings
    output: OutputEntry
    cameras: ImportedCameras | None = None
    atlas: DeliverySettings | None = None
    points: PointsEntry | None = None
    simplify: SimplifySettings | None = None
    charts: tuple[ColourChartEntry, ...] = ()
