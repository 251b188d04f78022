import laspy
import numpy as np
import pye57
import pytest
from fresco.core.errors import ScanError
from fresco.core.scans import read_scan

RNG = np.random.default_rng(3)
POINTS = RNG.uniform(-4, 4, (500, 3))
RGB = RNG.integers(0, 256, (500, 3)).astype(np.uint8)
INTENSITY = RNG.uniform(0, 1, 500).astype(np.float32)
GRID = np.array([5_012_345.0, 423_456.0, 112.0])


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "Pontfelhők – 1. állás"
    folder.mkdir()
    return folder


def write_las(path, points=POINTS + GRID):
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.offsets, header.scales = GRID, np.full(3, 1e-4)
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.red, las.green, las.blue = RGB.astype(np.uint16).T * 257
    las.intensity = (INTENSITY * 65535).astype(np.uint16)
    las.write(str(path))
    return path


def write_e57(path):
    file = pye57.E57(str(path), mode="w")
    turn = np.array([np.cos(0.4), 0, 0, np.sin(0.4)])  # 0.8 rad about z
    for number, half in enumerate((slice(0, 250), slice(250, 500))):
        data = {f"cartesian{axis}": POINTS[half, k].copy() for k, axis in enumerate("XYZ")}
        data |= {f"color{c}": RGB[half, k].copy() for k, c in enumerate(("Red", "Green", "Blue"))}
        data["intensity"] = INTENSITY[half].copy()
        file.write_scan_raw(data, rotation=turn, translation=GRID + number)
    file.close()
    return path


def write_ptx(path, colors=True):
    """Two scans of 10 x 25 directions, the second without return in its first 7 directions."""
    text = ""
    for number, half in enumerate((slice(0, 250), slice(250, 500))):
        text += "10\n25\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
        text += f"0 1 0 0\n-1 0 0 0\n0 0 1 0\n{GRID[0]} {GRID[1]} {GRID[2] + number} 1\n"
        for i, (xyz, value, rgb) in enumerate(zip(POINTS[half], INTENSITY[half], RGB[half], strict=True)):
            missing = number == 1 and i < 7
            words = ["0 0 0 0.5"] if missing else [" ".join(f"{c:.6f}" for c in (*xyz, value))]
            text += " ".join(words + (list(map(str, (0, 0, 0) if missing else rgb)) if colors else [])) + "\n"
    path.write_text(text)
    return path


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_las_and_laz(folder, suffix):
    scan = read_scan(write_las(folder / f"templom{suffix}"))
    assert scan.is_cloud
    np.testing.assert_array_equal(scan.offset, [5_012_300, 423_500, 0])
    np.testing.assert_allclose(scan.world(scan.vertices), POINTS + GRID, atol=6e-5)
    np.testing.assert_array_equal(scan.vertex_colors, RGB)
    np.testing.assert_allclose(scan.intensity, INTENSITY * 65535, atol=1)


def test_e57_scans_are_placed_by_their_poses(folder):
    scan = read_scan(write_e57(folder / "állások.e57"))
    c, s = np.cos(0.8), np.sin(0.8)
    turned = POINTS @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + GRID
    turned[250:] += 1
    np.testing.assert_allclose(scan.world(scan.vertices), turned, atol=1e-6)
    np.testing.assert_array_equal(scan.vertex_colors, RGB)
    np.testing.assert_allclose(scan.intensity, INTENSITY, atol=1e-6)


@pytest.mark.parametrize("colors", [True, False])
def test_ptx_scans_are_placed_and_missing_returns_left_out(folder, colors):
    scan = read_scan(write_ptx(folder / "állások.ptx", colors))
    assert len(scan.vertices) == 493
    keep = np.r_[0:250, 257:500]
    turned = np.stack([-POINTS[:, 1], POINTS[:, 0], POINTS[:, 2]], axis=1) + GRID
    turned[250:, 2] += 1
    np.testing.assert_allclose(scan.world(scan.vertices), turned[keep], atol=2e-6)
    np.testing.assert_allclose(scan.intensity, INTENSITY[keep], atol=1e-6)
    if colors:
        np.testing.assert_array_equal(scan.vertex_colors, RGB[keep])
    else:
        assert scan.vertex_colors is None


@pytest.mark.parametrize("write", [write_las, write_e57, write_ptx])
def test_cut_off_clouds(folder, write):
    suffix = write.__name__[-3:]
    path = write(folder / f"cut.{suffix}")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * 0.6)])
    with pytest.raises(ScanError, match=r"cut\.\w+: .*cut off"):
        read_scan(path)
    path.write_bytes(b"")
    with pytest.raises(ScanError, match=r"cut\.\w+: "):
        read_scan(path)
