from fresco.core.jobs import drain
from fresco.core.regions import ImageRegion
from fresco.core.regions.photo_proposals import propose_image_regions_job
from fresco.core.regions.transfer import overlap
from fresco.core.regions.wand import prepare_wand
from photo_scenes import CAMERA, SHIFT, SURFACES, TURN, photo_of


def test_the_photo_s_frames_are_proposed():
    image = photo_of(SURFACES)
    levels = drain(propose_image_regions_job(prepare_wand(image)))
    for surface in SURFACES:
        truth = ImageRegion.from_polygon(CAMERA.project(surface.vertices @ TURN.T + SHIFT))
        shares = [overlap(ImageRegion.from_polygon(level.outline), truth, CAMERA) for level in levels]
        assert max(shares) > 0.95
