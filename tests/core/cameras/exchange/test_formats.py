import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.cameras.exchange import WRITE_FORMATS, read_reconstruction, write_reconstruction
from fresco.core.errors import CameraError

CAMERA = PerspectiveCamera(800, 600, [[700, 0, 399.5], [0, 700, 299.5], [0, 0, 1]], (-0.1, 0.02))
PATHS = {
    "colmap": "project/sparse/0",
    "colmap-binary": "model",
    "metashape": "cameras.xml",
    "realityscan-xmp": "photos",
    "realityscan-csv": "cameras.csv",
    "bundler": "bundle.out",
}


@pytest.mark.parametrize("file_format", WRITE_FORMATS)
def test_every_format_comes_back(file_format, posed, same_projection, tmp_path):
    path = tmp_path / PATHS[file_format]
    path.parent.mkdir(exist_ok=True, parents=True)
    if file_format == "realityscan-xmp":
        path.mkdir()
    model = posed([CAMERA] * 2)
    write_reconstruction(path, model, file_format)
    copy = read_reconstruction(path, lambda name: (800, 600))
    same_projection(model, copy, points=file_format in ("colmap", "colmap-binary", "bundler"))


def test_parent_of_a_colmap_model_will_do(posed, same_projection, tmp_path):
    model = posed([CAMERA] * 2)
    write_reconstruction(tmp_path / "sparse" / "0", model, "colmap")
    same_projection(model, read_reconstruction(tmp_path))


def test_sizes_are_asked_for(posed, tmp_path):
    write_reconstruction(tmp_path / "cameras.csv", posed([CAMERA]), "realityscan-csv")
    with pytest.raises(CameraError, match="does not tell the size of IMG_0000"):
        read_reconstruction(tmp_path / "cameras.csv")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("", "neither a COLMAP model nor XMP"),
        ("cameras.fbx", "cameras are read from"),
        ("bundle.out", "put list.txt beside it"),
        ("none.xml", "cannot be read"),
    ],
)
def test_what_cannot_be_read(name, message, tmp_path):
    with pytest.raises(CameraError, match=message):
        read_reconstruction(tmp_path / name)


def test_unknown_format_is_explained(posed, tmp_path):
    with pytest.raises(CameraError, match="'fbx' is not one of colmap"):
        write_reconstruction(tmp_path, posed([CAMERA]), "fbx")
