"""Surveyed points in a project: picked or found, matched, told."""

import cv2
import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.errors import ProjectError, ScanError
from fresco.core.project import load_project, run_project
from fresco.core.project.stages.point_poses import read_picks

CAMERA = PerspectiveCamera(480, 360, np.array([[390.0, 0, 239.5], [0, 390, 179.5], [0, 0, 1]]))
POINTS = {
    "P1": (0.4, 0, 0.5), "P2": (1.6, 0, 2.2), "P3": (0, 0.5, 2.0), "P4": (0, 1.4, 0.6), "P5": (1.0, 0, 1.2),
    "P6": (0, 0.9, 1.5), "P7": (0.2, 0, 2.4),
}  # fmt: skip


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def seen(truth, name, offset=(0, 0, 0)):
    """Pixels of the points in a photo."""
    rotation, translation = truth[name]
    points = np.array(list(POINTS.values())) + offset
    return dict(zip(POINTS, CAMERA.project(points @ rotation.T + translation).tolist(), strict=True))


@pytest.fixture
def surveyed(corner):
    def write(offset=(0.0, 0.0, 0.0)):
        path, truth = corner(offset)
        rows = ["name;x;y;z"]
        moved = {name: np.add(point, offset).tolist() for name, point in POINTS.items()}
        rows += [f"{name};{x:.4f};{y:.4f};{z:.4f}" for name, (x, y, z) in moved.items()]
        (path.parent / "control.csv").write_text("\n".join(rows))
        return path, truth

    return write


@pytest.mark.parametrize("offset", [(0, 0, 0), (5_012_300.0, 423_400.0, 0.0)], ids=["near", "national grid"])
def test_picked_points_place_a_photo_and_wrong_ones_are_told(surveyed, offset):
    path, truth = surveyed(offset)
    pixels = seen(truth, "B", offset)
    pixels["P5"] = [300.0, 40.0]
    pixels["P9"] = [10.0, 10.0]
    picks = ", ".join(f"{name} = [{u:.3f}, {v:.3f}]" for name, (u, v) in pixels.items())
    edit(path, "[output]", f'[points]\npath = "control.csv"\n[[photo]]\npath = "photos/B.png"\n'
         f"points = {{ {picks} }}\n[output]")  # fmt: skip
    result = run_project(load_project(path))
    a, b, _ = result.poses
    assert a.overlap_error is not None and not a.points, "the others come from their regions"
    assert b.overlap_error is None and len(b.points) == 7
    rotation, translation = truth["B"]
    assert np.linalg.norm(b.pose.centre + result.scan.offset + rotation.T @ translation) < 0.005
    assert b.notes == ("Not in the table of points: P9.",
                       "Left out because they contradict the others: P5.")  # fmt: skip
    assert [point.used for point in b.points] == [name != "P5" for name in POINTS]
    assert b.sure_pose is not None
    told = result.provenance["photos"][1]["pose"]["points"]
    assert told[0]["name"] == "P1" and max(map(abs, told[0]["residual"])) < 0.1


def test_too_few_points_leave_the_pose_from_regions_and_say_so(surveyed):
    path, truth = surveyed()
    lines = [f"{name}, {u}, {v}" for name, (u, v) in list(seen(truth, "A").items())[:3]]
    (path.parent / "picks A.csv").write_text("name, u, v\n" + "\n".join(lines))
    edit(path, 'path = "photos/*.png"', 'path = "photos/*.png"\npoints = "picks {photo}.csv"')
    with pytest.raises(ProjectError, match="points: is missing; name the table"):
        load_project(path)
    edit(path, "[output]", '[points]\npath = "control.csv"\n[output]')
    result = run_project(load_project(path))
    assert all(pose.overlap_error is not None for pose in result.poses)
    assert any("Not posed by points: Only 3 usable points" in note for note in result.poses[0].notes)


@pytest.mark.parametrize("kind", ["aruco-4x4", "checkerboard"])
def test_markers_are_found_and_matched_by_name_or_by_place(surveyed, kind):
    path, truth = surveyed()
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_1000)
    names = list(POINTS)
    if kind == "aruco-4x4":
        text = (path.parent / "control.csv").read_text()
        (path.parent / "control.csv").write_text(text.replace("P", ""))
    file = path.parent / "photos" / "B.png"
    image = cv2.imdecode(np.fromfile(file, np.uint8), cv2.IMREAD_COLOR)
    for number, name in enumerate(names, 1):
        u, v = np.rint(np.add(seen(truth, "B")[name], 0.5)).astype(int)  # an even patch
        size = 24 if kind == "aruco-4x4" else 16
        patch = np.full((size + 8, size + 8), 255, np.uint8)
        if kind == "aruco-4x4":
            patch[4:-4, 4:-4] = cv2.aruco.generateImageMarker(dictionary, number, size)
        else:
            patch[:] = 255
            patch[: len(patch) // 2, : len(patch) // 2] = patch[len(patch) // 2 :, len(patch) // 2 :] = 0
        half = len(patch) // 2
        image[v - half : v + half, u - half : u + half] = patch[..., None]
    file.write_bytes(cv2.imencode(".png", image)[1].tobytes())
    edit(path, "[output]", f'[points]\npath = "control.csv"\nmarkers = "{kind}"\n[output]')
    result = run_project(load_project(path))
    b = result.poses[1]
    assert len(b.points) >= 5, b.notes
    rotation, translation = truth["B"]
    assert np.linalg.norm(b.pose.centre + rotation.T @ translation) < 0.06  # drawn to whole pixels of 13 mm
    edit(path, f'"{kind}"', '"chequers"')
    with pytest.raises(ProjectError, match=r"points.markers: has to be one of checkerboard"):
        load_project(path)


def test_tables_of_picks_may_be_written_in_several_ways(tmp_path):
    file = tmp_path / "picks.txt"
    for text in ("P1,10.5,20\n", "name;u;v\nP1;10.5;20", "# note\n\nP1\t10.5\t20", "P1 10.5 20"):
        file.write_text(text)
        assert read_picks(file) == {"P1": (10.5, 20.0)}
    file.write_text("P1,1,2\nP2,1")
    with pytest.raises(ScanError, match="line 2: a name and two pixels are needed"):
        read_picks(file)
