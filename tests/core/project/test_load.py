import json

import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera, FisheyeCamera, PerspectiveCamera
from fresco.core.errors import ProjectError
from fresco.core.project.file.load import load_project

WIDTH, HEIGHT = 96, 64


def edit(folder, *changes):
    """Change the project file: (old, new) pairs, or text added at its end."""
    path = folder / "terv.toml"
    text = path.read_text(encoding="utf-8")
    for change in changes:
        old, new = change if isinstance(change, tuple) else ("", None)
        assert old in text
        text = text.replace(old, new, 1) if new is not None else text + change
    path.write_text(text, encoding="utf-8")
    return path


def complaint(folder, *changes):
    path = edit(folder, *changes)
    with pytest.raises(ProjectError) as error:
        load_project(path)
    assert str(error.value).startswith(str(path)) and "\n" not in str(error.value)
    return f"{error.value.key}: {error.value.reason}"


def test_complete_project(folder):
    project = load_project(folder / "terv.toml")
    assert project.scan.path == folder / "felmérés" / "déli fal.ply"
    assert project.regions.labels[0].names == {1: "ablak", 2: "fülke bal", 3: "ajtó"}
    assert [entry.photo.name for entry in project.photos] == ["kép 1", "kép 2"]
    assert [mark.name for mark in project.photos[1].photo.regions] == ["ablak", "fülke bal"]
    assert {entry.use for entry in project.photos} == {"texture"}
    camera = project.photos[0].photo.camera
    np.testing.assert_array_equal(camera.K, [[80, 0, 47.5], [0, 80, 31.5], [0, 0, 1]])
    assert project.output.folder == folder / "eredmény mappa"
    assert project.output.name == "terv" and project.output.glb
    assert not project.output.folder.exists()


def test_settings_are_read_with_their_types(folder):
    path = edit(
        folder,
        ("[scan]", '[scan]\nunit = "mm"\nup = "y"\noffset = [1, 2, 3.5]\nturn_over = true'),
        '[texture]\nmax_angle = 70\nscore = "published"\nequalise = false\nmax_candidates = 4\n',
        "[pose]\noverlap_limit = 3.5\n",
    )
    project = load_project(path)
    assert project.scan.settings.unit == 0.001 and project.scan.settings.offset == (1.0, 2.0, 3.5)
    assert project.scan.settings.turn_over and project.scan.settings.up == "y"
    assert (project.texture.max_angle, project.texture.score, project.texture.equalise) == (
        70,
        "published",
        False,
    )
    assert project.texture.max_candidates == 4 and isinstance(project.texture.max_candidates, int)
    assert project.pose.overlap_limit == 3.5


def test_later_photo_entries_add_to_earlier_ones(folder):
    path = edit(
        folder,
        '[[camera]]\nname = "tele"\nfocal = [200, 201]\nprincipal = [40, 30]\ndistortion = [0.01, 0.002]\n',
        '[[photo]]\npath = "képek/kép 2.png"\ncamera = "tele"\nuse = "pose"\n',
    )
    first, second = load_project(path).photos
    assert first.photo.camera.K[0, 0] == 80 and first.use == "texture"
    np.testing.assert_array_equal(second.photo.camera.K, [[200, 0, 40], [0, 201, 30], [0, 0, 1]])
    assert second.use == "pose" and len(second.photo.regions) == 2


def test_photo_left_out(folder):
    path = edit(folder, '[[photo]]\npath = "képek/kép 1.png"\nuse = "none"\n')
    assert [entry.photo.name for entry in load_project(path).photos] == ["kép 2"]


def test_given_pose_by_translation_or_centre(folder):
    turn = "rotation = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]"
    path = edit(
        folder,
        f'[[photo]]\npath = "képek/kép 1.png"\npose = {{ {turn}, centre = [1, 2, 3] }}\n',
        f'[[photo]]\npath = "képek/kép 2.png"\npose = {{ {turn}, translation = [1, 2, 3] }}\n',
    )
    first, second = load_project(path).photos
    np.testing.assert_allclose(first.pose[0] @ [1, 2, 3] + first.pose[1], 0)
    np.testing.assert_array_equal(second.pose[1], [1, 2, 3])


def test_regions_by_table_and_polygon_file(folder):
    polygon = {
        "features": [
            {
                "properties": {"name": "ajtó"},
                "geometry": {"type": "Polygon", "coordinates": [[[1, 1], [9, 1], [9, 9], [1, 1]]]},
            }
        ]
    }
    (folder / "maszkok" / "kép 2.json").write_text(json.dumps(polygon), encoding="utf-8")
    path = edit(
        folder,
        '[[photo]]\npath = "képek/kép 1.png"\nregions = { ablak = "maszkok/kép 1/ablak.png" }\n',
        '[[photo]]\npath = "képek/kép 2.png"\nregions = "maszkok/{photo}.json"\n',
    )
    first, second = (entry.photo.regions for entry in load_project(path).photos)
    assert [mark.name for mark in first] == ["ablak"]
    assert [mark.name for mark in second] == ["ajtó"]
    np.testing.assert_array_equal(second[0].outline, [[1, 1], [9, 1], [9, 9]])


def test_usable_masks_by_pattern(folder):
    (folder / "maszkok" / "kép 1.png").write_bytes((folder / "maszkok/kép 1/ablak.png").read_bytes())
    first, second = load_project(
        edit(folder, ("regions =", 'mask = "maszkok/{photo}.png"\nregions ='))
    ).photos
    assert first.photo.mask == folder / "maszkok" / "kép 1.png" and second.photo.mask is None


def test_single_regions(folder):
    np.save(folder / "felmérés" / "boltív.npy", np.arange(5))
    path = edit(
        folder,
        '[[region]]\nname = "boltív"\nfaces = "felmérés/boltív.npy"\n',
        '[[region]]\nname = "ablak 2"\nlabels = "felmérés/címkék.npz"\nkey = "other"\nid = 4\n',
        '[[region]]\nname = "torony"\nface_set = "Tower"\n',
    )
    regions = load_project(path).regions
    assert [source.region_names for source in regions.labels[1:]] == [["boltív"], ["ablak 2"]]
    assert regions.face_sets == {"torony": "Tower"} and not regions.all_face_sets


def test_without_region_tables_all_face_sets_count(folder):
    text = (folder / "terv.toml").read_text(encoding="utf-8")
    start, end = text.index("[regions]"), text.index("[[camera]]")
    (folder / "terv.toml").write_text(text[:start] + text[end:], encoding="utf-8")
    assert load_project(folder / "terv.toml").regions.all_face_sets


@pytest.mark.parametrize(
    ("numbers", "kind"),
    [
        ("focal_mm = 35\nsensor_width_mm = 36", PerspectiveCamera),
        ("K = [[80, 0, 48], [0, 81, 32], [0, 0, 1]]\nsize = [96, 64]", PerspectiveCamera),
        ('model = "fisheye"\nfocal = 40\ncoefficients = [0.01, 0, 0, 0]', FisheyeCamera),
        ('model = "equirectangular"', EquirectangularCamera),
        ('preset = "NIKON D850"\nfocal_mm = 24', PerspectiveCamera),
        ('preset = "NIKON D850"\nfocal_mm = 16\nlens = "equidistant"', FisheyeCamera),
    ],
)
def test_camera_models(folder, numbers, kind):
    project = load_project(edit(folder, ("focal = 80.0", numbers)))
    assert isinstance(project.photos[0].photo.camera, kind)


def test_camera_from_calibration_file(folder):
    camera = {
        "model": "perspective",
        "width": WIDTH,
        "height": HEIGHT,
        "K": [[70, 0, 40], [0, 70, 30], [0, 0, 1]],
    }
    (folder / "kalibráció.json").write_text(json.dumps(camera))
    project = load_project(edit(folder, ("focal = 80.0", 'file = "kalibráció.json"')))
    assert project.photos[0].photo.camera.K[0, 0] == 70
    photo = project.photos[0].photo
    assert "kalibráció.json" in photo.camera_source and photo.notes == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("fresco = 1", "fresco = 2"),
            "fresco: has to be 1, the version of the file format; a newer Fresco wrote this one",
        ),
        (
            ("fresco = 1", ""),
            "fresco: has to be 1, the version of the file format: write fresco = 1 on the first line",
        ),
        (
            ("fresco = 1", "fresco = 1\nscann = 2"),
            "scann: is not known here; did you mean “scan”? If not, take it out",
        ),
        (('path = "felmérés/déli fal.ply"', "pth = 1"), "scan.path: is missing; give a text"),
        (("déli fal.ply", "északi fal.ply"), "scan.path: there is no file"),
        (('path = "felmérés/déli fal.ply"', "path = 3"), "scan.path: has to be a text, not 3"),
        (("déli fal.ply", "címkék.npz"), "scan.path: unknown scan format “.npz”; known are"),
        (("[scan]", "[scan]\nunit = 'yard'"), "scan.unit: has to be one of m, dm, cm, mm, ft, in"),
        (("[scan]", "[scan]\nup = 'x'"), "scan.up: has to be one of auto, y, z, not “x”"),
        (
            ("[scan]", "[scan]\nweld_distanc = 0.1"),
            "scan.weld_distanc: is not known here; did you mean “weld_",
        ),
        (("[scan]", "[scan]\nweld_distance = -1"), "scan.weld_distance: is -1, but has to be from 0 to 1"),
        (("[scan]", "[scan]\nturn_over = 1"), "scan.turn_over: has to be true or false, not 1"),
        (("[scan]", "[scan]\noffset = [1, 2]"), "scan.offset: needs 3 numbers, not 2"),
        (("[scan]", "[scan]\noccluders = ['állvány.ply']"), "scan.occluders: there is no file"),
        ("[texture]\nmax_angle = 120\n", "texture.max_angle: is 120, but has to be from 1 to 90"),
        ("[texture]\nmax_angle = nan\n", "texture.max_angle: is nan, but has to be from 1 to 90"),
        ("[texture]\nmax_candidates = 2.5\n", "texture.max_candidates: has to be a whole number, not 2.5"),
        ("[texture]\nscore = 'texl'\n", "texture.score: has to be one of texel, published, not “texl”"),
        ("[texture]\nequalize = true\n", "texture.equalize: is not known here; did you mean “equalise”?"),
        ("[pose]\noverlap_limit = true\n", "pose.overlap_limit: has to be a number, not true"),
        (("címkék.npz", "cimkek.npz"), "regions.labels: there is no file"),
        (("címkék.npz", "déli fal.ply"), "regions.labels: has to be a .npy or .npz file"),
        (('"ajtó" = 3', '"ajtó" = 2'), "regions.names.ajtó: has to be a whole number that no other name has"),
        (('"ajtó" = 3', '"ajtó" = "c"'), "regions.names.ajtó: has to be a number, not “c”"),
        ('[[region]]\nname = "ajtó"\nface_set = "x"\n', "region: “ajtó” is there twice"),
        ('[[region]]\nname = "új"\n', "region[1].face_set: give one of face_set, labels (with id), faces"),
        (("képek/*.png", "képek/*.jpg"), "photo[1].path: no photo matches képek/*.jpg"),
        (("képek/*.png", "képek/kép 3.png"), "photo[1].path: there is no file"),
        (("regions = ", "region = "), "photo[1].region: is not known here; did you mean “regions”?"),
        (
            ("{photo}/{region}.png", "x/{region}/y.png"),
            "photo[1].regions: {region} has to be in the file name",
        ),
        (
            ("[[photo]]", "[[photo]]\nuse = 'both'"),
            "photo[1].use: has to be one of texture, pose, none, not “both”",
        ),
        (("[[photo]]", "[[photo]]\ncamera = 'tele'"), "photo[1].camera: there is no [[camera]] named “tele”"),
        (
            ("[[photo]]", "[[photo]]\npose = { rotation = [[1]] }"),
            "photo[1].pose.rotation: has to be 3 rows of 3",
        ),
        (
            ("[[photo]]", "[[photo]]\npose = { rotation = [[1,0,0],[0,1,0],[0,0,2]], centre = [0,0,0] }"),
            "photo[1].pose.rotation: is no rotation matrix",
        ),
        (
            ("focal = 80.0", "focal = 80.0\nK = [[1]]"),
            "camera[1].K: cannot stand beside “focal”; give one of them",
        ),
        (("focal = 80.0", "focal = -80.0"), "camera[1].focal: is -80, but has to be at least 0.001"),
        (("focal = 80.0", "distortion = [0.1]"), "camera[1]: says nothing of the lens; give focal"),
        (
            ("focal = 80.0", "focal = 80\nxi = 0.9"),
            "camera[1]: 96 x 64 pixels: a perspective camera has no 'xi'",
        ),
        (("focal = 80.0", "focal = 80\nsize = [192, 128]"), "photo[1].path: "),
        (("focal = 80.0", "exif = true"), "camera[1]: the photo does not tell its focal length"),
        (("focal = 80.0", "preset = 'Lomo'"), "camera[1]: 'Lomo' is not in the list of camera bodies"),
        (("focal = 80.0", "preset = 'NIKON D850'"), "camera[1]: The focal length must be a positive number"),
        (("focal = 80.0", "file = 'none.xml'"), "camera[1].file: there is no file"),
        (
            '[[camera]]\nname="a"\nfocal = 3\n[[camera]]\nname="a"\nfocal=4\n',
            "camera[3].name: “a” is there twice",
        ),
        (("eredmény mappa", "terv.toml"), "output.folder: "),
        (("[output]", "[output]\nname = 'a/b'"), "output.name: “a/b” cannot be part of a file name"),
        (("[output]", "[output]\nblend = 'yes'"), "output.blend: has to be true or false, not “yes”"),
        (("[scan]", "scan]"), ": is not TOML: "),
        ("[refine]\nedges = { far = 2 }\n", "refine.edges.far: is not known here (there is: centre_sigma, "),
        ("[texture]\ngain_anchor = 3\n", "texture.gain_anchor: is 3, but the photos are numbered from 0 to "),
    ],
)
def test_wrong_entries_are_told_in_one_line(folder, change, message):
    assert complaint(folder, change).startswith(message)
    assert not (folder / "eredmény mappa").exists()


@pytest.mark.parametrize("path", [r"C:\data\wall.ply", r"C:\users\wall.ply"])
def test_a_path_with_backslashes_is_told_to_be_written_with_slashes(folder, path):
    assert complaint(folder, ("felmérés/déli fal.ply", path)).endswith("; write paths with / instead of \\")


def test_words_are_listed_once(folder):
    text = complaint(folder, ("[scan]", "[scan]\nup = 'sideways'"))
    assert text.endswith("up: has to be one of auto, y, z, not “sideways”")


def test_a_misspelt_key_of_the_regions_is_told_all_there_are(folder):
    assert "kept" in complaint(folder, ("[regions]", "[regions]\nzzz = 1"))


def test_photo_of_another_size_than_its_calibration(folder):
    text = complaint(folder, ("focal = 80.0", "focal = 80\nsize = [192, 128]"))
    assert "kép 1.png is 96 x 64 pixels, but its camera is calibrated for 192 x 128" in text


def test_pixel_numbers_for_photos_of_two_sizes_need_a_size(folder):
    import cv2

    (folder / "képek" / "kép 3.png").write_bytes(
        cv2.imencode(".png", np.zeros((96, 64, 3), np.uint8))[1].tobytes()
    )
    text = complaint(folder)
    assert (
        text
        == "camera[1].size: is missing, and the photos differ: kép 1.png is 96 x 64, kép 3.png is 64 x 96"
    )


def test_mask_of_another_size(folder):
    import cv2

    path = folder / "maszkok" / "kép 2" / "ablak.png"
    path.write_bytes(cv2.imencode(".png", np.full((96, 64), 255, np.uint8))[1].tobytes())
    text = complaint(folder)
    assert (
        text.startswith("photo[1].regions: ")
        and "64 x 96 pixels, its photo 96 x 64 (it was made on the" in text
    )


def test_photos_of_one_name_in_two_folders_keep_their_folder(folder):
    (folder / "képek" / "tele").mkdir()
    (folder / "képek" / "tele" / "kép 1.png").write_bytes((folder / "képek" / "kép 1.png").read_bytes())
    names = [entry.photo.name for entry in load_project(edit(folder, ("képek/*", "képek/**/*"))).photos]
    assert sorted(names) == ["kép 2", "képek_kép 1.png", "képek_tele_kép 1.png"]


def test_project_file_that_cannot_be_read(tmp_path):
    with pytest.raises(ProjectError, match="there is no such project file"):
        load_project(tmp_path / "none.toml")
    (tmp_path / "a.toml").write_bytes(b"fresco = 1\xff")
    with pytest.raises(ProjectError, match="is not UTF-8 text"):
        load_project(tmp_path / "a.toml")
    with pytest.raises(ProjectError, match="cannot be read"):
        load_project(tmp_path)


def test_pattern_may_go_up_from_the_project_file(folder):
    (folder / "projekt").mkdir()
    text = (folder / "terv.toml").read_text(encoding="utf-8")
    for name in ("felmérés/", "képek/", "maszkok/"):
        text = text.replace(f'"{name}', f'"../{name}')
    (folder / "projekt" / "terv.toml").write_text(text, encoding="utf-8")
    project = load_project(folder / "projekt" / "terv.toml")
    assert len(project.photos) == 2 and len(project.photos[0].photo.regions) == 2


def test_up_is_a_direction(folder):
    project = load_project(edit(folder, "[pose]\nup = [0, 0, 1]\n"))
    np.testing.assert_array_equal(project.up, [0, 0, 1])


def test_up_without_length_is_no_direction(folder):
    reason = complaint(folder, "[pose]\nup = [0, 0, 0]\n")
    assert reason == "pose.up: has no direction; give where up is in the scan's axes, such as [0, 0, 1]"


def test_a_byte_order_mark_is_no_part_of_the_text(folder):
    path = folder / "terv.toml"
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(load_project(path).photos) == 2


def test_a_pattern_of_marks_that_fits_no_photo_is_misspelt(folder):
    reason = complaint(folder, ("maszkok/{photo}", "maskok/{photo}"))
    assert reason == "photo[1].regions: no photo has a mask there: maskok/{photo}/{region}.png"


@pytest.mark.parametrize("name", ["maszkok/{photo}.geojson", "regions.json"])
def test_a_file_of_polygons_that_is_not_there(folder, name):
    reason = complaint(folder, ("maszkok/{photo}/{region}.png", name))
    assert reason == f"photo[1].regions: no photo has a file of polygons there: {name}"


def test_one_photo_without_marks_is_no_mistake(folder):
    for mask in (folder / "maszkok" / "kép 2").iterdir():
        mask.unlink()
    project = load_project(folder / "terv.toml")
    assert [len(entry.photo.regions) for entry in project.photos] == [2, 0]


def test_a_mask_without_the_name_of_its_region(folder):
    reason = complaint(folder, ("{photo}/{region}.png", "kép 1/ablak.png"))
    assert reason.startswith("photo[1].regions: maszkok/kép 1/ablak.png does not say which region it marks")
    assert '{ name = "maszkok/kép 1/ablak.png" }' in reason


def test_polygons_that_are_no_json_are_told_with_their_key(folder):
    (folder / "marks.json").write_text("{")
    reason = complaint(folder, ("maszkok/{photo}/{region}.png", "marks.json"))
    assert reason.startswith("photo[1].regions: ") and "marks.json: not a JSON file" in reason


def test_all_photos_left_out(folder):
    reason = complaint(folder, ("regions =", 'use = "none"\nregions ='))
    assert reason == 'photo: all photos have use = "none"; leave at least one in, with use = "texture"'


def test_an_empty_photo_file(folder):
    (folder / "képek" / "kép 2.png").write_bytes(b"")
    reason = complaint(folder)
    assert reason.startswith("photo[1].path: ")
    assert reason.endswith("kép 2.png: the photo file is empty; copy it again from the camera")


@pytest.mark.parametrize("focal", ["4.5", "[80, 4.5]"])
def test_a_focal_length_in_millimetres_is_asked_about(folder, focal):
    reason = complaint(folder, ("focal = 80.0", f"focal = {focal}"))
    assert reason == (
        "camera[1].focal: is 4.5 pixels for a photo of 96: is this in millimetres? Use focal_mm and "
        "sensor_width_mm"
    )


def test_three_distortion_numbers_are_ambiguous(folder):
    reason = complaint(folder, ("focal = 80.0", "focal = 80.0\ndistortion = [-0.1, 0.01, 0.001]"))
    assert reason.startswith("camera[1].distortion: needs 2, 4, 5 or 8 numbers in the order k1, k2, p1, p2")
    assert "[k1, k2, 0, 0, k3]" in reason
