"""An interrupted run goes on at the photo where it stopped; memory stays within what is allowed."""

from __future__ import annotations

from dataclasses import fields, replace

import cv2
import numpy as np
import pytest
from fresco.core.errors import OutputError, PhotoError, TextureError
from fresco.core.jobs import drain
from fresco.core.settings import TextureSettings
from fresco.core.texture import Selection, select_views, select_views_job
from fresco.core.texture.views import survey
from fresco.core.texture.views.kept import KeptPhotos
from fresco.core.texture.views.memory import GIB, plan_memory
from painted_scenes import grid_mesh, wall_views

WALL = grid_mesh(24, 18)
PLACES = [(-1.2, 0.3, -4.0), (1.2, -0.2, -4.2), (0.0, 0.1, -2.6), (0.4, 0.2, -3.0), (-0.4, 0.2, -3.4)]
ONE_BY_ONE = TextureSettings(threads=1)


@pytest.fixture(scope="module")
def views():
    # The last one looks away: that it sees nothing is kept too.
    away = wall_views(WALL, [(0.0, 0.0, -3.0)], target=(0.0, 0.0, -9.0))
    return [*wall_views(WALL, PLACES), *away]


@pytest.fixture
def looked_at(monkeypatch, views):
    """Return a list of the photos that are looked at, in their order."""
    numbers = []
    original = survey.survey_photo

    def counted(surface, view, settings):
        numbers.append(
            next(
                k
                for k, other in enumerate(views)
                if other.camera is view.camera and np.array_equal(other.translation, view.translation)
            )
        )
        return original(surface, view, settings)

    monkeypatch.setattr(survey, "survey_photo", counted)
    return numbers


def keys(count):
    return [f"key{number}" for number in range(count)]


def interrupted(views, kept, photos):
    """Close a run when it is about to look at photo `photos`."""
    job = select_views_job(*WALL, views, ONE_BY_ONE, kept=kept)
    looking = 0
    for progress in job:
        looking += progress.message.startswith("Looking at")
        if looking > photos:
            break
    job.close()


def same(a, b):
    return all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=f.name != "photo_name")
        for f in fields(Selection)
    )


def test_only_the_photos_that_are_missing_are_looked_at(tmp_path, views, looked_at):
    kept = KeptPhotos(tmp_path / "photos", keys(len(views)))
    interrupted(views, kept, photos=3)
    assert looked_at == [0, 1, 2]
    resumed = drain(select_views_job(*WALL, views, ONE_BY_ONE, kept=kept))
    assert looked_at == [0, 1, 2, 3, 4, 5]
    assert same(resumed, select_views(*WALL, views, ONE_BY_ONE))
    kept.clear()
    assert not (tmp_path / "photos").exists()


def test_a_changed_or_damaged_photo_is_looked_at_again(tmp_path, views, looked_at):
    kept = KeptPhotos(tmp_path, keys(len(views)))
    drain(select_views_job(*WALL, views, ONE_BY_ONE, kept=kept))
    damaged = tmp_path / "key1.photo.npz"
    damaged.write_bytes(damaged.read_bytes()[:200])
    looked_at.clear()
    changed = KeptPhotos(tmp_path, [*keys(len(views))[:4], "other", "key5"])
    drain(select_views_job(*WALL, views, ONE_BY_ONE, kept=changed))
    assert looked_at == [1, 4]


def test_a_full_disk_is_told(tmp_path, views):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="cannot be written"):
        drain(select_views_job(*WALL, views, ONE_BY_ONE, kept=KeptPhotos(tmp_path / "file", keys(6))))


def test_clearing_leaves_other_files_alone(tmp_path):
    kept = KeptPhotos(tmp_path, keys(1))
    kept.save(0, {"a": np.zeros(3)})
    (tmp_path / "notes.txt").write_text("mine")
    kept.clear()
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_a_photo_removed_half_way_is_named_and_what_was_done_stays(tmp_path, views, looked_at):
    files = []
    for number, view in enumerate(views):
        path = tmp_path / f"p{number}.png"
        cv2.imwrite(str(path), view.image[..., ::-1])
        files.append(replace(view, image=path))
    kept = KeptPhotos(tmp_path / "kept", keys(len(views)))
    job = select_views_job(*WALL, files, ONE_BY_ONE, kept=kept)
    with pytest.raises(PhotoError, match=r"p3\.png: no such photo"):
        for progress in job:
            if progress.message == "Looking at p2":
                (tmp_path / "p3.png").unlink()
    cv2.imwrite(str(tmp_path / "p3.png"), views[3].image[..., ::-1])
    looked_at.clear()
    drain(select_views_job(*WALL, files, ONE_BY_ONE, kept=kept))
    assert looked_at == [3, 4, 5]


def test_memory_is_planned_within_the_limit(views):
    unlimited = plan_memory(5_000_000, views, TextureSettings(threads=8))
    assert (unlimited.photos_together, unlimited.candidates) == (8, 6)
    for limit in (3.2, 2.8):
        plan = plan_memory(5_000_000, views, TextureSettings(threads=8, memory_limit=limit))
        assert plan.peak <= limit * GIB
        assert plan.peak < unlimited.peak
        assert plan.candidates >= 3
    few = TextureSettings(memory_limit=0.5)
    assert plan_memory(500_000, views, few).candidates >= 3
    with pytest.raises(TextureError, match=r"5000000 faces takes about .* GiB, but 0.5 GiB .* memory_limit"):
        plan_memory(5_000_000, views, few)


def test_fewer_remembered_photos_still_cover_the_wall(views):
    # 864 faces take next to nothing: the limit is just above the program itself.
    tight = select_views(*WALL, views, TextureSettings(memory_limit=0.21))
    assert np.mean(tight.view >= 0) == np.mean(select_views(*WALL, views).view >= 0)
