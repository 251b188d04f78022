"""Sets of photos in different light on the same scan, and photos that are preferred or left out."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from fresco.core.errors import ProjectError
from fresco.core.photos import read_image
from fresco.core.project.file.load import load_project
from fresco.core.project.run import run_project
from fresco.core.project.stages.textures import settings_among
from fresco.core.settings import TextureSettings
from fresco.core.texture.views import survey


@pytest.mark.parametrize(("chosen", "anchor"), [([0, 1, 2], 2), ([2, 3], 0), ([0, 3], None), ([], None)])
def test_the_anchor_of_the_gains_is_found_among_the_photos_of_a_layer(chosen, anchor):
    assert settings_among(TextureSettings(gain_anchor=2), chosen).gain_anchor == anchor
    assert settings_among(TextureSettings(), chosen) == TextureSettings()


def with_infrared(path, truth):
    """Give photo C of the corner a twin in one band, half as bright, in a layer of its own."""
    photos = path.parent / "photos"
    grey = cv2.cvtColor(read_image(photos / "C.png"), cv2.COLOR_RGB2GRAY) // 2
    cv2.imwrite(str(photos / "C infrared.png"), grey)
    rotation, translation = truth["C"]
    entry = (
        '[[photo]]\npath = "photos/C infrared.png"\nlayer = "infrared"\n'
        f"pose = {{ rotation = {rotation.tolist()}, translation = {translation.tolist()} }}\n"
    )
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("[output]", entry + "[output]"), encoding="utf-8")


def test_a_layer_has_its_own_photos_gains_and_files(corner, monkeypatch):
    path, truth = corner()
    alone = run_project(load_project(path))
    with_infrared(path, truth)
    result = run_project(load_project(path))
    assert list(result.layers) == ["", "infrared"]
    visible, infrared = result.layers[""], result.layers["infrared"]
    assert result.textured is visible
    assert [view.name for view in infrared.views] == ["C infrared"]
    # The dark photo neither joins the gains of the others nor gets theirs.
    np.testing.assert_allclose(visible.selection.gain, alone.textured.selection.gain)
    np.testing.assert_allclose(infrared.selection.gain, 1)
    assert 0.2 < infrared.coverage < visible.coverage
    np.testing.assert_array_equal(infrared.faces, visible.faces)  # one mesh, so that layers can be compared
    folder = path.parent / "out"
    assert {"project.obj", "project_infrared.obj", "project_infrared_faces.npz"} <= {
        file.name for file in folder.iterdir()
    }
    assert "C infrared.png" in (folder / "project_infrared.mtl").read_text(encoding="utf-8")
    assert "infrared" not in (folder / "project.mtl").read_text(encoding="utf-8")
    record = json.loads((folder / "project_provenance.json").read_text(encoding="utf-8"))
    assert record["layers"]["infrared"]["coverage"] == pytest.approx(infrared.coverage)
    photo = next(photo for photo in record["photos"] if photo["name"] == "C infrared")
    assert photo["layer"] == "infrared" and photo["faces"] > 0

    calls = []
    original = survey.survey_photo
    monkeypatch.setattr(survey, "survey_photo", lambda *a: calls.append(a[1].name) or original(*a))
    again = run_project(load_project(path))
    assert calls == []  # both layers are taken over
    np.testing.assert_array_equal(again.layers["infrared"].selection.view, infrared.selection.view)


def test_a_preferred_photo_gives_more_of_the_texture(corner):
    path, _ = corner()
    plain = run_project(load_project(path))
    text = path.read_text(encoding="utf-8")
    entry = '[[photo]]\npath = "photos/B.png"\npriority = 3\n[output]'
    path.write_text(text.replace("[output]", entry), encoding="utf-8")
    preferred = run_project(load_project(path))

    def share(result):
        return np.mean(result.textured.selection.view == 1)

    assert share(preferred) > 1.5 * share(plain)


@pytest.mark.parametrize(
    "line, words",
    [
        ('layer = "a/b"', "cannot be part of a file name"),
        ("layer = 3", "layer"),
        ('priority = "high"', "priority"),
        ("priority = 99", "priority"),
    ],
)
def test_wrong_layers_and_priorities_are_refused(corner, line, words):
    path, _ = corner()
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("[[photo]]\n", f"[[photo]]\n{line}\n", 1), encoding="utf-8")
    with pytest.raises(ProjectError, match=words):
        load_project(path)
