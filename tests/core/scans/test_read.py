from pathlib import Path

import numpy as np
import pytest
import trimesh
from fresco.core.errors import ScanError
from fresco.core.jobs import Progress
from fresco.core.scans import read_scan, read_scan_job
from fresco.core.settings import ScanSettings

QUAD_OBJ = """# a box corner
o Südwand Panel
v 0 0 0
v 2 0 0
v 2 0 1
v 0 0 1
f 1/1/1 2/2/1 3/3/1 4/4/1
g roof left
v 0 1 1
v 2 1 1
usemtl stone
f -2 -3 -4
f -1 -2 -4
"""


def grid(n=6, step=0.5):
    """An n x n grid in the plane z = 0, faces up: vertices, faces."""
    x, y = np.meshgrid(np.arange(n) * step, np.arange(n) * step)
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    return vertices, np.concatenate([np.stack([i, i + 1, i + n], 1), np.stack([i + 1, i + n + 1, i + n], 1)])


def write_ply(path, vertices, faces, text=False, double=False, label=None, rgb=None, intensity=None):
    """Write a PLY of our own, so that the reader is not tested against the library it uses."""
    kind = "double" if double else "float"
    header = ["ply", f"format {'ascii' if text else 'binary_little_endian'} 1.0", "comment made here"]
    header += [f"element vertex {len(vertices)}", *(f"property {kind} {axis}" for axis in "xyz")]
    header += [f"property uchar {c}" for c in ("red", "green", "blue")] if rgb is not None else []
    header += ["property float scalar_Intensity"] if intensity is not None else []
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    header += ["property int part"] if label is not None else []
    body = bytearray()
    for i, xyz in enumerate(vertices):
        row = np.asarray(xyz, dtype="<f8" if double else "<f4")
        items = [*map(repr, map(float, row)), *(map(str, rgb[i]) if rgb is not None else [])]
        items += [str(intensity[i])] if intensity is not None else []
        raw = row.tobytes() + (bytes(rgb[i]) if rgb is not None else b"")
        raw += np.float32(intensity[i]).tobytes() if intensity is not None else b""
        body += (" ".join(items) + "\n").encode() if text else raw
    for i, face in enumerate(faces):
        items = [len(face), *face, *([label[i]] if label is not None else [])]
        raw = bytes([len(face)]) + np.asarray(items[1:], dtype="<i4").tobytes()
        body += (" ".join(map(str, items)) + "\n").encode() if text else raw
    path.write_bytes("\n".join([*header, "end_header", ""]).encode() + bytes(body))
    return path


@pytest.fixture
def unicode_folder(tmp_path):
    folder = tmp_path / "Műemlék felmérés – 教会"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("text", [False, True])
def test_ply_with_labels_colours_and_intensity(unicode_folder, text):
    vertices, faces = grid()
    label = np.arange(len(faces)) % 3
    rgb = np.arange(3 * len(vertices)).reshape(-1, 3).astype(np.uint8)
    intensity = np.linspace(0, 1, len(vertices)).astype(np.float32)
    path = write_ply(unicode_folder / "nyugati fal.ply", vertices, faces, text, False, label, rgb, intensity)
    scan = read_scan(path)
    np.testing.assert_array_equal(scan.faces, faces)
    np.testing.assert_allclose(scan.vertices, vertices, atol=1e-6)
    assert scan.report == () and scan.name == "nyugati fal" and not scan.offset.any()
    assert set(scan.face_sets) == {"part 1", "part 2"}
    np.testing.assert_array_equal(scan.face_set("part 2"), np.flatnonzero(label == 2))
    np.testing.assert_array_equal(scan.vertex_colors, rgb)
    np.testing.assert_allclose(scan.intensity, intensity, atol=1e-6)


@pytest.mark.parametrize("text", [False, True])
def test_ply_with_mixed_polygons_keeps_file_faces(tmp_path, text):
    vertices, _ = grid(3)
    polygons = [[0, 1, 4, 3], [1, 2, 4], [2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]]
    scan = read_scan(write_ply(tmp_path / "mixed.ply", vertices, polygons, text, label=[1, 0, 2, 2, 0]))
    assert scan.file_face_count == 5
    np.testing.assert_array_equal(scan.file_faces, [0, 0, 1, 2, 3, 3, 4, 4])
    np.testing.assert_array_equal(scan.face_set("part 2"), [3, 4, 5])
    area = (
        np.cross(*(scan.vertices[scan.faces[:, i]] - scan.vertices[scan.faces[:, 0]] for i in (1, 2)))[:, 2]
        / 2
    )
    assert area.sum() == pytest.approx(1.0) and (area > 0).all()


def test_obj_objects_groups_quads_and_relative_indices(unicode_folder):
    path = unicode_folder / "déli homlokzat.obj"
    path.write_text(QUAD_OBJ, encoding="utf-8")
    scan = read_scan(path)
    assert len(scan.faces) == 4 and scan.file_face_count == 3
    assert set(scan.face_sets) == {"Südwand Panel", "roof", "left"}
    np.testing.assert_array_equal(scan.face_set("Südwand Panel"), [0, 1, 2, 3])
    np.testing.assert_array_equal(scan.face_set("roof"), [2, 3])
    np.testing.assert_allclose(scan.vertices[scan.faces[2]], [[0, 1, 1], [0, 0, 1], [2, 0, 1]])


def test_obj_interleaved_with_normals_and_colours(tmp_path):
    vertices, faces = grid(4)
    lines = [f"vn 0 0 1\nv {x} {y} {z} 0.5 1.0 0.0\r" for x, y, z in vertices]
    lines += [f"f {a + 1}//{a + 1} {b + 1}//{b + 1} {c + 1}//{c + 1}" for a, b, c in faces]
    (tmp_path / "m.obj").write_text("\n".join(lines))
    scan = read_scan(tmp_path / "m.obj")
    np.testing.assert_array_equal(scan.faces, faces)
    np.testing.assert_array_equal(scan.vertex_colors[3], [128, 255, 0])


def test_obj_across_chunks_gives_the_same(tmp_path, monkeypatch):
    vertices, faces = grid(9)
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in vertices)
    half = len(faces) // 2
    text += "g one\n" + "".join("f {} {} {}\n".format(*(face + 1)) for face in faces[:half])
    text += "g two\n" + "".join("f {} {} {}\n".format(*(face - 81)) for face in faces[half:])
    (tmp_path / "m.obj").write_text(text)
    monkeypatch.setattr("fresco.core.scans.obj._CHUNK", 100)
    scan = read_scan(tmp_path / "m.obj")
    np.testing.assert_array_equal(scan.faces, faces)
    np.testing.assert_array_equal(scan.face_set("two"), np.arange(half, len(faces)))


def test_glb_is_turned_from_y_up_and_objects_are_face_sets(unicode_folder):
    vertices, faces = grid()
    y_up = vertices[:, [0, 2, 1]] * [1, 1, -1]  # our (x, y, z) is (x, z, -y) there
    scene = trimesh.Scene()
    move = trimesh.transformations.translation_matrix([10, 0, 0])
    scene.add_geometry(trimesh.Trimesh(y_up, faces, process=False), node_name="floor", geom_name="a")
    scene.add_geometry(
        trimesh.Trimesh(y_up, faces, process=False), node_name="apse", geom_name="b", transform=move
    )
    path = unicode_folder / "modell.glb"
    path.write_bytes(scene.export(file_type="glb"))
    scan = read_scan(path)
    assert set(scan.face_sets) == {"floor", "apse"}
    np.testing.assert_allclose(
        np.unique(scan.vertices[scan.faces[scan.face_set("floor")].ravel()], axis=0),
        np.unique(vertices, axis=0),
        atol=1e-6,
    )
    assert scan.vertices[scan.faces[scan.face_set("apse")]][..., 0].min() == pytest.approx(10)
    corners = scan.vertices[scan.faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()


def test_stl_is_welded(tmp_path):
    vertices, faces = grid()
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "a.stl")
    scan = read_scan(tmp_path / "a.stl")
    assert len(scan.vertices) == len(vertices)
    assert scan.report == (f"Joined {3 * len(faces) - len(vertices)} vertices at the same place.",)


def test_grid_coordinates_keep_a_tenth_of_a_millimetre(tmp_path):
    vertices, faces = grid()
    shift = np.array([5_012_345.678, 423_456.789, 112.5])
    scan = read_scan(write_ply(tmp_path / "grid.ply", vertices + shift, faces, double=True))
    np.testing.assert_array_equal(scan.offset, [5_012_300, 423_500, 0])
    assert np.abs(scan.vertices).max() < 200
    np.testing.assert_allclose(scan.world(scan.vertices), vertices + shift, atol=1e-8)
    assert scan.vertices.astype(np.float32) == pytest.approx(vertices + shift - scan.offset, abs=1e-4)
    assert scan.report == ("Large coordinates: moved by an offset of 5012300, 423500, 0 m.",)


def test_single_precision_grid_coordinates_are_told(tmp_path):
    vertices, faces = grid(4, step=8.0)
    scan = read_scan(write_ply(tmp_path / "grid.ply", vertices + np.array([5_000_000, 0, 0]), faces))
    assert "steps of 500 mm" in scan.report[1] and "double precision" in scan.report[1]


def test_a_scan_in_millimetres_is_asked_about(tmp_path):
    vertices, faces = grid()
    path = write_ply(tmp_path / "wall.ply", vertices * 1000, faces)
    assert (
        read_scan(path)
        .report[-1]
        .startswith('The scan is 2500 m across: is its unit mm? Then set unit = "mm"')
    )
    assert not [line for line in read_scan(path, ScanSettings(unit=0.001)).report if "unit" in line]
    small = write_ply(tmp_path / "small.ply", vertices, faces)
    assert not read_scan(small).report
    told = read_scan(small, ScanSettings(unit=0.001)).report[-1]
    assert told.startswith("The scan is 2.5 mm across: is its unit right?")


def test_unit_up_and_offset_settings(tmp_path):
    vertices, faces = grid()
    path = write_ply(tmp_path / "mm.ply", vertices * 1000, faces, double=True)
    scan = read_scan(path, ScanSettings(unit=0.001, up="y", offset=(1.0, 2.0, 3.0)))
    np.testing.assert_allclose(scan.world(scan.vertices), vertices[:, [0, 2, 1]] * [1, -1, 1], atol=1e-12)
    np.testing.assert_array_equal(scan.offset, [1, 2, 3])


def test_progress_ends_at_one_and_never_falls(tmp_path):
    vertices, faces = grid()
    steps = list(read_scan_job(write_ply(tmp_path / "a.ply", vertices, faces)))
    assert all(isinstance(step, Progress) for step in steps)
    fractions = [step.fraction for step in steps]
    assert fractions == sorted(fractions) and fractions[-1] <= 1


def test_point_cloud_without_faces(tmp_path):
    vertices, _ = grid()
    vertices[4] = np.nan
    scan = read_scan(write_ply(tmp_path / "cloud.ply", vertices, []))
    assert scan.is_cloud and len(scan.vertices) == 35
    assert scan.report == ("Dropped 1 points with undefined coordinates.",)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb", ".stl"])
def test_missing_and_damaged_files(tmp_path, suffix):
    path = tmp_path / f"scan{suffix}"
    with pytest.raises(ScanError, match="no such file"):
        read_scan(path)
    path.write_bytes(b"\x00garbage, v 1 2\nv \xff\xfe 1 2 3\n" * 9)
    with pytest.raises(ScanError, match=str(path)):
        read_scan(path)
    path.write_bytes(b"")
    with pytest.raises(ScanError, match=str(path)):
        read_scan(path)


@pytest.mark.parametrize("text", [False, True])
def test_truncated_ply(tmp_path, text):
    vertices, faces = grid()
    path = write_ply(tmp_path / "cut.ply", vertices, faces, text)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(ScanError, match="truncated"):
        read_scan(path)


def test_unknown_format_names_the_known():
    with pytest.raises(ScanError, match=r"unknown scan format “\.dwg”; known are .*\.ply"):
        read_scan(Path("wall.dwg"))
