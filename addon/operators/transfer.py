"""Carry the scan's regions into photos whose pose is known at least roughly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy

from ...core.arrays import FloatArray
from ...core.cameras import Camera
from ...core.errors import RegionError
from ...core.geometry.rays import RayCaster
from ...core.jobs import Job, Progress
from ...core.regions.transfer import TransferredRegion, transfer_region
from ..background import beside_job
from ..bridge import photos as photo_bridge
from ..bridge import proposals as bridge
from ..bridge.regions import SurfaceSource, surface_source
from ..bridge.rough_poses import nearest_posed
from ..jobs import JobOperator
from ..properties import FrescoPhoto
from ..tools.prepared import read_pixels
from .proposals import worked_photo
from .regions import has_scan

Placed = tuple[FloatArray, FloatArray]
ROUGH_POSES = (
    ("POSED", "Solved Photos", "Photos whose pose is known"),
    ("PLACED", "Camera as Placed", "The chosen photo, from where its camera stands now"),
    (
        "NEIGHBOUR",
        "Like Its Neighbour",
        "The chosen photo, as if taken from where the nearest solved photo in the list was",
    ),
)


@dataclass(frozen=True, eq=False)
class TransferTarget:
    """A photo that regions are carried into: file, camera, rough pose, and the regions it shows already."""

    photo: str
    path: str
    camera: Camera
    pose: Placed
    marked: frozenset[str]


Transfers = list[tuple[str, str, TransferredRegion]]


class FRESCO_OT_transfer_regions(JobOperator):
    bl_idname = "fresco.transfer_regions"
    bl_label = "Carry into Photos"
    bl_description = (
        "Project the scan's regions into photos whose pose is known at least roughly, and move the outlines "
        "onto their edges. You choose what to accept"
    )
    bl_options = {"REGISTER", "UNDO"}
    step = "regions"

    rough: bpy.props.EnumProperty(name="Photos", items=ROUGH_POSES, description="Which photos, from where")
    reach: bpy.props.FloatProperty(
        name="Reach",
        default=1.0,
        min=0.05,
        max=10,
        subtype="PERCENTAGE",
        description="How far, of the photo's longer side, an outline may move",
    )

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_scan(cls, context):
            return False
        cls.poll_message_set("Mark regions on the scan, and solve a photo first")
        regions = context.scene.fresco.regions
        return any(r.is_on_scan for r in regions) and any(p.is_posed for p in context.scene.fresco.photos)

    def start(self, context: bpy.types.Context) -> Job[tuple[Transfers, list[str]]]:
        found = self.targets(context)
        if not found:
            raise RegionError("No photo has a pose yet, or all show every region already.")
        return beside_job(transfer_job(surface_source(context.scene), found, self.reach / 100))

    def targets(self, context: bpy.types.Context) -> list[TransferTarget]:
        """Photos to carry regions into, with their rough poses."""
        scene = context.scene
        if self.rough == "POSED":
            photos = [p for p in scene.fresco.photos if p.is_posed and p.use]
            poses = [photo_bridge.read_pose(scene, p)[:2] for p in photos]
        else:
            chosen = worked_photo(context)
            photos = [] if chosen is None or not chosen.camera_json else [chosen]
            poses = [self.rough_pose(scene, photo) for photo in photos]
        names = {region.uid: region.name for region in scene.fresco.regions}
        return [
            TransferTarget(
                photo.name,
                photo.path,
                photo_bridge.read_camera(photo),
                pose,
                frozenset(names[mark.region_id] for mark in photo.marks if mark.region_id in names),
            )
            for photo, pose in zip(photos, poses, strict=True)
        ]

    def rough_pose(self, scene: bpy.types.Scene, photo: FrescoPhoto) -> Placed:
        """Where a photo without pose may have been taken."""
        if self.rough == "PLACED":
            return photo_bridge.read_pose(scene, photo)[:2]
        return photo_bridge.read_pose(scene, nearest_posed(scene, photo))[:2]

    def finish(self, context: bpy.types.Context, result: tuple[Transfers, list[str]]) -> None:
        scene, (found, failures) = context.scene, result
        for photo in {name for name, _, _ in found}:
            bridge.discard_all(scene, {"TRANSFER"}, photo)
        for photo, name, transferred in found:
            region = scene.fresco.region_named(name)
            note = f"{photo}, moved {transferred.shift:.1f} px, {100 * transferred.seen:.0f} % seen"
            item = scene.fresco.photos[photo]
            bridge.add_outlines(scene, item, transferred.region.loops, name, note, region)
        if not found:
            raise RegionError("No region could be carried over. " + " ".join(failures[:3]))
        self.report({"INFO"}, f"{len(found)} marks proposed, {len(failures)} left out")


def transfer_job(
    source: SurfaceSource, found: Sequence[TransferTarget], share: float
) -> Job[tuple[Transfers, list[str]]]:
    """Carry all regions into photos; `share` of a photo's longer side is how far outlines may move."""
    yield Progress(0.0, "Reading the scan")
    surfaces = source.regions()
    caster = RayCaster(source.vertices, source.faces)
    transfers: Transfers = []
    failures: list[str] = []
    for number, target in enumerate(found):
        wanted = [name for name in surfaces if name not in target.marked]
        yield Progress(number / len(found), f"Carrying {len(wanted)} regions into {target.photo}")
        pixels = read_pixels(target.path) if wanted else None
        reach = share * max(target.camera.width, target.camera.height)
        for name in wanted:
            yield Progress(number / len(found), f"Carrying {name} into {target.photo}")
            try:
                moved = transfer_region(pixels, target.camera, *target.pose, surfaces[name], reach, caster)
            except RegionError as error:
                failures.append(f"{target.photo}: {error}")
                continue
            transfers.append((target.photo, name, moved))
    return transfers, failures


CLASSES = (FRESCO_OT_transfer_regions,)
