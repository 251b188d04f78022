"""Propose which regions of a photo and of the scan are partners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import bpy

from ...core.cameras import Camera
from ...core.errors import PhotoError, RegionError
from ...core.jobs import Job, Progress, part
from ...core.photos.rough_pose import RoughPose
from ...core.pose.regions.estimate import estimate_pose
from ...core.pose.regions.region_pose import RegionPose
from ...core.regions import ImageRegion, SurfaceRegion
from ...core.regions.partners import PairingProposal, propose_pairings_job
from ...core.regions.rough_partners import RoughPairing, propose_rough_partners_job
from ...core.settings import PoseSettings
from ..background import beside_job
from ..bridge import photos as photo_bridge
from ..bridge import proposals as bridge
from ..bridge.images import MaskSource, mask_source
from ..bridge.regions import SurfaceSource, region_of, surface_source
from ..bridge.rough_poses import (
    PositionSource,
    known_poses,
    neighbour_pose,
    placed_pose,
    position_source,
)
from ..jobs import JobOperator
from ..properties import FrescoPhoto
from ..settings import to_core
from .proposals import worked_photo
from .regions import has_scan

GUIDES = (
    ("KNOWN", "What Is Known", "The photo's pose, else where it says it was taken, else by trying"),
    ("POSITION", "Satellite Position", "Where the photo says it was taken, and by its compass or gimbal"),
    ("NEIGHBOUR", "Like Its Neighbour", "As if taken next to the nearest solved photo in the list"),
    ("PLACED", "Camera as Placed", "From where its camera stands now"),
    ("NONE", "Nothing", "All pairs are tried with the pose solver"),
)
TRYING = "trying all pairs"


@dataclass(frozen=True, eq=False)
class PartnerSearch:
    """Marks of a photo by region number, the scan, and what tells the photo's pose roughly.

    `poses` are alternatives; without any `position` may tell one, which it must if it is `needed`.
    """

    camera: Camera
    marks: Mapping[int, MaskSource]
    source: SurfaceSource
    names: Mapping[int, str]
    poses: Sequence[RoughPose]
    position: PositionSource | None
    needed: bool
    settings: PoseSettings


@dataclass(frozen=True, eq=False)
class FoundPartners:
    """Pairs of region numbers (photo, scan), what they score, and the pose that lays them on each other."""

    pairs: tuple[tuple[int, int], ...]
    note: str
    pose: RegionPose | RoughPairing


@dataclass(frozen=True, eq=False)
class FoundPartnerships:
    """What may be proposed, by what it was found, and a sentence on what could not be used."""

    found: Sequence[FoundPartners]
    guide: str
    warning: str = ""


class FRESCO_OT_propose_partners(JobOperator):
    bl_idname = "fresco.propose_partners"
    bl_label = "Propose Partners"
    bl_description = (
        "Find which regions of this photo and of the scan are the same: by what is known of the photo's "
        "pose, else by trying them with the pose solver. You choose what to accept"
    )
    bl_options = {"REGISTER", "UNDO"}
    step = "regions"

    guide: bpy.props.EnumProperty(
        name="By", items=GUIDES, description="What tells the photo's pose roughly", options={"SKIP_SAVE"}
    )

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_scan(cls, context):
            return False
        cls.poll_message_set("Choose a photo with a calibrated camera, in which a region is marked")
        photo = worked_photo(context)
        return photo is not None and bool(photo.camera_json) and len(photo.marks) > 0

    def start(self, context: bpy.types.Context) -> Job[FoundPartnerships]:
        scene, photo = context.scene, worked_photo(context)
        self._photo = photo.name
        marks = {mark.region_id: mask_source(mark.image) for mark in photo.marks if mark.image is not None}
        names = {region.uid: region.name for region in scene.fresco.regions}
        poses, position = self.guide_poses(scene, photo)
        search = PartnerSearch(
            photo_bridge.read_camera(photo),
            marks,
            surface_source(scene),
            names,
            poses,
            position,
            self.guide == "POSITION",
            to_core(scene.fresco.pose, PoseSettings),
        )
        return beside_job(partners_job(search))

    def guide_poses(
        self, scene: bpy.types.Scene, photo: FrescoPhoto
    ) -> tuple[list[RoughPose], PositionSource | None]:
        """Rough poses that the chosen guide gives, or where to look for one."""
        if self.guide == "NEIGHBOUR":
            return [neighbour_pose(scene, photo)], None
        if self.guide == "PLACED":
            return [placed_pose(scene, photo)], None
        poses = known_poses(scene, photo) if self.guide == "KNOWN" else []
        wanted = not poses and self.guide in {"KNOWN", "POSITION"}
        return poses, position_source(scene, photo) if wanted else None

    def finish(self, context: bpy.types.Context, result: FoundPartnerships) -> None:
        scene = context.scene
        photo = scene.fresco.photos[self._photo]
        bridge.discard_all(scene, {"PARTNERS"}, photo.name)
        for found in result.found:
            pairs = [(region_of(scene, first), region_of(scene, second)) for first, second in found.pairs]
            bridge.add_partners(scene, photo, pairs, found.note, found.pose)
        if not result.found:
            raise RegionError(f"{photo.name}: {nothing_found(result)}")
        if result.warning:
            self.warn(context, result.warning)
        self.report(
            {"INFO"}, f"{len(result.found)} partnerships proposed for {photo.name}, by {result.guide}"
        )


def nothing_found(result: FoundPartnerships) -> str:
    """Say why nothing is proposed, and what to do."""
    if result.guide == TRYING:
        return (
            "no pairing of its regions with those of the scan gives a pose. Mark the same patch on both, "
            "with a whole and sharp outline."
        )
    return (
        f"none of the scan's regions lies where {result.guide} allows one of the photo's. Mark the same "
        "patch on both, or let all pairs be tried: “Nothing” in the menu beside."
    )


def partners_job(search: PartnerSearch) -> Job[FoundPartnerships]:
    """Partners by a rough pose and its uncertainty, or by trying with the solver."""
    yield Progress(0.0, "Reading the regions")
    sides = free_regions(search)
    poses, warning = list(search.poses), ""
    if search.position is not None and (search.needed or search.position.tells_position()):
        try:
            poses = [search.position.pose()]
        except PhotoError as error:
            if search.needed:
                raise
            warning = str(error)
    job = _rough_job(search, sides, poses) if poses else _trying_job(search, sides)
    found = yield from part(job, 0.1, 1.0)
    return FoundPartnerships(found, poses[0].said if poses else TRYING, warning)


@dataclass(frozen=True, eq=False)
class Sides:
    """Regions of the photo and of the scan, by number, that have no partner yet; and those that have."""

    images: Mapping[int, ImageRegion]
    surfaces: Mapping[int, SurfaceRegion]
    known: Sequence[tuple[ImageRegion, SurfaceRegion]]


def free_regions(search: PartnerSearch) -> Sides:
    """Sort the regions; RegionError where nothing is free."""
    surfaces, names = search.source.regions(), search.names
    images = {uid: ImageRegion.from_mask(mask.read(), names[uid]) for uid, mask in search.marks.items()}
    free = {uid: image for uid, image in images.items() if names[uid] not in surfaces}
    others = {
        uid: surfaces[name] for uid, name in names.items() if name in surfaces and uid not in images
    }  # not marked here yet
    if not free or not others:
        raise RegionError(
            "Every region has its partner already: mark a region in the photo that the scan does not have, "
            "and one on the scan that this photo does not have."
        )
    known = [(image, surfaces[names[uid]]) for uid, image in images.items() if uid not in free]
    return Sides(free, others, known)


def _rough_job(search: PartnerSearch, sides: Sides, poses: Sequence[RoughPose]) -> Job[list[FoundPartners]]:
    """Partners that rough poses allow: pair by pair where there is one explanation, else each as a whole."""
    free, others = list(sides.images), list(sides.surfaces)
    images, surfaces = list(sides.images.values()), list(sides.surfaces.values())
    found = yield from propose_rough_partners_job(search.camera, poses, images, surfaces)
    if len(found) == 1:
        return [
            FoundPartners(((free[i], others[j]),), f"overlap {share:.0%}", found[0])
            for i, j, share in found[0].pairs
        ]
    return [
        FoundPartners(tuple((free[i], others[j]) for i, j, _ in each.pairs), rough_note(each), each)
        for each in found
    ]


def rough_note(pairing: RoughPairing) -> str:
    """Say how well one of several explanations fits."""
    share = sum(share for _, _, share in pairing.pairs) / len(pairing.pairs)
    return f"overlap {share:.0%}, {'less likely' if pairing.doubt else 'most likely'}"


def _trying_job(search: PartnerSearch, sides: Sides) -> Job[list[FoundPartners]]:
    """Partners by trying all pairs with the pose solver."""
    free, others = list(sides.images), list(sides.surfaces)
    images, surfaces = list(sides.images.values()), list(sides.surfaces.values())
    tried = yield from propose_pairings_job(search.camera, solver(search, sides.known), images, surfaces)
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


CLASSES = (FRESCO_OT_propose_partners,)
