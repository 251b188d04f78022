"""Simplified models and colour charts from the project file: written, told, refused, taken over."""

from __future__ import annotations

import hashlib
import json

import cv2
import numpy as np
import pytest
from fresco.core.errors import ProjectError
from fresco.core.photos import read_image
from fresco.core.project.file.load import load_project
from fresco.core.project.run import run_project
from fresco.core.project.stages import models
from fresco.core.report import project_report
from fresco.core.texture.colour.colour_chart import REFERENCE
from fresco.core.texture.colour.difference import lab_to_linear
from fresco.core.texture.views.images import to_bytes, to_srgb

CAST = np.array([[0.80, 0.10, 0.02], [0.06, 0.62, 0.05], [0.01, 0.12, 0.42]])


def add(path, text):
    content = path.read_text(encoding="utf-8")
    path.write_text(content.replace("[output]", text + "\n[output]"), encoding="utf-8")


def write_chart(path, cast=CAST):
    """Write a photo of the chart straight on, under coloured light."""
    photo = np.full((400, 560, 3), 0.02)
    for number, colour in enumerate(np.clip(lab_to_linear(REFERENCE), 0, 1)):
        x, y = 70 + 70 * (number % 6), 60 + 70 * (number // 6)
        photo[y : y + 60, x : x + 60] = colour @ cast.T
    noise = np.random.default_rng(0).normal(scale=1.0, size=photo.shape)
    pixels = np.clip(np.rint(to_bytes(to_srgb(photo)) + noise), 0, 255).astype(np.uint8)
    cv2.imwrite(str(path), pixels[..., ::-1])


def fingerprints(folder):
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(folder.iterdir())}


def test_a_simplified_model_is_written_and_its_deviation_told(corner, monkeypatch):
    path, _ = corner()
    add(path, "[simplify]\nfaces = 300\n[atlas]\npage_size = 1024")
    originals = fingerprints(path.parent / "photos")
    result = run_project(load_project(path))
    model = result.simplified[""]
    assert 200 < len(model.faces) <= 300 < len(result.scan.faces)
    assert model.deviation.maximum < 1e-6, "the corner's walls are flat: nothing is lost"
    lines = model.path.read_text(encoding="utf-8").splitlines()
    assert sum(line.startswith("f ") for line in lines) == len(model.faces)
    assert all(page.is_file() for page in model.pages) and "RMS 0.00 mm" in model.told
    record = json.loads((path.parent / "out" / "project_provenance.json").read_text(encoding="utf-8"))
    assert record["simplified"][""] == model.told
    assert any(model.told in sentence for sentence in project_report(result).made)
    assert fingerprints(path.parent / "photos") == originals

    monkeypatch.setattr(models, "simplified_job", lambda *_: pytest.fail("made anew"))
    again = run_project(load_project(path)).simplified[""]
    np.testing.assert_array_equal(again.uv, model.uv)
    assert again.pages == model.pages and again.deviation == model.deviation


def test_a_tolerance_leaves_as_few_faces_as_hold_it(corner):
    path, _ = corner()
    add(path, "[simplify]\ntolerance_mm = 2")
    model = run_project(load_project(path)).simplified[""]
    assert model.deviation.percentile_95 <= 0.002
    assert len(model.faces) < 400


def test_a_colour_chart_makes_the_baked_colours_true(corner):
    path, _ = corner()
    add(path, "[atlas]\npage_size = 1024")
    plain = run_project(load_project(path))
    pages = sorted((plain.project.output.folder / "project_atlas").glob("*.png"))
    before = np.concatenate([read_image(page).reshape(-1, 3) for page in pages]).astype(float)
    write_chart(path.parent / "chart.png")
    originals = fingerprints(path.parent / "photos")
    add(path, '[colour_chart]\nphoto = "chart.png"')
    result = run_project(load_project(path))
    chart = result.charts[""]
    assert chart.correction.before > 8 and chart.correction.after < 1.5
    assert chart.told in "".join(project_report(result).made)
    after = np.concatenate([read_image(page).reshape(-1, 3) for page in pages]).astype(float)
    # the light was reddish: its correction lifts blue most, in every texel that a photo gave
    changed = np.abs(after - before).max(axis=1) > 3
    assert changed.mean() > 0.2
    lift = (after - before)[changed].mean(axis=0)
    assert lift[2] > lift[1] > 0
    assert fingerprints(path.parent / "photos") == originals


def test_corners_of_the_chart_may_be_told(corner):
    path, _ = corner()
    write_chart(path.parent / "chart.png")
    corners = "[[70, 60], [480, 60], [480, 330], [70, 330]]"
    add(path, f'[atlas]\n[colour_chart]\nphoto = "chart.png"\ncorners = {corners}')
    assert load_project(path).charts[0].corners == ((70, 60), (480, 60), (480, 330), (70, 330))
    assert run_project(load_project(path)).charts[""].correction.after < 1.5


@pytest.mark.parametrize(
    "text, words",
    [
        ("[simplify]\n", "give either faces"),
        ("[simplify]\nfaces = 100\ntolerance_mm = 1\n", "give either faces"),
        ("[simplify]\nfaces = 2\n", "faces"),
        ('[colour_chart]\nphoto = "chart.png"\n', "changes no original photo"),
        ('[atlas]\nuntouched = true\n[colour_chart]\nphoto = "chart.png"\n', "contradicts untouched"),
        ('[atlas]\n[colour_chart]\nphoto = "chart.png"\nlayer = "x"\n', "is of no photo"),
        ('[atlas]\n[colour_chart]\nphoto = "chart.png"\ncorners = [[1, 2]]\n', "4 rows of 2"),
        ("[atlas]\n" + 2 * '[[colour_chart]]\nphoto = "chart.png"\n', "two charts"),
    ],
)  # fmt: skip
def test_wrong_wishes_are_refused(corner, text, words):
    path, _ = corner()
    write_chart(path.parent / "chart.png")
    add(path, text)
    with pytest.raises(ProjectError, match=words):
        load_project(path)


def test_a_chart_that_is_not_found_is_refused_before_anything_is_written(corner):
    path, _ = corner()
    add(path, '[atlas]\n[colour_chart]\nphoto = "photos/A.png"')
    with pytest.raises(ProjectError, match=r"A\.png: No colour chart was found"):
        run_project(load_project(path))
    assert not (path.parent / "out").exists()
