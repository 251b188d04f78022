from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from fresco.core.errors import OutputError, TextureError
from fresco.core.texture import select_views, write_obj
from painted_scenes import grid_mesh, wall_views

WALL = grid_mesh(12, 9, 6.0, 4.5)


@pytest.fixture
def textured(tmp_path):
    views = wall_views(WALL, [(-1.2, 0.3, -4.0), (1.2, -0.2, -4.2)])
    folder = tmp_path / "Fotos Kirche Szent György"
    folder.mkdir()
    files = []
    for view in views:
        path = folder / f"bild {view.name} ő.png"
        path.write_bytes(cv2.imencode(".png", view.image[..., ::-1])[1].tobytes())
        files.append(replace(view, image=path, name=""))
    return files, select_views(*WALL, files)


def read_obj(path):
    vertices, uvs, faces, material = [], [], [], None
    for line in path.read_text(encoding="utf-8").splitlines():
        kind, _, rest = line.partition(" ")
        if kind == "v":
            vertices.append([float(x) for x in rest.split()])
        elif kind == "vt":
            uvs.append([float(x) for x in rest.split()])
        elif kind == "usemtl":
            material = rest
        elif kind == "f":
            corners = [[int(i) for i in corner.split("/")] for corner in rest.split()]
            faces.append((material, corners))
    return np.array(vertices), np.array(uvs), faces


def read_textures(path):
    maps, name = {}, None
    for line in path.read_text(encoding="utf-8").splitlines():
        kind, _, rest = line.partition(" ")
        if kind == "newmtl":
            name = rest
        elif kind == "map_Kd":
            maps[name] = rest
    return maps


def test_the_files_say_the_same_as_the_selection(tmp_path, textured):
    views, selection = textured
    target = tmp_path / "modell fertig.obj"
    offset = np.array([5_123_456.25, 4_000_000.5, 120.125])
    write_obj(target, *WALL, selection, views, offset)
    vertices, uvs, faces = read_obj(target)
    np.testing.assert_allclose(vertices - offset, WALL[0], atol=1e-6)
    textures = read_textures(target.with_suffix(".mtl"))
    found = {tuple(c[0] - 1 for c in corners): (name, corners) for name, corners in faces}
    assert len(found) == len(WALL[1])
    for face, corner_vertices in enumerate(WALL[1]):
        name, corners = found[tuple(corner_vertices)]
        number = selection.view[face]
        if number < 0:
            assert name == "unseen"
            assert all(len(c) == 1 for c in corners)
            continue
        photo = (target.parent / textures[name]).resolve()
        assert photo == views[number].image.resolve()
        assert "\\" not in textures[name]
        uv = uvs[[c[1] - 1 for c in corners]]
        pixel = np.stack([uv[:, 0] * 320 - 0.5, (1 - uv[:, 1]) * 240 - 0.5], axis=1)
        np.testing.assert_allclose(pixel, selection.uv[face], atol=1e-4)


def test_trimesh_reads_it(tmp_path, textured):
    trimesh = pytest.importorskip("trimesh")
    views, selection = textured
    target = write_obj(tmp_path / "model.obj", *WALL, selection, views)
    scene = trimesh.load(target, process=False, force="scene", skip_materials=True)
    assert sum(len(g.faces) for g in scene.geometry.values()) == len(WALL[1])


def test_photos_with_the_same_name_get_different_materials(tmp_path, textured):
    views, selection = textured
    twins = [replace(view, name="DSC 001") for view in views]
    target = write_obj(tmp_path / "model.obj", *WALL, selection, twins)
    assert set(read_textures(target.with_suffix(".mtl"))) == {"DSC_001", "DSC_001_2"}


def test_failure_leaves_nothing_behind(tmp_path, textured):
    views, selection = textured
    with pytest.raises(TextureError, match="the mesh has 12"):
        write_obj(tmp_path / "m.obj", WALL[0], WALL[1][:12], selection, views)
    with pytest.raises(TextureError, match="only a photo that is a file"):
        write_obj(
            tmp_path / "m.obj",
            *WALL,
            selection,
            [replace(v, image=np.zeros((240, 320, 3), np.uint8)) for v in views],
        )
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be written"):
        write_obj(tmp_path / "file" / "m.obj", *WALL, selection, views)
    assert not [p for p in tmp_path.iterdir() if p.suffix in (".obj", ".mtl")]


def test_an_older_file_survives_a_failure(tmp_path, textured, monkeypatch):
    views, selection = textured
    target = write_obj(tmp_path / "m.obj", *WALL, selection, views)
    before = target.read_bytes()
    import fresco.core.texture.models.obj as module

    def full_disk(*_):
        raise OSError(28, "No space left on device")
        yield

    monkeypatch.setattr(module, "_face_rows", full_disk)
    with pytest.raises(OutputError, match="the disk is full"):
        write_obj(target, *WALL, selection, views)
    assert target.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(
        {"m.obj", "m.mtl", "Fotos Kirche Szent György"}
    )
