"""The report of a small corner of two walls, with photos that were solved, given, ambiguous and failed."""

import dataclasses
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera, PerspectiveCamera
from fresco.core.errors import OutputError
from fresco.core.geometry.rigid import exp_so3
from fresco.core.jobs import drain
from fresco.core.photos.marks import RegionMark
from fresco.core.photos.photo import Photo
from fresco.core.photos.view import View
from fresco.core.pose import Pose
from fresco.core.pose.regions.region_pose import RegionPose
from fresco.core.project.stages.photo_pose import PhotoPose
from fresco.core.project.stages.textures import TexturedScan
from fresco.core.regions import SurfaceRegion
from fresco.core.report import Report, write_report, write_report_job
from fresco.core.report.content import photo_rows
from fresco.core.report.figures import PROJECTED, draw_photo, projected_loops
from fresco.core.report.maps import FACE_MAPS, photo_map, pose_shift_map, shift_map, texel_map
from fresco.core.report.viewpoint import facing, two_viewpoints
from fresco.core.scans.scan import Scan
from fresco.core.texture import select_views
from hypothesis import given, settings
from hypothesis import strategies as st

OFFSET = np.array([5_000_000.0, 1_000_000.0, 200.0])
FOCAL = 400.0


def grid(origin, along, up, steps=12):
    """A rectangle that is seen from the side where `along` is to the right of `up`."""
    s, t = np.meshgrid(np.linspace(0, 1, steps + 1), np.linspace(0, 1, steps + 1))
    vertices = np.asarray(origin) + s.reshape(-1, 1) * np.asarray(along) + t.reshape(-1, 1) * np.asarray(up)
    index = np.arange((steps + 1) ** 2).reshape(steps + 1, -1)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)


def corner_scan():
    """Two walls that meet at x = 0: one looks to -y, one to +x."""
    back, faces = grid((0, 0, 0), (3, 0, 0), (0, 0, 2.5))
    side, side_faces = grid((0, -3, 0), (0, 3, 0), (0, 0, 2.5))
    vertices = np.concatenate([back, side])
    faces = np.concatenate([faces, side_faces + len(back)])
    return Scan(vertices, faces, OFFSET, np.arange(len(faces), dtype=np.int32), len(faces), "corner <scan>",
                report=("2 faces without area were dropped",))  # fmt: skip


def looking(centre, target):
    forward = np.subtract(target, centre) / np.linalg.norm(np.subtract(target, centre))
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(forward, right), forward])
    return rotation, -rotation @ np.asarray(centre, dtype=float)


def camera():
    return PerspectiveCamera(480, 320, np.array([[FOCAL, 0, 239.5], [0, FOCAL, 159.5], [0, 0, 1]]))


def pose_of(rotation, translation, **more):
    covariance = np.diag([1e-6] * 3 + [4e-6] * 3)
    return RegionPose(rotation, translation, covariance, overlap_error=0.42, **more)


@pytest.fixture
def report(tmp_path):
    scan = corner_scan()
    region = SurfaceRegion(scan.vertices, scan.faces[100:160], "panel")
    pose = looking((1.5, -3.5, 1.3), (1.2, 0, 1.2))
    poses = [
        PhotoPose("solved", pose_of(*pose), regions=("panel",)),
        PhotoPose("given", Pose(*pose, np.full((6, 6), np.nan)), given=True),
        PhotoPose("ambiguous", pose_of(*pose, ambiguous=True), "They do not decide: add one.", ("panel",)),
        PhotoPose("failed <b>", None, "No region is marked in this photo."),
    ]  # fmt: skip
    photos = []
    for number, result in enumerate(poses):
        path = tmp_path / f"photo {number} ä.png"
        picture = np.full((320, 480, 3), 60 + 30 * number, np.uint8)
        path.write_bytes(cv2.imencode(".png", picture)[1].tobytes())
        outline = np.array([[100.0, 80], [300, 80], [300, 200], [100, 200]])
        marks = (RegionMark("panel", outline=outline),) if number < 3 else ()
        photos.append(Photo(path, result.photo, camera(), marks))
    views = tuple(View(p.camera, *pose, p.path, p.name) for p in photos[:2])
    textured = TexturedScan(
        scan.vertices, scan.faces, np.arange(len(scan.faces)), selection(scan, views), views
    )
    return Report(
        "Church & <chapel>", scan, {"panel": region}, photos, poses, textured,
        "2024-06-01T10:00:00", {"fresco": "0.1.0"}, {"poses": 1.25},
    )  # fmt: skip


def selection(scan, views):
    """The back wall from the first photo, half of the side wall from the second, the rest from none."""
    count = len(scan.faces)
    view = np.full(count, -1, np.int32)
    view[: count // 2] = 0
    view[count // 2 : 3 * count // 4] = 1
    local = (scan.vertices - views[0].centre) @ views[0].rotation.T
    texel = np.where(view >= 0, np.linspace(0.002, 0.004, count), np.nan).astype(np.float32)
    uv = np.nan_to_num(views[0].camera.project(local)[scan.faces])
    chosen = select_views(scan.vertices, scan.faces, views)
    return dataclasses.replace(
        chosen, view=view, uv=uv, texel_size=texel, gain=np.ones((2, 3)), left_out=np.array([False, True])
    )


class Page(HTMLParser):
    """Checks that tags are balanced and gathers sources, texts and picture descriptions."""

    VOID = ("meta", "img", "br")

    def __init__(self, text):
        super().__init__()
        self.open, self.sources, self.alternatives, self.links, self.text = [], [], [], [], ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag == "img":
            self.sources.append(values["src"])
            self.alternatives.append(values["alt"])
        self.links += [values[name] for name in ("href", "action") if name in values]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data if "style" not in self.open else ""


def test_the_page_holds_everything_and_needs_nothing_beside_it(report, tmp_path):
    path = write_report(report, tmp_path / "deep" / "bericht ä.html")
    source = path.read_text(encoding="utf-8")
    page = Page(source)
    maps = [make(report.textured) for make in FACE_MAPS.values()]
    shown = sum(one is not None for one in maps)
    assert 5 <= shown < len(maps)
    assert len(page.sources) == 4 + 4 + shown  # photos, scan and texture from two sides, maps
    assert all(source.startswith("data:image/jpeg;base64,") for source in page.sources)
    assert all(page.alternatives) and not page.links
    assert not re.search(r"https?://|url\(|@import|<script", source)
    assert "Church & <chapel>" in page.text and "failed <b>" in page.text and "corner <scan>" in page.text
    for told in (
        "2 of 4", "No region is marked in this photo.", "They do not decide: add one.", "0.42", "5000000.000",
        "given: what it shows is not found", "2 faces without area were dropped", "fresco 0.1.0",
    ):  # fmt: skip
        assert told in page.text, told
    assert list(path.parent.iterdir()) == [path]


def test_errors_appear_only_where_the_truth_is_known(report):
    rotation, translation = report.poses[0].pose.rotation, report.poses[0].pose.translation
    turned = exp_so3(np.radians([0.0, 0.3, 0.0])) @ rotation
    centre = -rotation.T @ translation + OFFSET + (0.003, 0, 0.004)
    known = dataclasses.replace(report, truth={"solved": (turned, -turned @ centre)})
    row, given, *_ = photo_rows(known)
    assert row.rotation_error == pytest.approx(0.3, abs=1e-6)
    assert row.centre_error == pytest.approx(5.0, abs=1e-3)
    assert given.rotation_error is None


def test_rows_tell_state_uncertainty_and_use(report):
    rows = photo_rows(report)
    assert [row.status for row in rows] == ["solved", "given", "ambiguous", "failed"]
    assert rows[0].rotation_sigma == pytest.approx(np.degrees(np.sqrt(3e-6)))
    assert rows[0].centre_sigma == pytest.approx(1000 * np.sqrt(12e-6))
    assert rows[1].rotation_sigma is None and rows[1].overlap_error is None
    count = len(report.scan.faces)
    assert rows[0].faces == count // 2 and rows[1].faces == count // 4
    assert rows[0].area == pytest.approx(7.5)
    assert rows[0].texel_size == pytest.approx(2.5, abs=0.02)
    assert rows[2].faces is None and rows[3].texel_size is None


def test_without_texture_only_poses_are_shown(report, tmp_path):
    bare = dataclasses.replace(report, textured=None)
    page = Page(write_report(bare, tmp_path / "poses.html").read_text(encoding="utf-8"))
    assert len(page.sources) == 4
    assert "Surface with a photo" in page.text


def test_a_folder_that_cannot_be_written_is_told(report, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="cannot be written"):
        write_report(report, tmp_path / "file" / "report.html")


def test_the_job_can_be_stopped_at_any_step_and_leaves_nothing(report, tmp_path):
    fractions = []
    drain(write_report_job(report, tmp_path / "whole.html"), lambda step: fractions.append(step.fraction))
    assert fractions == sorted(fractions) and fractions[-1] <= 1
    target = tmp_path / "stopped" / "report.html"
    for steps in (1, len(fractions) // 2, len(fractions) - 1):
        job = write_report_job(report, target)
        for _ in range(steps):
            next(job)
        job.close()
        assert not target.parent.exists()


def test_the_projected_boundary_is_drawn_where_the_region_is(report):
    photo, pose = report.photos[0], report.poses[0].pose
    image = draw_photo(photo, pose, report.surfaces)
    corner = report.surfaces["panel"].loops[0][0]
    u, v = photo.camera.project((corner - pose.centre)[None] @ pose.rotation.T)[0]
    spot = image[round(v) - 1 : round(v) + 2, round(u) - 1 : round(u) + 2].reshape(-1, 3).astype(int)
    assert np.abs(spot - PROJECTED).sum(axis=1).min() < 40
    unposed = draw_photo(photo, None, report.surfaces)
    assert np.abs(unposed.astype(int) - PROJECTED).sum(axis=2).min() > 40


def test_an_outline_across_the_seam_of_a_panorama_is_not_joined_over_the_picture():
    cam = EquirectangularCamera(400, 200)
    square, faces = grid((-0.5, -0.5, -2.0), (1, 0, 0), (0, 1, 0), 4)  # behind the camera: at the seam
    runs = projected_loops(cam, Pose(np.eye(3), np.zeros(3), np.zeros((6, 6))), SurfaceRegion(square, faces))
    assert len(runs) >= 2
    assert all(np.abs(np.diff(run[:, 0])).max() < 20 for run in runs)


def test_maps_have_a_colour_for_every_face_and_say_what_it_means(report):
    photos = photo_map(report.textured)
    assert [text for _, text in photos.entries] == ["solved", "given", "no photo"]
    assert len({tuple(colour) for colour in photos.colours}) == 3
    texels = texel_map(report.textured)
    assert texels.ends == ("2 mm", "3.5 mm (logarithmic)")
    assert len(texels.colours) == len(report.scan.faces)
    for name, make in FACE_MAPS.items():
        one = make(report.textured)
        if one is not None:
            assert one.colours.shape == (len(report.scan.faces), 3) and one.colours.dtype == np.uint8, name
            assert one.title and one.entries


def test_the_uncertainty_of_the_poses_is_told_on_the_surface(report):
    assert pose_shift_map(report.textured) is None, "no photo's uncertainty is known"
    sigma = np.radians(0.1)
    views = list(report.textured.views)
    covariance = np.diag([sigma**2] * 3 + [1e-12] * 3)
    views[0] = dataclasses.replace(views[0], covariance=covariance)
    textured = dataclasses.replace(report.textured, views=tuple(views))
    found = pose_shift_map(textured)
    assert found.ends[0] == "0 mm"
    rows = photo_rows(dataclasses.replace(report, textured=textured))
    middle = textured.vertices[textured.faces].mean(axis=1)[textured.selection.view == 0]
    distance = np.median(np.linalg.norm(middle - views[0].centre, axis=1))
    # a turn of sigma about two axes moves what is seen at a right angle by sqrt(2) sigma times the distance
    assert rows[0].surface_shift == pytest.approx(1000 * np.sqrt(2) * sigma * distance, rel=0.4)
    assert rows[1].surface_shift is None


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.01, 1000), st.integers(1, 6))
def test_both_viewpoints_have_the_model_in_the_frame(seed, size, count):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(300, 3)) * size * rng.uniform(0.02, 1, 3)
    views = [
        View(camera(), exp_so3(rng.normal(0, 2, 3)), rng.normal(0, size, 3), np.zeros((1, 1, 3), np.uint8))
        for _ in range(count)
    ]
    faces = rng.integers(0, len(points), (200, 3))
    for viewpoint in two_viewpoints(points, faces, views):
        assert np.allclose(viewpoint.rotation @ viewpoint.rotation.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(viewpoint.rotation) > 0
        centres = points[faces[facing(points, faces, viewpoint)]].mean(axis=1)
        pixels = viewpoint.camera.project(centres @ viewpoint.rotation.T + viewpoint.translation)
        assert viewpoint.camera.in_frame(pixels).mean() > 0.9


def test_viewpoints_stand_upright_left_and_right_of_the_photos(report):
    left, right = two_viewpoints(report.scan.vertices, report.scan.faces, report.textured.views)
    for viewpoint in (left, right):
        assert viewpoint.rotation[0, 2] == pytest.approx(0, abs=1e-9)  # the horizon is level
        assert viewpoint.rotation[1, 2] < 0  # down in the picture is down in the world
    assert (-left.rotation.T @ left.translation)[0] < (-right.rotation.T @ right.translation)[0]
    front = facing(report.scan.vertices, report.scan.faces, right)
    assert len(front) == len(report.scan.faces)
    assert len(facing(report.scan.vertices, report.scan.faces[:, ::-1], right)) == 0


def test_columns_without_a_number_are_left_out(report, tmp_path):
    page = Page(
        write_report(dataclasses.replace(report, textured=None), tmp_path / "a.html").read_text("utf-8")
    )
    assert "Centre error" not in page.text and "Shift to others" not in page.text
    pose = report.poses[0].pose
    known = dataclasses.replace(
        report, textured=None, truth={"solved": (pose.rotation, pose.translation - pose.rotation @ OFFSET)}
    )
    page = Page(write_report(known, tmp_path / "b.html").read_text("utf-8"))
    assert "Centre error" in page.text and "Shift to others" not in page.text


def test_the_disagreement_with_other_photos_is_shown_where_it_is_known(report):
    assert shift_map(report.textured) is None
    chosen = dataclasses.replace(report.textured.selection, pose_shift=np.array([0.4, 3.0]))
    textured = dataclasses.replace(report.textured, selection=chosen)
    assert shift_map(textured).ends == ("0 px", "3.0 px")
    rows = photo_rows(dataclasses.replace(report, textured=textured))
    assert [row.shift for row in rows] == [0.4, 3.0, None, None]
