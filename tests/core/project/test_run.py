import errno
import hashlib
import json
import os

import cv2
import numpy as np
import pytest
from fresco.core.errors import OutputError, PhotoError, PoseNotFound, ProjectError, TextureError
from fresco.core.geometry.rigid import rotation_angle
from fresco.core.photos import read_image
from fresco.core.project.file.load import load_project
from fresco.core.project.run import check_inputs_job, run_project, run_project_job
from fresco.core.project.stages import poses as pose_stage
from fresco.core.texture.models.render import render_view
from fresco.core.texture.quality import psnr
from fresco.core.texture.views import survey


def run(path):
    return run_project(load_project(path))


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def errors(result, truth):
    """Rotation errors in degrees and centre errors in metres of every photo."""
    offset = result.scan.offset
    rotation, centre = [], []
    for found in result.poses:
        true_rotation, true_translation = truth[found.photo]
        rotation.append(np.degrees(rotation_angle(found.pose.rotation @ true_rotation.T)))
        centre.append(np.linalg.norm(found.pose.centre + offset + true_rotation.T @ true_translation))
    return np.array(rotation), np.array(centre)


@pytest.mark.parametrize("offset", [(0, 0, 0), (5_012_300.0, 423_400.0, 0.0)], ids=["near", "national grid"])
def test_from_masks_and_mesh_to_a_textured_model(corner, offset):
    path, truth = corner(offset)
    result = run(path)
    assert [pose.photo for pose in result.poses] == ["A", "B", "C"]
    assert all(pose.solved for pose in result.poses)
    rotation, centre = errors(result, truth)
    assert rotation.max() < 0.5 and centre.max() < 0.05  # regions of 60 pixels
    assert result.textured.coverage > 0.75
    assert result.scan.offset == pytest.approx(offset)
    for view in result.textured.views:
        rendering = render_view(
            view.camera, view.rotation, view.translation,
            result.textured.vertices, result.textured.faces, result.textured.selection, result.textured.views,
        )  # fmt: skip
        assert psnr(rendering.image, read_image(view.image), rendering.covered) > 30
    folder = path.parent / "out"
    first = next(line for line in (folder / "project.obj").read_text().splitlines() if line.startswith("v "))
    corners = result.textured.vertices + offset
    assert np.abs(corners - np.array(first.split()[1:], float)).sum(axis=1).min() < 1e-5


def test_provenance_tells_inputs_settings_and_every_photo(corner):
    path, truth = corner()
    edit(path, "[output]", '[[photo]]\npath = "photos/C.png"\nuse = "pose"\n[output]')
    result = run(path)
    record = json.loads((path.parent / "out" / "project_provenance.json").read_text(encoding="utf-8"))
    assert record == json.loads(json.dumps(result.provenance))
    assert {"project.toml", "scan.ply", "labels.npy", "photos/A.png", "masks/B/tall.png"} <= set(
        record["inputs"]
    )
    assert record["settings"]["texture"]["max_angle"] == 85
    a, _, c = record["photos"]
    np.testing.assert_allclose(a["pose"]["centre"], -truth["A"][0].T @ truth["A"][1], atol=0.05)
    assert a["pose"]["centre_sigma"] > 0 and a["faces"] > 0 and a["solved"]
    assert c["use"] == "pose" and c["faces"] == 0 and c["solved"]
    data = (path.parent / "scan.ply").read_bytes()
    assert record["fingerprint"] == "BLAKE2b, 16 bytes"
    assert record["inputs"]["scan.ply"] == hashlib.blake2b(data, digest_size=16).hexdigest()
    assert record["texture"]["coverage"] == pytest.approx(result.textured.coverage)


def test_the_anchor_of_the_gains_is_counted_among_all_photos(corner):
    path, _ = corner()
    edit(
        path,
        "[output]",
        '[[photo]]\npath = "photos/A.png"\nuse = "pose"\n[texture]\ngain_anchor = 2\n[output]',
    )
    cv2.imwrite(str(dim := path.parent / "photos" / "C.png"), cv2.imread(str(dim)) // 2)
    textured = run(path).textured
    assert [view.name for view in textured.views] == ["B", "C"]
    np.testing.assert_allclose(textured.selection.gain[1], 1.0)
    assert textured.selection.gain[0].max() < 0.8


def test_the_photo_of_every_face_is_written(corner):
    path, _ = corner()
    result = run(path)
    name = result.provenance["texture"]["photo_per_face"]
    with np.load(path.parent / "out" / name) as saved:
        np.testing.assert_array_equal(saved["view"], np.sort(result.textured.selection.view))
        assert saved["photo_name"].tolist() == ["A", "B", "C"]
        assert set(saved["file_face"].tolist()) == set(range(1200))
        view = saved["view"]
    faces, material = [], ""
    for line in (path.parent / "out" / "project.obj").read_text().splitlines():
        material = line[7:] if line.startswith("usemtl ") else material
        faces += [material] if line.startswith("f ") else []
    assert len(faces) == len(view), "a line per face of the OBJ"
    for material in set(faces):
        assert len(set(view[np.array(faces) == material].tolist())) == 1


def test_a_vertical_direction_solves_upright_photos(corner):
    path, truth = corner()
    edit(path, "[output]", "[pose]\nup = [0, 0, 1]\n[output]")
    result = run(path)
    assert [pose.solved for pose in result.poses] == [True] * 3
    assert errors(result, truth)[1].max() < 0.05


def count_solved(monkeypatch):
    """Count the photos that are solved anew."""
    solved, original = [], pose_stage.estimate_pose_job

    def counting(camera, *arguments, **options):
        solved.append(camera)
        return original(camera, *arguments, **options)

    monkeypatch.setattr(pose_stage, "estimate_pose_job", counting)
    return solved


def test_unchanged_stages_are_taken_over_and_changed_ones_are_not(corner, monkeypatch):
    path, _ = corner()
    solved = count_solved(monkeypatch)
    first = run(path)
    assert len(solved) == 3
    again = run(path)
    assert len(solved) == 3
    for one, other in zip(first.poses, again.poses, strict=True):
        np.testing.assert_array_equal(one.pose.rotation, other.pose.rotation)
        np.testing.assert_array_equal(one.pose.covariance, other.pose.covariance)
        assert (one.overlap_error, one.regions) == (other.overlap_error, other.regions)
    np.testing.assert_array_equal(first.textured.selection.uv, again.textured.selection.uv)
    mask = path.parent / "masks" / "B" / "small.png"
    image = cv2.imdecode(np.fromfile(mask, np.uint8), cv2.IMREAD_GRAYSCALE)
    mask.write_bytes(cv2.imencode(".png", cv2.erode(image, np.ones((3, 3))))[1].tobytes())
    run(path)
    assert len(solved) == 4
    edit(path, "[output]", "[pose]\noverlap_limit = 4\n[output]")
    run(path)
    assert len(solved) == 7


def test_interrupted_run_keeps_what_was_finished(corner, monkeypatch):
    path, _ = corner()
    solved = count_solved(monkeypatch)
    job = run_project_job(load_project(path))
    while len(solved) < 2:
        next(job)
    job.close()
    assert not (path.parent / "out" / "project.obj").exists()
    assert not list((path.parent / "out").glob("**/*.part"))
    run(path)
    assert len(solved) == 4  # the second photo was interrupted and is solved again


def test_an_interrupted_texture_goes_on_at_the_next_photo(corner, monkeypatch):
    path, _ = corner()
    edit(path, "[output]", "[texture]\nthreads = 1\n[output]")
    looked_at = []
    original = survey.survey_photo
    monkeypatch.setattr(
        survey, "survey_photo", lambda *given: looked_at.append(given[1].name) or original(*given)
    )
    job = run_project_job(load_project(path))
    while len(looked_at) < 2:
        next(job)
    job.close()
    assert len(list((path.parent / "out" / "cache" / "photos").iterdir())) == 2
    result = run(path)
    assert looked_at == ["A", "B", "C"]
    assert result.textured.coverage > 0.75
    assert not (path.parent / "out" / "cache" / "photos").exists()


def test_stopping_at_any_step_leaves_nothing_half_written(corner):
    path, _ = corner()
    for stop in (0.01, 0.1, 0.3, 0.6, 0.85, 0.93):
        job = run_project_job(load_project(path))
        next(progress for progress in job if progress.fraction >= stop)
        job.close()
        files = {file.name for file in (path.parent / "out").rglob("*") if file.is_file()}
        left = {name for name in files if not name.endswith(".photo.npz")}
        assert left <= {"pose A.json", "pose B.json", "pose C.json", "texture.npz"}
    assert run(path).textured.coverage > 0.75


def test_damaged_cache_is_computed_again(corner, monkeypatch):
    path, _ = corner()
    solved = count_solved(monkeypatch)
    run(path)
    cache = path.parent / "out" / "cache"
    (cache / "pose A.json").write_text('{"key": 1')
    (cache / "texture.npz").write_bytes((cache / "texture.npz").read_bytes()[:500])
    assert run(path).textured.coverage > 0.75
    assert len(solved) == 4


def test_photo_without_regions_fails_alone(corner):
    path, _ = corner()
    for mask in (path.parent / "masks" / "B").iterdir():
        mask.unlink()
    result = run(path)
    assert [pose.solved for pose in result.poses] == [True, False, True]
    assert result.poses[1].failure.startswith("No region is marked in this photo.")


def crop_photo(path, name, rows):
    """Cut rows off the top of a photo and of its masks."""
    for file in [path.parent / "photos" / f"{name}.png", *(path.parent / "masks" / name).iterdir()]:
        image = cv2.imdecode(np.fromfile(file, np.uint8), cv2.IMREAD_UNCHANGED)
        file.write_bytes(cv2.imencode(".png", image[rows:])[1].tobytes())


def test_region_cut_off_by_the_frame_is_told(corner):
    path, truth = corner()
    crop_photo(path, "A", 110)
    camera = "[[camera]]\nname = 'cut'\nfocal = 390\nprincipal = [239.5, 69.5]\n"
    edit(path, "[output]", camera + "[[photo]]\npath = 'photos/A.png'\ncamera = 'cut'\n[output]")
    result = run(path)
    found = result.poses[0]
    assert [note for note in found.notes if "tall" in note and "cut off by the frame" in note]
    assert not [note for note in found.notes if "small" in note]
    if found.solved:
        assert np.degrees(rotation_angle(found.pose.rotation @ truth["A"][0].T)) < 1.0


def test_photo_whose_only_region_is_cut_off_is_not_solved(corner):
    path, _ = corner()
    crop_photo(path, "A", 110)
    for region in ("small", "wide"):
        (path.parent / "masks" / "A" / f"{region}.png").unlink()
    camera = "[[camera]]\nname = 'cut'\nfocal = 390\nprincipal = [239.5, 69.5]\n"
    edit(path, "[output]", camera + "[[photo]]\npath = 'photos/A.png'\ncamera = 'cut'\n[output]")
    result = run(path)
    assert not result.poses[0].solved and "touches the edge of the photo" in result.poses[0].failure
    assert result.poses[1].solved


def test_no_photo_solved_says_why(corner):
    path, _ = corner()
    edit(path, 'regions = "masks/{photo}/{region}.png"', "")
    with pytest.raises(PoseNotFound, match="None of the 3 photos found its place"):
        run(path)


def test_given_poses_need_no_regions(corner):
    offset = (5_012_300.0, 423_400.0, 0.0)
    path, truth = corner(offset)
    edit(path, 'regions = "masks/{photo}/{region}.png"', "")
    for name, (rotation, translation) in truth.items():
        pose = f"{{ rotation = {rotation.tolist()}, translation = {translation.tolist()} }}"
        edit(path, "[output]", f'[[photo]]\npath = "photos/{name}.png"\npose = {pose}\n[output]')
    result = run(path)
    assert all(pose.given and pose.solved for pose in result.poses) and result.textured.coverage > 0.75
    assert errors(result, truth)[1].max() < 1e-6
    assert result.provenance["photos"][0]["pose"]["centre_sigma"] is None


def test_misspelt_region_of_a_mask(corner):
    path, _ = corner()
    (path.parent / "masks" / "B" / "wide.png").rename(path.parent / "masks" / "B" / "wyde.png")
    with pytest.raises(
        ProjectError, match=r"photo\.regions: .*wyde\.png marks “wyde”, .* did you mean “wide”\?"
    ):
        run(path)
    assert not (path.parent / "out").exists()


@pytest.mark.parametrize(
    ("labels", "reason"),
    [
        (np.zeros(7, np.int32), r"labels of shape \(7,\), but the scan's file has 1200 faces"),
        (np.zeros(1200, np.float32), "has to hold whole numbers, not float32"),
        (np.where(np.arange(1200) < 3, 1, 2), "region.small: no face of scan belongs to it"),
    ],
)
def test_labels_that_do_not_fit_the_scan(corner, labels, reason):
    path, _ = corner()
    np.save(path.parent / "labels.npy", labels)
    with pytest.raises(ProjectError, match=reason):
        run(path)
    assert not (path.parent / "out").exists()


def test_labels_of_faces_do_not_fit_a_cloud(corner):
    path, _ = corner()
    scan = path.parent / "scan.ply"
    lines = scan.read_text().splitlines()
    kept = [line for line in lines if not line.startswith(("3 ", "element face", "property list"))]
    scan.write_text("\n".join(kept) + "\n")
    with pytest.raises(ProjectError, match=r"but the scan's file has \d+ points"):
        run(path)


def test_a_damaged_scan_is_told_as_any_other_wrong_input(corner):
    path, _ = corner()
    (path.parent / "scan.ply").write_bytes(b"ply\nno scan")
    with pytest.raises(ProjectError, match=r"project\.toml: scan\.path: .*scan\.ply") as told:
        run(path)
    assert told.value.key == "scan.path"
    assert not (path.parent / "out").exists()


def test_a_damaged_label_file_is_told_in_our_own_words(corner):
    path, _ = corner()
    (path.parent / "labels.npy").write_bytes(b"no array")
    with pytest.raises(ProjectError, match=r"regions\.labels: .*labels\.npy is damaged, or no array"):
        run(path)


def test_cut_off_photo_and_empty_mask_are_found_before_anything_is_written(corner):
    path, _ = corner()
    photo = path.parent / "photos" / "C.png"
    whole = photo.read_bytes()
    photo.write_bytes(whole[:-100])
    with pytest.raises(ProjectError, match=r"photo\.path: .*C\.png: the photo is cut off"):
        run(path)
    photo.write_bytes(whole)
    mask = path.parent / "masks" / "C" / "tall.png"
    mask.write_bytes(cv2.imencode(".png", np.zeros((360, 480), np.uint8))[1].tobytes())
    with pytest.raises(ProjectError, match=r"photo\.regions: .*tall\.png: the mask is empty"):
        run(path)
    assert not (path.parent / "out").exists()


def test_photo_that_disappears_during_the_run(corner):
    path, _ = corner()
    job = run_project_job(load_project(path))
    for progress in job:
        if progress.fraction > 0.3:
            break
    (path.parent / "photos" / "B.png").unlink()
    with pytest.raises((PhotoError, FileNotFoundError)):
        list(job)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="the administrator may write everywhere")
def test_read_only_folder(corner):
    path, _ = corner()
    (path.parent / "out").mkdir(mode=0o500)
    with pytest.raises(OutputError, match=r"out.*no permission to write there; choose another"):
        run(path)


@pytest.mark.parametrize("code", [errno.EROFS, errno.EACCES])
def test_folder_that_may_not_be_written(corner, monkeypatch, code):
    path, _ = corner()

    def refuse(*arguments, **options):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("fresco.core.files.tempfile.mkstemp", refuse)
    with pytest.raises(OutputError, match=r"(read-only|no permission).*choose another output folder"):
        run(path)


def test_full_disk_keeps_finished_work_and_leaves_no_halves(corner, monkeypatch):
    path, _ = corner()
    solved = count_solved(monkeypatch)

    def full(*arguments, **options):
        arguments[0].write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("fresco.core.project.store.np.savez", full)
        with pytest.raises(OutputError, match=r"\.npz: cannot be written: the disk is full; free some space"):
            run(path)
    assert not list((path.parent / "out").glob("**/*.part"))
    assert not (path.parent / "out" / "cache" / "texture.npz").exists()
    run(path)
    assert len(solved) == 3


def turn_scan_over(path):
    lines = (path.parent / "scan.ply").read_text().splitlines()
    turned = [" ".join(["3", *line.split()[:0:-1]]) if line.startswith("3 ") else line for line in lines]
    assert sum(a != b for a, b in zip(lines, turned, strict=True)) == 1200
    (path.parent / "scan.ply").write_text("\n".join(turned) + "\n")


def test_scan_inside_out_is_refused_and_turned_over_by_the_setting(corner):
    path, _ = corner()
    turn_scan_over(path)
    with pytest.raises(TextureError, match=r"see the back of scan \(100 % .*turn_over = true"):
        run(path)
    edit(path, "[scan]", "[scan]\nturn_over = true")
    result = run(path)
    assert result.textured.coverage > 0.75
    assert "Turned over all faces, as the settings ask." in result.scan.report


def test_poses_that_look_past_the_scan_are_refused(corner):
    path, _ = corner()
    pose = "{ rotation = [[1, 0, 0], [0, 0, -1], [0, 1, 0]], centre = [5, 5000, 1] }"
    edit(path, 'regions = "masks/{photo}/{region}.png"', f"pose = {pose}")
    with pytest.raises(TextureError, match="No photo sees scan"):
        run(path)


def test_inputs_are_never_changed(corner):
    path, _ = corner()
    before = {file: file.read_bytes() for file in path.parent.rglob("*") if file.is_file()}
    run(path)
    assert all(file.read_bytes() == data for file, data in before.items())


def test_check_reads_everything_once_and_reports_progress(corner):
    path, _ = corner()
    fractions = [progress.fraction for progress in check_inputs_job(load_project(path))]
    assert fractions == sorted(fractions) and fractions[-1] <= 1
