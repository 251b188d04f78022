import numpy as np
import pytest
from fresco.core.errors import OutputError
from fresco.core.photos.marks import read_mask
from fresco.core.regions.files import write_mask


def ring_mask():
    mask = np.zeros((60, 80), dtype=bool)
    mask[10:50, 10:60] = True
    mask[20:30, 20:30] = False
    mask[5:8, 70:78] = True
    return mask


def test_masks_survive_as_png(tmp_path):
    write_mask(tmp_path / "new" / "wall.png", ring_mask())
    assert np.array_equal(read_mask(tmp_path / "new" / "wall.png"), ring_mask())


def test_a_folder_that_cannot_be_made_is_an_output_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        write_mask(tmp_path / "file" / "m.png", ring_mask())
