from fresco.core.jobs import Progress, drain
from fresco.core.regions import ImageRegion
from fresco.core.regions.photo.proposals import propose_image_regions_job
from fresco.core.regions.photo.wand import prepare_wand
from fresco.core.regions.transfer import overlap
from photo_scenes import CAMERA, SHIFT, SURFACES, TURN, photo_of


def test_the_photo_s_frames_are_proposed():
    image = photo_of(SURFACES)
    levels = drain(propose_image_regions_job(prepare_wand(image)))
    for surface in SURFACES:
        truth = ImageRegion.from_polygon(CAMERA.project(surface.vertices @ TURN.T + SHIFT))
        shares = [overlap(ImageRegion.from_polygon(level.outline), truth, CAMERA) for level in levels]
        assert max(shares) > 0.95


def test_no_two_proposals_are_the_same_region_and_sky_is_none():
    image = photo_of(SURFACES)
    image[:60] = 240
    levels = drain(propose_image_regions_job(prepare_wand(image)))
    regions = [ImageRegion.from_polygon(level.outline) for level in levels]
    for k, first in enumerate(regions):
        assert min(first.loops[0][:, 1]) > 55
        assert all(overlap(first, second, CAMERA) <= 0.65 for second in regions[:k])


def test_looking_for_proposals_can_be_stopped():
    job = propose_image_regions_job(prepare_wand(photo_of(SURFACES)))
    assert isinstance(next(job), Progress)
    job.close()
