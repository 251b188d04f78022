"""Propose which regions of a photo and of the scan are partners, and carry regions into other photos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import bpy

from ...core.arrays import FloatArray
from ...core.cameras import Camera
from ...core.errors import RegionError
from ...core.geometry.rays import RayCaster
from ...core.jobs import Job, Progress, part
from ...core.pose.regions.estimate import estimate_pose
from ...core.pose.regions.region_pose import RegionPose
from ...core.regions import ImageRegion, SurfaceRegion
from ...core.regions.partners import PairingProposal, propose_pairings_job, propose_partners
from ...core.regions.transfer import TransferredRegion, transfer_region
from ...core.settings import PoseSettings
from ..background import beside_job
from ..bridge import photos as photo_bridge
from ..bridge import proposals as bridge
from ..bridge.images import MaskSource, mask_source
from ..bridge.regions import SurfaceSource, region_of, surface_source
from ..jobs import JobOperator
from ..properties import FrescoPhoto
from ..settings import to_core
from ..tools.prepared import read_pixels
from .proposals import worked_photo
from .regions import has_scan

ROUGHLY_POSED = {"SOLVED", "GIVEN", "AMBIGUOUS"}
Placed = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class PartnerSearch:
    """Marks of a photo by region number, the scan, and the rough pose of the photo if there is one."""

    camera: Camera
    marks: Mapping[int, MaskSource]
    source: SurfaceSource
    names: Mapping[int, str]
    pose: Placed | None
    settings: PoseSettings


@dataclass(frozen=True, eq=False)
class FoundPartners:
    """Pairs of region numbers (photo, scan) with what they score, and the pose where it was tried."""

    pairs: tuple[tuple[int, int], ...]
    note: str
    pose: RegionPose | None = None


class FRESCO_OT_propose_partners(JobOperator):
    bl_idname = "fresco.propose_partners"
    bl_label = "Propose Partners"
    bl_description = (
        "Find which regions of this photo and of the scan are the same: by the photo's pose where there is "
        "one, else by trying them with the pose solver. You choose what to accept"
    )
    bl_options = {"REGISTER", "UNDO"}
    step = "regions"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_scan(cls, context):
            return False
        cls.poll_message_set("Choose a photo with a calibrated camera, in which a region is marked")
        photo = worked_photo(context)
        return photo is not None and bool(photo.camera_json) and len(photo.marks) > 0

    def start(self, context: bpy.types.Context) -> Job[list[FoundPartners]]:
        scene, photo = context.scene, worked_photo(context)
        self._photo = photo.name
        marks = {mark.region_id: mask_source(mark.image) for mark in photo.marks if mark.image is not None}
        names = {region.uid: region.name for region in scene.fresco.regions}
        pose = photo_bridge.read_pose(scene, photo)[:2] if photo.state in ROUGHLY_POSED else None
        camera = photo_bridge.read_camera(photo)
        settings = to_core(scene.fresco.pose, PoseSettings)
        search = PartnerSearch(camera, marks, surface_source(scene), names, pose, settings)
        return beside_job(partners_job(search))

    def finish(self, context: bpy.types.Context, result: list[FoundPartners]) -> None:
        scene = context.scene
        photo = scene.fresco.photos[self._photo]
        bridge.discard_all(scene, {"PARTNERS"}, photo.name)
        for found in result:
            pairs = [(region_of(scene, first), region_of(scene, second)) for first, second in found.pairs]
            bridge.add_partners(scene, photo, pairs, found.note, found.pose)
        if not result:
            raise RegionError(
                f"{photo.name}: no pairing of its regions with those of the scan gives a pose. Mark the same "
                "patch on both, with a whole and sharp outline."
            )
        self.report({"INFO"}, f"{len(result)} partnerships proposed for {photo.name}")


def partners_job(search: PartnerSearch) -> Job[list[FoundPartners]]:
    """Partners by projecting with a rough pose, or by trying with the solver."""
    yield Progress(0.0, "Reading the regions")
    surfaces = search.source.regions()
    names = search.names
    images = {uid: ImageRegion.from_mask(mask.read(), names[uid]) for uid, mask in search.marks.items()}
    paired = [uid for uid in images if search.names[uid] in surfaces]
    free = [uid for uid in images if uid not in paired]
    others = [
        uid for uid, name in search.names.items() if name in surfaces and uid not in images
    ]  # not marked here yet
    if not free or not others:
        raise RegionError(
            "Every region has its partner already: mark a region in the photo that the scan does not have, "
            "and one on the scan that this photo does not have."
        )
    regions = [images[uid] for uid in free]
    patches = [surfaces[search.names[uid]] for uid in others]
    if search.pose is not None:
        found = propose_partners(search.camera, *search.pose, regions, patches)
        return [FoundPartners(((free[i], others[j]),), f"overlap {share:.0%}") for i, j, share in found]
    known = [(images[uid], surfaces[search.names[uid]]) for uid in paired]
    job = propose_pairings_job(search.camera, solver(search, known), regions, patches)
    tried = yield from part(job, 0.1, 1.0)
    return [
        FoundPartners(tuple((free[i], others[j]) for i, j in trial.pairs), pairing_note(trial), trial.pose)
        for trial in tried
    ]


def solver(search: PartnerSearch, known: Sequence[tuple[ImageRegion, SurfaceRegion]]) -> object:
    """Pose solver for trial pairs, which keeps the pairs that are `known`."""

    def solve(images: Sequence[ImageRegion], surfaces: Sequence[SurfaceRegion]) -> RegionPose:
        pairs = [*known, *zip(images, surfaces, strict=True)]
        return estimate_pose(
            search.camera, [a for a, _ in pairs], [b for _, b in pairs], settings=search.settings
        )

    return solve


def pairing_note(trial: PairingProposal) -> str:
    """Say how well a tried pairing fits."""
    doubt = ", ambiguous" if trial.pose.ambiguous else ""
    return f"overlap error {trial.error:.1f} %{doubt}"


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
        photos = list(scene.fresco.photos)
        here = photos.index(photo)
        posed = [k for k, other in enumerate(photos) if other.is_posed and k != here]
        if not posed:
            raise RegionError("No other photo is solved yet.")
        return photo_bridge.read_pose(scene, photos[min(posed, key=lambda k: abs(k - here))])[:2]

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


CLASSES = (FRESCO_OT_propose_partners, FRESCO_OT_transfer_regions)
