import numpy as np
import pytest
from fresco.core.errors import RegionError
from fresco.core.regions import SurfaceRegion

SQUARE = np.array([(0.0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (9, 9, 9)])
FACES = [(0, 1, 2), (0, 2, 3)]


def test_loops_and_centre_ignore_vertices_that_no_face_uses():
    region = SurfaceRegion(SQUARE + 5_000_000.0, FACES, "panel")
    assert [len(loop) for loop in region.loops] == [4]
    np.testing.assert_allclose(region.centre, np.array([1, 0.5, 0]) + 5_000_000.0)


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (SQUARE, np.zeros((0, 3), int), "has no faces"),
        (SQUARE, [(0, 1, 7)], "do not exist"),
        (SQUARE, [(0, 1, 2, 3)], "triangles"),
    ],
)
def test_bad_meshes(vertices, faces, message):
    with pytest.raises(RegionError, match=message):
        SurfaceRegion(vertices, faces, "panel")


def test_closed_surface():
    tetrahedron = [(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)]
    with pytest.raises(RegionError, match="'vault' is a closed surface"):
        _ = SurfaceRegion(SQUARE, tetrahedron, "vault").loops


def test_coordinates_that_are_no_numbers():
    broken = SQUARE.copy()
    broken[2, 1] = np.nan
    with pytest.raises(RegionError, match="not numbers"):
        _ = SurfaceRegion(broken, FACES).loops
