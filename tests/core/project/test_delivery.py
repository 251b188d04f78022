"""Models for delivery in a project: baked atlas, coloured vertices, and what a repeated run leaves alone."""

import cv2
import numpy as np
import pytest
from fresco.core.errors import ProjectError
from fresco.core.project import load_project, run_project
from fresco.core.project.repeated import are_unchanged, keep_unchanged
from fresco.core.project.stages.delivery import DeliverySettings
from fresco.core.project.store import Store
from fresco.core.settings import AtlasSettings
from plyfile import PlyData


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def read_obj(path):
    vertices, uvs, faces, pages, page = [], [], [], [], ""
    for line in path.read_text().splitlines():
        word, *rest = line.split()
        if word == "v":
            vertices.append([float(x) for x in rest])
        elif word == "vt":
            uvs.append([float(x) for x in rest])
        elif word == "usemtl":
            page = rest[0]
        elif word == "f":
            faces.append([[int(n) - 1 for n in corner.split("/")] for corner in rest])
            pages.append(page)
    return np.array(vertices), np.array(uvs), np.array(faces), np.array(pages)


def test_entries_are_checked(corner):
    path, _ = corner()
    assert load_project(path).atlas is None
    edit(path, "[output]", "[atlas]\ntexel_size = 0.01\ndepth = 16\nlevel = false\n[output]")
    expected = DeliverySettings(AtlasSettings(texel_size=0.01, depth=16), level=False)
    assert load_project(path).atlas == expected
    edit(path, "depth = 16", "depth = 12")
    with pytest.raises(ProjectError, match=r"atlas.depth: has to be one of 8, 16, not 12"):
        load_project(path)
    edit(path, "depth = 12", "depht = 8")
    with pytest.raises(ProjectError, match=r"atlas.depht: is not known here; did you mean “depth”"):
        load_project(path)


@pytest.mark.parametrize("offset", [(0, 0, 0), (5_012_300.0, 423_400.0, 0.0)], ids=["near", "national grid"])
def test_a_run_bakes_an_atlas_that_shows_the_photos(corner, offset):
    path, _ = corner(offset)
    table = "[atlas]\ntexel_size = 0.01\npage_size = 256\n[output]\ncolours = true"
    edit(path, "[output]", table)
    result = run_project(load_project(path))
    folder = path.parent / "out" / "project_atlas"
    vertices, uvs, faces, pages = read_obj(folder / "project_atlas.obj")
    assert len(faces) == len(result.textured.faces) and len(set(pages)) > 1
    assert uvs.min() >= 0 and uvs.max() <= 1
    np.testing.assert_allclose(
        vertices.mean(axis=0), result.textured.vertices.mean(axis=0) + offset, atol=1e-4
    )
    library = (folder / "project_atlas.mtl").read_text()
    rng = np.random.default_rng(1)
    compared = 0
    number_of = {tuple(sorted(face)): n for n, face in enumerate(result.textured.faces.tolist())}
    images = {p: cv2.imread(str(folder / f"{p}.png"))[..., ::-1] for p in set(pages)}
    for face, page in [(faces[i], pages[i]) for i in rng.choice(len(faces), 60, replace=False)]:
        assert f"map_Kd {page}.png" in library
        number = number_of[tuple(sorted(face[:, 0].tolist()))]
        view = int(result.textured.selection.view[number])
        if view < 0:
            continue
        image = images[page]
        u, v = uvs[face[:, 1]].mean(axis=0)
        baked = image[int((1 - v) * image.shape[0]), int(u * image.shape[1])]
        photo = cv2.imread(str(result.textured.views[view].image))[..., ::-1]
        x, y = np.rint(result.textured.selection.uv[number].mean(axis=0)).astype(int)
        assert np.abs(baked.astype(int) - photo[y, x]).max() < 25
        compared += 1
    assert compared > 30
    ply = PlyData.read(path.parent / "out" / "project_colours.ply")
    assert len(ply["vertex"]) == len(result.textured.vertices)
    assert ply["vertex"]["x"].mean() == pytest.approx(vertices[:, 0].mean(), abs=1e-3)
    assert np.ptp(ply["vertex"]["red"]) > 50


def test_untouched_colours_are_those_of_the_photo(corner):
    path, _ = corner()
    photo = path.parent / "photos" / "B.png"
    image = cv2.imread(str(photo))
    cv2.imwrite(str(photo), (0.7 * image).astype(np.uint8))
    edit(path, "[output]", "[atlas]\nuntouched = true\n[output]\ncolours = true")
    result = run_project(load_project(path))
    assert np.abs(result.textured.selection.gain - 1).max() > 0.1
    plain = PlyData.read(path.parent / "out" / "project_colours.ply")["vertex"]["red"].astype(int)
    edit(path, "untouched = true", "level = true")
    run_project(load_project(path))
    equal = PlyData.read(path.parent / "out" / "project_colours.ply")["vertex"]["red"].astype(int)
    assert np.abs(plain - equal).max() > 10


def test_a_repeated_run_makes_nothing_again_but_what_is_gone(corner):
    path, _ = corner()
    edit(path, "[output]", "[atlas]\ntexel_size = 0.02\n[output]\ncolours = true")
    run_project(load_project(path))
    out = path.parent / "out"
    files = [
        out / "project.obj",
        out / "project_colours.ply",
        out / "project_atlas" / "project_atlas.1001.png",
    ]
    before = [file.stat().st_mtime_ns for file in files]
    run_project(load_project(path))
    assert [file.stat().st_mtime_ns for file in files] == before
    (out / "project_colours.ply").unlink()
    edit(path, "texel_size = 0.02", "texel_size = 0.03")
    run_project(load_project(path))
    after = [file.stat().st_mtime_ns for file in files]
    assert after[0] == before[0] and after[1] > before[1] and after[2] > before[2]


def test_files_count_as_unchanged_only_with_the_same_key_and_state(tmp_path):
    store, file = Store(tmp_path / "cache"), tmp_path / "a.glb"
    assert not are_unchanged(store, [file], "1")
    keep_unchanged(store, [file], "1")
    assert not are_unchanged(store, [file], "1"), "it is not there"
    file.write_bytes(b"x")
    keep_unchanged(store, [file], "1")
    assert are_unchanged(store, [file], "1")
    assert not are_unchanged(store, [file], "2")
    assert not are_unchanged(store, [file, tmp_path / "b"], "1")
    file.write_bytes(b"xy")
    assert not are_unchanged(store, [file], "1")
