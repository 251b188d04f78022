"""What Fresco keeps in the .blend: scan, photos with their cameras and poses, regions, settings."""

from __future__ import annotations

import json

import bpy

from .choices import (
    FrescoCompare,
    FrescoDelivery,
    FrescoExportSettings,
    FrescoMaps,
    redraw,
)
from .settings import (
    FrescoAtlasSettings,
    FrescoEdgeSettings,
    FrescoJointSettings,
    FrescoPointSettings,
    FrescoPoseSettings,
    FrescoScanSettings,
    FrescoTextureSettings,
)

PHOTO_STATES = (
    ("UNSOLVED", "Not solved", "The camera's pose is not known yet", "RADIOBUT_OFF", 0),
    ("SOLVED", "Solved", "The camera's pose was found", "CHECKMARK", 1),
    ("AMBIGUOUS", "Ambiguous", "Several poses explain the regions equally well", "QUESTION", 2),
    ("FAILED", "Not found", "No pose explains the regions", "CANCEL", 3),
    ("GIVEN", "Given", "The pose was given with the camera", "PINNED", 4),
)
POSED_STATES = {"SOLVED", "GIVEN"}


def _is_mesh(_self: object, candidate: bpy.types.Object) -> bool:
    return candidate.type == "MESH"


def _photo_chosen(self: FrescoScene, context: bpy.types.Context) -> None:
    from .bridge.photos import frame_photo

    photo = self.active_photo
    if photo is not None and photo.camera is not None:
        frame_photo(context.scene, photo)


class FrescoMark(bpy.types.PropertyGroup):
    """One region as marked in one photo: its mask."""

    region_id: bpy.props.IntProperty(description="The region that the mask shows")
    image: bpy.props.PointerProperty(
        type=bpy.types.Image, name="Mask", description="Mask: bright where the photo shows the region"
    )
    hidden: bpy.props.PointerProperty(
        type=bpy.types.Image,
        name="Hidden part",
        description="Mask: bright where something stands before the region, so that its outline is a guess",
    )


class FrescoPick(bpy.types.PropertyGroup):
    """A surveyed point as picked in one photo; its name is the point's."""

    pixel: bpy.props.FloatVectorProperty(
        name="Pixel", size=2, precision=2, description="Pixels from the centre of the top-left pixel"
    )
    active: bpy.props.BoolProperty(name="Use", default=True, description="Use this point for the pose")
    used: bpy.props.BoolProperty(description="Whether the pose rests on it")
    residual: bpy.props.FloatProperty(default=-1, description="Distance (pixels) from where the pose puts it")
    offset: bpy.props.FloatVectorProperty(size=2, description="Picked minus projected pixel")


def _point_renamed(self: FrescoPoint, _context: bpy.types.Context) -> None:
    """Let the picks of a point follow its new name; a name that is taken, or none, is not accepted."""
    if self.name == self.known_as:
        return
    fresco = self.id_data.fresco
    taken = sum(point.name == self.name for point in fresco.points) > 1
    if self.known_as and (taken or not self.name):
        self.name = self.known_as
        return
    for photo in fresco.photos if self.known_as else ():
        pick = photo.picks.get(self.known_as)
        if pick is not None:
            pick.name = self.name
    self.known_as = self.name


class FrescoPoint(bpy.types.PropertyGroup):
    """A point with known coordinates."""

    name: bpy.props.StringProperty(name="Name", update=_point_renamed)
    known_as: bpy.props.StringProperty(description="Name under which photos have its pixels")
    place: bpy.props.FloatVectorProperty(
        name="Place",
        size=3,
        subtype="TRANSLATION",
        precision=4,
        description="Coordinates in the scene, without the scan's offset",
    )


class FrescoPhoto(bpy.types.PropertyGroup):
    """A photo, its calibrated camera and its pose."""

    image: bpy.props.PointerProperty(
        type=bpy.types.Image, name="Photo", description="The original file; Fresco never changes it"
    )
    camera: bpy.props.PointerProperty(
        type=bpy.types.Object, name="Camera", description="The photo's camera in the scene"
    )
    material: bpy.props.PointerProperty(
        type=bpy.types.Material, name="Material", description="The material that shows this photo on the scan"
    )
    camera_json: bpy.props.StringProperty(description="Full calibration with lens distortion")
    camera_source: bpy.props.StringProperty(
        name="Calibration", description="Where the camera's calibration comes from"
    )
    place_told: bpy.props.StringProperty(description="How sure the satellite position in the photo is")
    mask: bpy.props.PointerProperty(
        type=bpy.types.Image, name="Usable part", description="Mask: bright where the photo may be used"
    )
    pose_json: bpy.props.StringProperty(description="Pose in double precision with its covariance")
    solution_json: bpy.props.StringProperty(description="What the solver found, with the alternatives")
    candidate: bpy.props.IntProperty(description="Which of the solver's poses is shown, 0 the best")
    marks: bpy.props.CollectionProperty(type=FrescoMark)
    picks: bpy.props.CollectionProperty(type=FrescoPick)
    use: bpy.props.BoolProperty(name="Use", default=True, description="Use this photo at all")
    use_texture: bpy.props.BoolProperty(
        name="Use for Texture",
        default=True,
        description="Use this photo for the texture, not only solve its pose",
    )
    state: bpy.props.EnumProperty(name="State", items=PHOTO_STATES, default="UNSOLVED")
    overlap: bpy.props.FloatProperty(
        name="Overlap error",
        default=-1,
        subtype="PERCENTAGE",
        precision=2,
        description="Area in which projected and marked regions differ; below 5 % is a good pose",
    )
    centre_sigma: bpy.props.FloatProperty(
        name="Position uncertainty",
        subtype="DISTANCE",
        precision=4,
        description="Standard deviation of the camera's position",
    )
    rotation_sigma: bpy.props.FloatProperty(
        name="Rotation uncertainty",
        precision=3,
        description="Standard deviation of the camera's rotation, degrees",
    )
    message: bpy.props.StringProperty(name="Message")
    hold: bpy.props.BoolProperty(
        name="Hold", description="Keep this pose when poses are refined; others are tied to it"
    )
    layer: bpy.props.StringProperty(
        name="Layer",
        description="Set that the photo gives texture with, such as infrared; each is a texture of its own",
    )
    priority: bpy.props.FloatProperty(
        name="Priority",
        min=-10,
        max=10,
        step=50,
        precision=1,
        description="Octaves of texel size by which the photo is preferred: 1 as if it were twice as fine",
    )
    refined: bpy.props.IntProperty(description="Number of refinements that the pose has gone through")
    joint_shift: bpy.props.FloatProperty(
        default=-1, description="Median distance (pixels) to the other photos, after the joint refinement"
    )

    @property
    def is_refined(self) -> bool:
        """Whether the pose was refined, and the one before is kept."""
        return self.refined > 0

    @property
    def path(self) -> str:
        """Absolute path of the original file."""
        return bpy.path.abspath(self.image.filepath) if self.image is not None else ""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the calibrated photo in pixels."""
        camera = json.loads(self.camera_json)
        return camera["width"], camera["height"]

    @property
    def is_posed(self) -> bool:
        """Whether the photo can be used for the texture."""
        return self.state in POSED_STATES

    def mark(self, region_id: int) -> FrescoMark | None:
        """Return the mark of a region in this photo."""
        return next((mark for mark in self.marks if mark.region_id == region_id), None)


class FrescoRegion(bpy.types.PropertyGroup):
    """A region of the scan: a set of faces, marked in some photos."""

    uid: bpy.props.IntProperty(description="Number that stays when the region is renamed")
    color: bpy.props.FloatVectorProperty(name="Colour", subtype="COLOR", size=3, min=0, max=1)
    face_count: bpy.props.IntProperty(name="Faces", description="Faces of the scan in this region")
    revision: bpy.props.IntProperty(description="Number that is another one whenever its faces change")
    opening_json: bpy.props.StringProperty(
        description="Corners and triangles of an opening, which has no faces, in the scan object's frame"
    )

    @property
    def is_on_scan(self) -> bool:
        """Whether it is known where the region lies on the scan: as faces, or as an opening."""
        return self.face_count > 0 or bool(self.opening_json)

    @property
    def attribute(self) -> str:
        """Name of the scan's face attribute that is true in this region."""
        return f"fresco_region_{self.uid}"


class FrescoScene(bpy.types.PropertyGroup):
    """Everything of one scene."""

    scan: bpy.props.PointerProperty(
        type=bpy.types.Object, poll=_is_mesh, name="Scan", description="The mesh that gets the texture"
    )
    scan_report: bpy.props.StringProperty(description="What the check of the scan found, one line each")
    scan_path: bpy.props.StringProperty(description="File that the scan was read from")
    photos: bpy.props.CollectionProperty(type=FrescoPhoto)
    photo_index: bpy.props.IntProperty(name="Photo", update=_photo_chosen)
    regions: bpy.props.CollectionProperty(type=FrescoRegion)
    region_index: bpy.props.IntProperty(name="Region")
    next_region: bpy.props.IntProperty(default=1)
    texture_warnings: bpy.props.StringProperty(description="What to know of the texture, one sentence a line")
    texture_report: bpy.props.StringProperty(description="Numbers of the texture, one line each")
    scan_settings: bpy.props.PointerProperty(type=FrescoScanSettings)
    pose: bpy.props.PointerProperty(type=FrescoPoseSettings)
    points: bpy.props.CollectionProperty(type=FrescoPoint)
    point_index: bpy.props.IntProperty(name="Point", update=redraw)
    point_settings: bpy.props.PointerProperty(type=FrescoPointSettings)
    edges: bpy.props.PointerProperty(type=FrescoEdgeSettings)
    joint: bpy.props.PointerProperty(type=FrescoJointSettings)
    compare: bpy.props.PointerProperty(type=FrescoCompare)
    maps: bpy.props.PointerProperty(type=FrescoMaps)
    atlas: bpy.props.PointerProperty(type=FrescoAtlasSettings)
    delivery: bpy.props.PointerProperty(type=FrescoDelivery)
    layer: bpy.props.StringProperty(description="The layer that the scan shows")
    texture: bpy.props.PointerProperty(type=FrescoTextureSettings)
    export: bpy.props.PointerProperty(type=FrescoExportSettings)

    @property
    def active_photo(self) -> FrescoPhoto | None:
        """The photo chosen in the list."""
        return self.photos[self.photo_index] if 0 <= self.photo_index < len(self.photos) else None

    @property
    def active_point(self) -> FrescoPoint | None:
        """The point chosen in the list."""
        return self.points[self.point_index] if 0 <= self.point_index < len(self.points) else None

    @property
    def active_region(self) -> FrescoRegion | None:
        """The region chosen in the list."""
        return self.regions[self.region_index] if 0 <= self.region_index < len(self.regions) else None

    def region_named(self, name: str) -> FrescoRegion | None:
        """Return the region of that name."""
        return next((region for region in self.regions if region.name == name), None)


CLASSES = (
    FrescoMark,
    FrescoPick,
    FrescoPoint,
    FrescoPhoto,
    FrescoRegion,
    FrescoScene,
)


def attach() -> None:
    """Hang Fresco's data on the scene."""
    bpy.types.Scene.fresco = bpy.props.PointerProperty(type=FrescoScene)


def detach() -> None:
    """Take the data's definition away; what is stored in files stays there."""
    del bpy.types.Scene.fresco
