"""Positions and directions that photos tell, and the rough poses that they give: against known places."""

import math
from dataclasses import replace

import numpy as np
import pytest
from exif_files import SHORT, photo_file, place_of, position_tags
from fresco.core.errors import PhotoError
from fresco.core.geometry.rigid import camera_centre, rotation_angle
from fresco.core.photos import read_exif
from fresco.core.photos.georeference import (
    PlacedPhoto,
    georeference_from_epsg,
    georeference_from_photos,
)
from fresco.core.photos.position import Direction, Position, read_position
from fresco.core.photos.rough_pose import pose_from_position, pose_like_neighbour

BOX = np.array([[686100.0, 5330440.0, 520.0], [686140.0, 5330460.0, 540.0]])
HERE = Position(48.1, 11.5, 530.0, 4.0, 8.0)
"""686121.76 m east, 5330438.13 m north in UTM zone 32, some metres south of the box."""


def read(path):
    return read_position(path, read_exif(path))


def test_position_and_compass_of_a_phone(tmp_path):
    gps = position_tags(48.1, 11.5, heading=270.5, error=6.5)
    found = read(photo_file(tmp_path / "a.jpg", tags={0x112: (SHORT, 6)}, gps=gps))
    assert (found.latitude, found.longitude) == pytest.approx((48.1, 11.5), abs=1e-6)
    assert (found.height, found.sigma, found.height_sigma) == (530.2, 6.5, 13.0)
    assert found.direction.heading == 270.5 and found.direction.held == (-1.0, 0.0)


def test_magnetic_directions_are_less_sure_and_places_without_fix_are_none(tmp_path):
    magnetic = read(photo_file(tmp_path / "m.jpg", gps=position_tags(48.1, 11.5, heading=90, true=False)))
    true = read(photo_file(tmp_path / "t.jpg", gps=position_tags(48.1, 11.5, heading=90)))
    assert magnetic.direction.heading_sigma > true.direction.heading_sigma
    assert read(photo_file(tmp_path / "n.jpg", gps=position_tags(48.1, 11.5))).direction is None
    assert read(photo_file(tmp_path / "zero.jpg", gps=position_tags(0.0, 0.0))) is None
    assert read(photo_file(tmp_path / "pole.jpg", gps=position_tags(90.0, 11.5))) is None
    assert read(photo_file(tmp_path / "none.jpg")) is None


def with_packet(path, text):
    data = path.read_bytes()
    packet = b"http://ns.adobe.com/xap/1.0/\0" + text.encode()
    path.write_bytes(data[:2] + b"\xff\xe1" + (len(packet) + 2).to_bytes(2, "big") + packet + data[2:])
    return path


DRONE = """<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description xmlns:d="http://example.org/drone/1.0/" d:GimbalYawDegree="-93.5" d:GimbalPitchDegree="-30.0"
 d:GimbalRollDegree="+0.00" d:Model="none"><d:RtkStdLon>0.012</d:RtkStdLon><d:RtkStdLat>0.031</d:RtkStdLat>
<d:RtkStdHgt>0.05</d:RtkStdHgt></rdf:Description></rdf:RDF></x:xmpmeta>"""


def test_a_drone_tells_its_gimbal_and_how_sure_its_position_is(tmp_path):
    found = read(with_packet(photo_file(tmp_path / "d.jpg", gps=position_tags(48.1, 11.5)), DRONE))
    assert (found.direction.heading, found.direction.pitch, found.direction.roll) == (-93.5, -30, 0)
    assert (found.sigma, found.height_sigma) == (0.031, 0.05)


@pytest.mark.parametrize("packet", [DRONE[:300] + "</x:xmpmeta>", "<!ENTITY a 'b'>".join(DRONE.split("\n"))])
def test_damaged_packets_count_as_none(tmp_path, packet):
    found = read(with_packet(photo_file(tmp_path / "d.jpg", gps=position_tags(48.1, 11.5)), packet))
    assert found.direction is None and found.sigma == 5.0


def test_a_projection_puts_photos_where_its_grid_has_them():
    world = georeference_from_epsg(25832)
    plane, covariance = world.place(HERE)
    assert plane == pytest.approx([686121.76, 5330438.13], abs=0.01)
    assert np.sqrt(np.diag(covariance)) == pytest.approx(math.hypot(4.0, 1.0), abs=0.5)
    # east of the central meridian, north of the grid lies east of true north by (λ - 9°) sin φ
    expected = math.radians(90 - 2.5 * math.sin(math.radians(48.1)))
    assert world.heading(HERE, 90.0) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("code", [4326, 31467, 25827, 32661, 0])
def test_codes_that_are_no_utm_zone_are_refused(code):
    with pytest.raises(PhotoError, match=f"EPSG {code} is no UTM zone"):
        georeference_from_epsg(code)


def test_places_far_from_the_scan_are_refused():
    with pytest.raises(PhotoError, match=r"[0-9,]+ km from the scan: check the EPSG"):
        pose_from_position(Position(48.0, -171.0, math.nan, 5.0, 10.0), georeference_from_epsg(25832), BOX)


def test_a_direction_gives_a_camera_that_looks_there():
    world = georeference_from_epsg(25832)
    direction = Direction(10.0, pitch=5.0)
    found = pose_from_position(Position(48.1, 11.5, 530.0, 4.0, 8.0, direction=direction), world, BOX)
    heading = world.heading(HERE, 10.0)
    level = math.cos(math.radians(5))
    expected = [math.sin(heading) * level, math.cos(heading) * level, math.sin(math.radians(5))]
    assert found.rotation[2] == pytest.approx(expected)
    assert found.rotation[1, 2] < -0.99 and np.linalg.det(found.rotation) == pytest.approx(1)
    assert camera_centre(found.rotation, found.translation)[:2] == pytest.approx(
        [686121.76, 5330438.13], abs=0.01
    )
    assert np.linalg.eigvalsh(found.covariance)[0] > 0 and "±" in found.said


@pytest.mark.parametrize(
    ("held", "up"), [((0, -1), (0, -1)), ((-1, 0), (-1, 0)), ((1, 0), (1, 0)), ((0, 1), (0, 1))]
)
def test_turned_photos_have_up_where_the_camera_held_it(held, up):
    place = Position(48.1, 11.5, 530.0, 4.0, 8.0, held, Direction(0.0, held=held))
    found = pose_from_position(place, georeference_from_epsg(25832), BOX)
    assert found.rotation @ [0, 0, 1] == pytest.approx([*up, 0], abs=1e-9)


def test_a_nadir_photo_has_its_heading_at_the_top_and_a_whole_covariance():
    place = Position(
        48.1, 11.5, 560.0, 4.0, 8.0, direction=Direction(0.0, -90.0, heading_sigma=4, pitch_sigma=1.5)
    )
    found = pose_from_position(place, georeference_from_epsg(25832), BOX)
    assert found.rotation[2] == pytest.approx([0, 0, -1], abs=1e-9)
    assert found.rotation[1] == pytest.approx([0.033, -1, 0], abs=0.01)  # down in the photo is south
    assert np.all(np.isfinite(found.covariance)) and np.linalg.eigvalsh(found.covariance)[0] > 0


def test_a_drone_that_looks_down_is_as_high_as_it_says():
    direction = Direction(0.0, -90.0, heading_sigma=4, pitch_sigma=1.5)
    place = Position(48.1, 11.5, 610.0, 4.0, 8.0, direction=direction)
    found = pose_from_position(place, georeference_from_epsg(25832), BOX)
    gap = camera_centre(found.rotation, found.translation)[2] - 610.0
    assert abs(gap) < 0.1 * math.sqrt(found.covariance[5, 5]) < 6.0
    below = pose_like_neighbour(found.rotation, found.translation, BOX, "IMG 1")
    assert np.trace(below.covariance[:3, :3]) == pytest.approx(
        np.sum(np.radians([12.0, 8.0, 3.0, 3.0, 3.0]) ** 2)
    )


def test_without_direction_a_photo_looks_at_the_scan_unless_it_stands_in_it():
    world = georeference_from_epsg(25832)
    outside = Position(48.0992, 11.5, 530.0, 4.0, 8.0)
    found = pose_from_position(outside, world, BOX)
    towards = BOX.mean(axis=0) - camera_centre(found.rotation, found.translation)
    assert found.rotation[2] == pytest.approx(towards / np.linalg.norm(towards), abs=1e-6)
    with pytest.raises(PhotoError, match="within the scan"):
        pose_from_position(Position(48.10011, 11.5, 530.0, 4.0, 8.0), world, BOX)


def test_heights_of_another_system_do_not_count():
    world = georeference_from_epsg(25832)
    for height, expected, tolerance in [(530.0, 530.0, 1.0), (5.0, 530.0, 0.1), (math.nan, 530.0, 0.1)]:
        found = pose_from_position(
            Position(48.1, 11.5, height, 4.0, 8.0, direction=Direction(0.0)), world, BOX
        )
        assert camera_centre(found.rotation, found.translation)[2] == pytest.approx(expected, abs=tolerance)


def placed(east, north, turn, forward=None, sigma=0.5, direction=None):
    """Photo at a place of UTM zone 32 around HERE, solved in a world that is turned and moved."""
    latitude, longitude = place_of(32, 686121.76 + east, 5330438.13 + north)
    cosine, sine = math.cos(turn), math.sin(turn)
    centre = np.array([3.0 + cosine * east - sine * north, -7.0 + sine * east + cosine * north, 1.5])
    position = Position(latitude, longitude, 530.0, sigma, 1.0, direction=direction)
    return PlacedPhoto(position, centre, np.array([0.0, 1.0, 0.0]) if forward is None else forward)


def test_two_solved_photos_give_the_place_of_a_third():
    turn = math.radians(40.0)
    world = georeference_from_photos([placed(0, 0, turn), placed(20, 5, turn)])
    third = placed(8, 12, turn)
    plane, covariance = world.place(third.position)
    assert plane == pytest.approx(third.centre[:2], abs=0.02)
    assert 0.5 < math.sqrt(covariance[0, 0]) < 1.0
    assert third.position.height + world.height_shift == pytest.approx(1.5)
    convergence = math.radians(2.5 * math.sin(math.radians(48.1)))
    assert world.turn == pytest.approx(turn + convergence, abs=1e-3)  # the local plane points true north


def test_one_solved_photo_gives_the_turn_by_its_direction():
    turn = math.radians(-25.0)
    told = Direction(60.0)
    level = math.radians(60.0 - 2.5 * math.sin(math.radians(48.1))) - turn
    one = placed(0, 0, turn, np.array([math.sin(level), math.cos(level), 0.0]), direction=told)
    world = georeference_from_photos([one])
    other = placed(6, -3, turn)
    plane, covariance = world.place(other.position)
    assert plane == pytest.approx(other.centre[:2], abs=0.05)
    away = math.radians(told.heading_sigma) * math.hypot(6, 3)
    assert math.sqrt(np.linalg.eigvalsh(covariance)[1]) == pytest.approx(math.hypot(0.5, 0.5, away), rel=0.01)


def test_photos_that_stand_otherwise_in_the_scan_are_refused():
    one, other = placed(0, 0, 0.3), placed(40, 0, 0.3)
    nearer = replace(other, centre=other.centre * [0.5, 0.5, 1.0])
    georeference_from_photos([one, other])
    with pytest.raises(PhotoError, match=r"stand otherwise in the scan .* by \d+\.\d m: check their poses"):
        georeference_from_photos([one, nearer])


def test_photos_that_tell_no_turn_are_refused():
    with pytest.raises(PhotoError, match="solve two photos"):
        georeference_from_photos([])
    with pytest.raises(PhotoError, match="too close together"):
        georeference_from_photos([placed(0, 0, 0.3, sigma=5.0), placed(1, 0, 0.3, sigma=5.0)])


def test_errors_of_rough_poses_are_as_large_as_they_say():
    """Normalised error squared of poses from disturbed positions and directions, 6 expected."""
    world, rng = georeference_from_epsg(25832), np.random.default_rng(5)
    direction = Direction(10.0, 4.0, 1.0)
    true = pose_from_position(Position(48.1, 11.5, 530.0, 4.0, 8.0, direction=direction), world, BOX)
    errors, spread = [], math.hypot(4.0, world.sigma) / 111_200  # degrees: of the receiver and the datum
    for _ in range(300):
        noise = rng.normal(size=6)
        turned = Direction(10.0 + 12 * noise[0], 4.0 + 15 * noise[1], 1.0 + 4 * noise[2])
        place = Position(
            48.1 + spread * noise[3], 11.5 + spread * noise[4] / 0.668, math.nan, 4, 8, direction=turned
        )
        found = pose_from_position(place, world, BOX)
        angle = rotation_angle(found.rotation @ true.rotation.T)
        gap = camera_centre(found.rotation, found.translation) - camera_centre(
            true.rotation, true.translation
        )
        errors.append([angle**2, gap @ gap])
    expected = np.trace(true.covariance[:3, :3]), np.trace(true.covariance[3:5, 3:5])
    assert np.mean(errors, axis=0) == pytest.approx(expected, rel=0.2)


def test_a_neighbour_is_a_quarter_of_the_distance_away():
    found = pose_like_neighbour(np.eye(3), [0, 0, 0], [[-1, -1, 8], [1, 1, 12]], "IMG 1")
    assert math.sqrt(np.trace(found.covariance[3:, 3:])) == pytest.approx(2.5)
    assert found.said.startswith("like IMG 1, ± 1.4 m, ± ")
