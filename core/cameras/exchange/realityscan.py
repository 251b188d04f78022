"""RealityScan's (RealityCapture's) cameras: one XMP file for each photo, or one CSV table.

With scale = max(width, height), in pixels from the corner of the photo,

    K = [[f, s scale, cx], [0, a f, cy]],  f = f35 scale / 36,  cx = width / 2 + pu scale, and cy likewise

and Brown's distortion k1..k4, t1, t2, whose t1, t2 are OpenCV's p2, p1. XMP poses are a rotation world ->
camera by rows (OpenCV's axes) and the camera's position; the table has heading, pitch and roll in degrees:
camera -> world is Rz(-heading) Rx(pitch) Ry(roll) for axes x right, y up, z backwards.
Source: RealityScan help on XMP files and camera mathematics; its export templates for the order of t1, t2.
"""

from __future__ import annotations

import csv
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from ...arrays import FloatArray
from ...errors import CameraError
from ..base import Camera
from ..distortion import Distortion, trimmed
from ..files.text import exact, number, numbers, read_text, read_xml, write_text
from ..perspective import PerspectiveCamera
from .reconstruction import PosedCamera, Reconstruction, SizeOf, checked_rotation, pose_from_centre

_XCR = "http://www.capturingreality.com/ns/xcr/1.1#"
_RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
_X = "adobe:ns:meta/"
_BROWN = ("brown3", "brown4", "brown3t2", "brown4t2")
_Y_UP = np.diag([1.0, -1.0, -1.0])
_NEEDED = ["name", "x", "y", "alt", "heading", "pitch", "roll", "f"]
_COLUMNS = [*_NEEDED, "px", "py", "k1", "k2", "k3", "k4", "t1", "t2"]


def read_realityscan_xmp(paths: Iterable[Path | str], size_of: SizeOf) -> Reconstruction:
    """Cameras and poses from RealityScan's XMP files; a photo's name is its file's without extension.

    Parameters
    ----------
    paths
        The .xmp files.
    size_of
        (width, height) of a photo by that name.

    Raises
    ------
    CameraError
        Files that are not RealityScan's, relative coordinates, a distortion model that is not known.
    """
    posed, unposed = [], []
    for path in sorted(Path(path) for path in paths):
        fields = _xmp_fields(path)
        if "Rotation" not in fields or "Position" not in fields:
            unposed.append(path.stem)
            continue
        if fields.get("Coordinates", "absolute") != "absolute":
            raise CameraError(f"{path} has {fields['Coordinates']} coordinates: export absolute ones.")
        rotation = checked_rotation(numbers(fields["Rotation"], f"{path}: Rotation", 9), str(path))
        position = numbers(fields["Position"], f"{path}: Position", 3)
        camera = _xmp_camera(fields, size_of(path.stem), str(path))
        posed.append(PosedCamera(path.stem, camera, *pose_from_centre(rotation, position)))
    return Reconstruction(tuple(posed), unposed=tuple(unposed))


def _xmp_fields(path: Path) -> dict[str, str]:
    """What stands in RealityScan's namespace, be it attribute or element."""
    fields = {}
    for element in read_xml(path).iter():
        names = [(element.tag, element.text or ""), *element.attrib.items()]
        fields.update({name[len(_XCR) + 2 :]: text for name, text in names if name.startswith(f"{{{_XCR}}}")})
    if not fields:
        raise CameraError(f"{path} has nothing of RealityScan in it.")
    return fields


def _xmp_camera(fields: Mapping[str, str], size: tuple[int, int], what: str) -> Camera:
    def value(key: str, default: str | None = None) -> float:
        text = fields.get(key, default)
        if text is None:
            raise CameraError(f"{what}: {key} is missing.")
        return number(text, f"{what}: {key}")

    lens = numbers(fields.get("DistortionCoeficients", ""), f"{what}: DistortionCoeficients")
    lens = np.pad(lens[:6], (0, max(0, 6 - lens.size)))
    model = fields.get("DistortionModel", "perspective")
    if model not in ("perspective", *_BROWN) and lens.any():
        raise CameraError(f"{what}: the distortion model '{model}' is not supported: export a Brown model.")
    centre = (value("PrincipalPointU", "0"), value("PrincipalPointV", "0"))
    shape = (value("Skew", "0"), value("AspectRatio", "1"))
    if model == "perspective":
        lens = np.zeros(6)
    return _camera(value("FocalLength35mm"), centre, shape, lens, size, what)


def _camera(
    focal35: float,
    centre: tuple[float, float],
    shape: tuple[float, float],
    lens: FloatArray,
    size: tuple[int, int],
    what: str,
) -> Camera:
    """Camera from RealityScan's numbers; `shape` is skew and aspect ratio, `lens` k1..k4, t1, t2."""
    width, height = size
    scale = max(width, height)
    f = focal35 * scale / 36
    cx, cy = width / 2 + centre[0] * scale - 0.5, height / 2 + centre[1] * scale - 0.5
    K = np.array([[f, shape[0] * scale, cx], [0, f * shape[1], cy], [0, 0, 1]])
    k1, k2, k3, k4, t1, t2 = lens.tolist()
    try:
        return PerspectiveCamera(width, height, K, Distortion(trimmed(k1, k2, k3, k4), (), (t2, t1)))
    except CameraError as error:
        raise CameraError(f"{what}: {error}") from error


def _numbers_of(camera: Camera, name: str) -> tuple[float, float, float, float, float, list[float]]:
    """f35, pu, pv, skew, aspect ratio, [k1..k4, t1, t2] of a camera; CameraError if it is no Brown camera."""
    if not isinstance(camera, PerspectiveCamera):
        raise CameraError(f"{name}: RealityScan has no model for a {type(camera).__name__}.")
    lens = camera.distortion
    if lens.denominator or any(lens.prism) or len(lens.radial) > 4:
        raise CameraError(f"{name}: RealityScan has no rational and no thin-prism terms of distortion.")
    scale = max(camera.width, camera.height)
    (fx, skew, cx), (_, fy, cy) = camera.K[0], camera.K[1]
    p1, p2 = lens.tangential
    radial = (*lens.radial, *(0.0,) * 4)[:4]
    pu, pv = (cx + 0.5 - camera.width / 2) / scale, (cy + 0.5 - camera.height / 2) / scale
    return fx * 36 / scale, pu, pv, skew / scale, fy / fx, [*radial, p2, p1]


def write_realityscan_xmp(folder: Path | str, reconstruction: Reconstruction) -> None:
    """Write an XMP file for every photo into a folder, as locked poses; `photo.jpg` gets `photo.xmp`.

    Raises CameraError for cameras that RealityScan has no model for or photos with the same name in two
    folders, OutputError if a file cannot be written.
    """
    stems = [Path(posed.name).stem for posed in reconstruction.cameras]
    if len(set(stems)) != len(stems):
        raise CameraError("Two photos differ only by folder or extension: their XMP files would be the same.")
    texts = [_xmp_text(posed) for posed in reconstruction.cameras]
    for stem, text in zip(stems, texts, strict=True):
        write_text(Path(folder) / f"{stem}.xmp", text)


def _xmp_text(posed: PosedCamera) -> str:
    f35, pu, pv, skew, aspect, lens = _numbers_of(posed.camera, posed.name)
    ElementTree.register_namespace("x", _X)
    ElementTree.register_namespace("rdf", _RDF)
    ElementTree.register_namespace("xcr", _XCR)
    root = ElementTree.Element(f"{{{_X}}}xmpmeta")
    description = ElementTree.SubElement(
        ElementTree.SubElement(root, f"{{{_RDF}}}RDF"), f"{{{_RDF}}}Description"
    )
    attributes = {
        "Version": "3",
        "PosePrior": "locked",
        "Coordinates": "absolute",
        "DistortionModel": f"brown{4 if lens[3] else 3}{'t2' if any(lens[4:]) else ''}",
        "FocalLength35mm": exact(f35),
        "Skew": exact(skew),
        "AspectRatio": exact(aspect),
        "PrincipalPointU": exact(pu),
        "PrincipalPointV": exact(pv),
        "CalibrationPrior": "exact",
        "CalibrationGroup": "-1",
        "DistortionGroup": "-1",
        "InTexturing": "1",
        "InMeshing": "1",
    }
    for key, value in attributes.items():
        description.set(f"{{{_XCR}}}{key}", value)
    elements = {
        "Rotation": posed.rotation.ravel(),
        "Position": posed.centre,
        "DistortionCoeficients": np.array(lens),
    }
    for key, values in elements.items():
        text = " ".join(exact(v) for v in values)
        ElementTree.SubElement(description, f"{{{_XCR}}}{key}").text = text
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def read_realityscan_csv(path: Path | str, size_of: SizeOf) -> Reconstruction:
    """Cameras and poses from RealityScan's table "Internal/External camera parameters".

    `size_of` gives (width, height) of a photo by its name in the table. Columns for principal point and
    distortion may be missing. Raises CameraError for other tables and for rows that make no sense.
    """
    rows = [row for row in csv.reader(read_text(path).splitlines()) if row]
    rows = [row for row in rows if not row[0].startswith("#cameras")]
    header = [word.strip().lstrip("#").lower() for word in rows[0]] if rows else []
    missing = [column for column in _NEEDED if column not in header]
    if missing:
        raise CameraError(
            f"{path}: the column '{missing[0]}' is missing: export internal and external parameters."
        )
    posed = []
    for count, row in enumerate(rows[1:], start=1):
        name = row[header.index("name")].strip() if len(row) == len(header) else ""
        what = f"{path}, row {count}"
        if not name:
            raise CameraError(f"{what}: expected {len(header)} columns, found {len(row)}.")
        table = dict(zip(header, row, strict=True))
        values = {key: number(table.get(key, "0"), f"{what}: {key}") for key in _COLUMNS[1:]}
        lens = np.array([values[key] for key in _COLUMNS[10:]])
        centre = (values["px"], values["py"])
        camera = _camera(values["f"], centre, (0.0, 1.0), lens, size_of(name), what)
        rotation = _rotation_from_angles(values["heading"], values["pitch"], values["roll"])
        position = np.array([values["x"], values["y"], values["alt"]])
        posed.append(PosedCamera(name, camera, *pose_from_centre(rotation, position)))
    return Reconstruction(tuple(posed))


def _rotation_from_angles(heading: float, pitch: float, roll: float) -> FloatArray:
    """World -> camera rotation with OpenCV's axes, angles in degrees."""
    camera_to_world = Rotation.from_euler("ZXY", [-heading, pitch, roll], degrees=True).as_matrix()
    rotation: FloatArray = _Y_UP @ camera_to_world.T
    return rotation


def _angles_from_rotation(rotation: FloatArray) -> tuple[float, float, float]:
    """Heading, pitch and roll in degrees.

    A level camera has a pitch of 90 degrees, where only the sum of heading and roll counts: SciPy warns and
    puts all of it into the heading, which is the same rotation.
    """
    turn = Rotation.from_matrix((_Y_UP @ rotation).T)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Gimbal lock")
        heading, pitch, roll = turn.as_euler("ZXY", degrees=True)
    return float(-heading), float(pitch), float(roll)


def write_realityscan_csv(path: Path | str, reconstruction: Reconstruction) -> None:
    """Write cameras and poses as RealityScan's table "Internal/External camera parameters".

    Raises CameraError for cameras the table cannot hold (skew, unequal focal lengths, other than Brown's
    distortion), OutputError if the file cannot be written.
    """
    lines = ["#" + ",".join(_COLUMNS)]
    for posed in reconstruction.cameras:
        f35, pu, pv, skew, aspect, lens = _numbers_of(posed.camera, posed.name)
        if skew != 0 or aspect != 1:
            raise CameraError(f"{posed.name}: RealityScan's table has no skew and no unequal focal lengths.")
        values = [*posed.centre, *_angles_from_rotation(posed.rotation), f35, pu, pv, *lens]
        lines.append(",".join([posed.name, *(exact(v) for v in values)]))
    write_text(path, "\n".join(lines) + "\n")
