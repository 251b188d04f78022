"""Refinement in a project: what is kept, what moves, what is taken over by the next run."""

import json

import numpy as np
import pytest
from fresco.core.errors import ProjectError
from fresco.core.geometry.rigid import exp_so3, rotation_angle
from fresco.core.jobs import drain
from fresco.core.pose import Pose, RegionPose
from fresco.core.project import PhotoPose, Refinement, RefineSettings, load_project, remarks
from fresco.core.project.run import read_scans_job, run_project
from fresco.core.project.stages import refinement
from fresco.core.project.stages.photo_pose import PointSighting, pose_from_dict, pose_to_dict
from fresco.core.project.stages.refinement import refine_poses, restored
from fresco.core.project.stages.residuals import tie_residuals
from fresco.core.report import write_report
from fresco.core.settings import EdgeSettings, JointSettings


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def centre_errors(poses, truth):
    return np.array([np.linalg.norm(p.pose.centre + truth[p.photo][0].T @ truth[p.photo][1]) for p in poses])


def test_entries_switch_steps_on_and_set_them(corner):
    path, _ = corner()
    assert load_project(path).refine == RefineSettings()
    edit(path, "[output]", "[refine]\nedges = true\njoint = { min_ties = 12 }\n[output]")
    assert load_project(path).refine == RefineSettings(EdgeSettings(), JointSettings(min_ties=12))
    edit(path, "edges = true", "edges = false")
    assert load_project(path).refine.edges is None
    edit(path, "min_ties", "min_knots")
    with pytest.raises(ProjectError, match=r"refine.joint.min_knots: is not known here.*min_ties"):
        load_project(path)
    edit(path, "{ min_knots = 12 }", '"all"')
    with pytest.raises(
        ProjectError, match=r"refine.joint: has to be true, false, or a table of settings, not “all”"
    ):
        load_project(path)


def test_a_given_pose_is_refined_only_when_its_photo_says_so(corner):
    path, truth = corner()
    rotation, translation = truth["B"]
    given = f"rotation = {rotation.tolist()}, translation = {translation.tolist()}"
    entry = f'[[photo]]\npath = "photos/B.png"\npose = {{ {given} }}\n[output]'
    edit(path, "[output]", entry)
    assert [photo.refine for photo in load_project(path).photos] == [True, False, True]
    edit(path, "[output]", '[[photo]]\npath = "photos/*.png"\nrefine = true\n[output]')
    assert [photo.refine for photo in load_project(path).photos] == [True, True, True]
    edit(path, "[output]", '[[photo]]\npath = "photos/A.png"\nrefine = false\n[output]')
    assert [photo.refine for photo in load_project(path).photos] == [False, True, True]


@pytest.fixture
def refined(corner):
    path, truth = corner(speckled=True)
    edit(path, "[output]", "[refine]\nedges = true\njoint = true\n[output]")
    return path, truth, run_project(load_project(path))


def test_a_run_refines_tells_and_takes_over(refined, monkeypatch):
    path, truth, result = refined
    for pose in result.poses:
        edges, joint = pose.refinements
        assert (edges.method, joint.method) == ("edges", "joint")
        assert not edges.moved and "kept" in edges.note, "one crease holds no pose"
        assert joint.moved and joint.score_after < joint.score_before and joint.count > 20
        assert edges.start is pose.first_pose and pose.overlap_error is not None
        assert pose.pose is not joint.start and pose.sure_pose is pose.pose
        ties = tie_residuals(pose.refinements)
        assert 20 < len(ties) <= 900 and ties.length_at(0.95) < 4
        assert tie_residuals(pose.refinements[:1]) is None
    starts = np.array([np.linalg.norm(p.first_pose.centre + truth[p.photo][0].T @ truth[p.photo][1])
                       for p in result.poses])  # fmt: skip
    assert np.median(centre_errors(result.poses, truth)) < min(0.004, 0.5 * np.median(starts))
    assert any("kept" in line for line in remarks(result))
    record = json.loads((path.parent / "out" / "project_provenance.json").read_text())
    assert record["settings"]["refine"]["joint"]["min_ties"] == JointSettings().min_ties
    told = record["photos"][0]["pose"]["refinements"]
    assert [step["method"] for step in told] == ["edges", "joint"] and told[0]["note"]
    assert len(record["photos"][0]["pose"]["covariance"]) == 6
    page = write_report(result, path.parent / "report.html").read_text(encoding="utf-8")
    assert "To other photos" in page and ", 95 %: " in page and "Surface σ" in page and "(kept)" in page

    def fail(*_arguments):
        raise AssertionError("was refined again")

    monkeypatch.setattr(refinement, "refine_pose_on_scan_job", fail)
    monkeypatch.setattr(refinement, "refine_poses_jointly_job", fail)
    again = run_project(load_project(path))
    for one, other in zip(result.poses, again.poses, strict=True):
        np.testing.assert_array_equal(one.pose.translation, other.pose.translation)
        assert [step.note for step in one.refinements] == [step.note for step in other.refinements]
        assert [step.ties for step in one.refinements] == [step.ties for step in other.refinements]
    edit(path, "joint = true", "joint = { seed = 1 }")
    with pytest.raises(AssertionError, match="refined again"):
        run_project(load_project(path))


def test_lenses_are_adjusted_told_and_used_by_all_that_follows(corner, monkeypatch):
    path, _ = corner(speckled=True)
    edit(path, "focal = 390", "focal = 396")
    edit(path, "[output]", '[refine]\njoint = true\nlenses = true\n[output]\ncameras = ["colmap"]')
    result = run_project(load_project(path))
    focal = [photo.camera.K[0, 0] for photo in result.photos]
    assert len(set(focal)) == 1, "the photos share a lens"
    assert abs(focal[0] - 390) < 3 < 396 - 390
    step = result.poses[0].refinements[-1]
    assert step.camera.K[0, 0] == 396 and "focal length -" in step.lens and "px at the border" in step.lens
    assert restored(result.poses[0]).camera is step.camera
    assert all(view.camera.K[0, 0] == focal[0] for view in result.textured.views)
    exported = (path.parent / "out" / "project_colmap" / "cameras.txt").read_text()
    assert f"{focal[0]:.3f}"[:6] in exported
    record = json.loads((path.parent / "out" / "project_provenance.json").read_text())
    assert record["photos"][0]["camera"]["K"][0][0] == focal[0]
    assert record["photos"][0]["pose"]["refinements"][-1]["camera_before"]["K"][0][0] == 396
    assert any("Lens adjusted: focal length" in line for line in remarks(result))

    monkeypatch.setattr(refinement, "refine_poses_jointly_job", lambda *_: pytest.fail("refined again"))
    again = run_project(load_project(path))
    assert again.photos[0].camera.K[0, 0] == focal[0]


def test_lenses_need_the_joint_step(corner):
    path, _ = corner()
    edit(path, "[output]", "[refine]\nlenses = true\n[output]")
    with pytest.raises(ProjectError, match=r"refine\.lenses: .*joint = true"):
        load_project(path)


def test_held_photos_stay_and_the_others_come_to_them(corner):
    path, truth = corner(speckled=True)
    project = load_project(path)
    scan = drain(read_scans_job(project))[0]
    photos = [entry.photo for entry in project.photos]
    wrong = exp_so3(np.radians([0.1, -0.15, 0.1]))
    poses = []
    for photo in photos:
        rotation, translation = truth[photo.name]
        moved = rotation if photo.name == "A" else wrong @ rotation
        centre = -rotation.T @ translation + (0.0 if photo.name == "A" else 0.02)
        pose = Pose(moved, -moved @ centre, np.full((6, 6), np.nan))
        poses.append(PhotoPose(photo.name, pose, given=True))
    found = refine_poses(scan, photos, poses, RefineSettings(joint=JointSettings()), held={"A"})
    assert found[0] is poses[0]
    for before, after in zip(poses[1:], found[1:], strict=True):
        rotation, translation = truth[after.photo]
        assert rotation_angle(after.pose.rotation @ rotation.T) < 0.3 * np.radians(0.2)
        assert np.linalg.norm(after.pose.centre + rotation.T @ translation) < 0.01
        assert restored(after).pose is before.pose and restored(after).refinements == ()
        assert restored(restored(after)).pose is before.pose


def test_a_single_photo_is_not_tied_to_itself(corner):
    path, truth = corner()
    project = load_project(path)
    scan = drain(read_scans_job(project))[0]
    photos = [entry.photo for entry in project.photos]
    unknown = np.full((6, 6), np.nan)
    poses = [PhotoPose("A", Pose(*truth["A"], unknown), given=True)]
    poses += [PhotoPose(photo.name, None, "Not found.") for photo in photos[1:]]
    found = refine_poses(scan, photos, poses, RefineSettings(joint=JointSettings()))
    assert found == poses


def test_results_survive_being_written_down():
    pose = Pose(np.eye(3), np.zeros(3), np.eye(6))
    steps = (Refinement("edges", pose, 1.2, 1.9, 400), Refinement("joint", pose, 3.0, 3.0, 0, "Kept."))
    points = (PointSighting("P1", (10.0, 20.5), (0.1, -0.2), True),)
    before = PhotoPose("A", pose, "", ("door",), ("note",), True, 1.5, points, steps)
    after = pose_from_dict(json.loads(json.dumps(pose_to_dict(before))))
    assert (after.photo, after.regions, after.notes, after.given) == ("A", ("door",), ("note",), True)
    assert after.points == points or vars(after.points[0]) == vars(points[0])
    assert [vars(s) | {"start": 0} for s in after.refinements] == [vars(s) | {"start": 0} for s in steps]
    np.testing.assert_array_equal(after.refinements[0].start.covariance, pose.covariance)


def test_a_region_without_an_error_of_its_own_is_written_as_valid_json():
    found = RegionPose(np.eye(3), np.zeros(3), np.eye(6), region_errors=(0.5, np.nan))
    text = json.dumps(pose_to_dict(PhotoPose("A", found)), allow_nan=False)
    np.testing.assert_array_equal(pose_from_dict(json.loads(text)).pose.region_errors, [0.5, np.nan])


def test_photos_that_may_only_be_posed_are_told_before_anything_is_computed(corner):
    path, _ = corner()
    edit(path, "[output]", '[[photo]]\npath = "photos/*.png"\nuse = "pose"\n[output]')
    with pytest.raises(ProjectError, match=r'photo.use: all photos have "pose"'):
        run_project(load_project(path))
    assert not (path.parent / "out").exists()
