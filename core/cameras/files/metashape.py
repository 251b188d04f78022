"""Metashape's (PhotoScan's) calibration: an XML file of its own, and the same element inside `cameras.xml`.

With x, y on the normalised plane (frame cameras) or on the equidistant plane (fisheye) Metashape computes

    x' = x (1 + K1 r^2 + K2 r^4 + K3 r^6 + K4 r^8) + P1 (r^2 + 2 x^2) + 2 P2 x y
    y' = y (1 + ...)                               + P2 (r^2 + 2 y^2) + 2 P1 x y
    u = width / 2 + cx + f x' + B1 x' + B2 y',   v = height / 2 + cy + f y'

Its P1, P2 are OpenCV's p2, p1, and the centre of its top-left pixel is (0.5, 0.5).
Source: Metashape manual, appendix on camera models.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ...arrays import FloatArray
from ...errors import CameraError
from ..base import Camera
from ..distortion import Distortion, trimmed
from ..equirectangular import EquirectangularCamera
from ..fisheye import FisheyeCamera
from ..perspective import PerspectiveCamera
from ..plane import PlaneCamera
from .text import exact, number, read_xml, whole, write_text

_SENSOR_TYPES = {
    "frame": "frame",
    "fisheye": "fisheye",
    "equidistant_fisheye": "fisheye",
    "spherical": "spherical",
}


def read_metashape(path: Path | str) -> Camera:
    """Camera from a Metashape calibration file (`<calibration>`); CameraError if it makes no sense."""
    root = read_xml(path)
    element = root if root.tag == "calibration" else root.find(".//calibration")
    if element is None:
        raise CameraError(f"{path} has no <calibration>: it is not a Metashape calibration file.")
    return camera_from_metashape(element, str(path))


def camera_from_metashape(
    element: ElementTree.Element, what: str, size: tuple[int, int] | None = None, kind: str | None = None
) -> Camera:
    """Camera from a `<calibration>` element; size and kind stand outside it in cameras.xml.

    Raises
    ------
    CameraError
        Missing entries, or a camera type that is not a central one of ours.
    """
    kind = kind or element.get("type") or element.findtext("projection") or "frame"
    if kind not in _SENSOR_TYPES:
        raise CameraError(f"{what}: cameras of the type '{kind}' are not supported.")
    if size is None:
        size = _element_size(element, what)
    width, height = size
    if _SENSOR_TYPES[kind] == "spherical":
        return EquirectangularCamera(width, height)
    given = {
        child.tag: number(child.text, f"{what}: <{child.tag}>") for child in element if _is_parameter(child)
    }
    if given.get("p3", 0) != 0 or given.get("p4", 0) != 0:
        raise CameraError(
            f"{what}: the tangential terms P3 and P4 are not supported: calibrate without them."
        )
    K, tangential = _old_layout(given) if "fx" in given else _layout(given, width, height, what)
    lens = Distortion(trimmed(*(given.get(key, 0.0) for key in ("k1", "k2", "k3", "k4"))), (), tangential)
    try:
        if _SENSOR_TYPES[kind] == "fisheye":
            return FisheyeCamera(width, height, K, (), lens)
        return PerspectiveCamera(width, height, K, lens)
    except CameraError as error:
        raise CameraError(f"{what}: {error}") from error


_PARAMETERS = (
    "f",
    "fx",
    "fy",
    "skew",
    "cx",
    "cy",
    "b1",
    "b2",
    "k1",
    "k2",
    "k3",
    "k4",
    "p1",
    "p2",
    "p3",
    "p4",
)


def _is_parameter(child: ElementTree.Element) -> bool:
    return child.tag in _PARAMETERS


def _layout(
    given: dict[str, float], width: int, height: int, what: str
) -> tuple[FloatArray, tuple[float, float]]:
    """K and OpenCV's p1, p2."""
    if "f" not in given:
        raise CameraError(f"{what}: the focal length <f> is missing.")
    f, b1, b2 = given["f"], given.get("b1", 0.0), given.get("b2", 0.0)
    cx, cy = given.get("cx", 0.0) + width / 2 - 0.5, given.get("cy", 0.0) + height / 2 - 0.5
    return np.array([[f + b1, b2, cx], [0, f, cy], [0, 0, 1]]), (given.get("p2", 0.0), given.get("p1", 0.0))


def _old_layout(given: dict[str, float]) -> tuple[FloatArray, tuple[float, float]]:
    """K and p1, p2 of old PhotoScan and Agisoft Lens: principal point from the corner, OpenCV's p1, p2."""
    fx, fy = given["fx"], given.get("fy", given["fx"])
    cx, cy = given.get("cx", 0.0) - 0.5, given.get("cy", 0.0) - 0.5
    K = np.array([[fx, given.get("skew", 0.0), cx], [0, fy, cy], [0, 0, 1]])
    return K, (given.get("p1", 0.0), given.get("p2", 0.0))


def _element_size(element: ElementTree.Element, what: str) -> tuple[int, int]:
    resolution = element.find("resolution")
    if resolution is not None:
        words = (resolution.get("width"), resolution.get("height"))
    else:
        words = (element.findtext("width"), element.findtext("height"))
    if None in words:
        raise CameraError(f"{what}: the size of the photo is missing.")
    return whole(words[0], f"{what}: width"), whole(words[1], f"{what}: height")


def metashape_calibration(camera: Camera) -> tuple[str, list[tuple[str, float]]]:
    """Metashape's type and parameters of a camera; CameraError if it has no such model."""
    if isinstance(camera, EquirectangularCamera):
        if not camera.is_whole:
            raise CameraError("Metashape has no model for a cropped panorama.")
        return "spherical", []
    if isinstance(camera, PerspectiveCamera):
        kind = "frame"
    elif isinstance(camera, FisheyeCamera) and not any(camera.coefficients):
        kind = "equidistant_fisheye"
    else:
        raise CameraError(f"Metashape has no model for this {type(camera).__name__}.")
    lens = camera.distortion
    if lens.denominator or any(lens.prism) or len(lens.radial) > 4:
        raise CameraError("Metashape has no rational and no thin-prism terms of distortion.")
    return kind, _parameters(camera)


def _parameters(camera: PlaneCamera) -> list[tuple[str, float]]:
    (fx, skew, cx), (_, fy, cy) = camera.K[0], camera.K[1]
    p1, p2 = camera.distortion.tangential
    radial = (*camera.distortion.radial, *(0.0,) * 4)[:4]
    values = {
        "f": fy,
        "cx": cx + 0.5 - camera.width / 2,
        "cy": cy + 0.5 - camera.height / 2,
        "b1": fx - fy,
        "b2": skew,
        **{f"k{i}": k for i, k in enumerate(radial, start=1)},
        "p1": p2,
        "p2": p1,
    }
    return [(key, float(value)) for key, value in values.items() if key == "f" or value != 0]


def write_metashape(path: Path | str, camera: Camera) -> None:
    """Write a camera as a Metashape calibration file; CameraError, OutputError if that is impossible."""
    kind, parameters = metashape_calibration(camera)
    root = ElementTree.Element("calibration")
    ElementTree.SubElement(root, "projection").text = kind
    ElementTree.SubElement(root, "width").text = str(camera.width)
    ElementTree.SubElement(root, "height").text = str(camera.height)
    for key, value in parameters:
        ElementTree.SubElement(root, key).text = exact(value)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    write_text(path, f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n')
