"""Metashape's exported cameras (`cameras.xml`).

Every camera has a 4 x 4 matrix camera -> chunk with OpenCV's axes; the chunk, or since version 1.5 its
components, have rotation, translation and scale chunk -> world. The world is the local system in metres,
and geocentric coordinates (ECEF) where the chunk has a geographic or projected one.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ...arrays import FloatArray
from ...errors import CameraError
from ..base import Camera
from ..files.metashape import camera_from_metashape, metashape_calibration
from ..files.text import exact, number, numbers, read_xml, whole, write_text
from .reconstruction import PosedCamera, Reconstruction, checked_rotation, distinct_cameras, pose_from_centre

_Similarity = tuple[float, FloatArray, FloatArray]
_IDENTITY: _Similarity = (1.0, np.eye(3), np.zeros(3))


def read_metashape_cameras(path: Path | str) -> Reconstruction:
    """Cameras and poses of a Metashape `cameras.xml`; its photos carry their labels as names.

    Raises
    ------
    CameraError
        A broken file, several chunks, cameras of a type that is not central or not known.
    """
    chunks = list(read_xml(path).iter("chunk"))
    if len(chunks) != 1:
        raise CameraError(f"{path} has {len(chunks)} chunks: export one chunk's cameras from Metashape.")
    chunk = chunks[0]
    sensors = {sensor.get("id"): sensor for sensor in chunk.iter("sensor")}
    worlds = _component_worlds(chunk, str(path))
    whole_chunk = _similarity(chunk.find("transform"), f"{path}: chunk")
    made: dict[str | None, Camera] = {}
    posed, unposed = [], []
    for element in chunk.iter("camera"):
        label = element.get("label") or f"camera {element.get('id')}"
        what = f"{path}: {label}"
        transform = element.findtext("transform")
        if transform is None:
            unposed.append(label)
            continue
        sensor = element.get("sensor_id")
        if sensor not in made:
            made[sensor] = _sensor_camera(sensors.get(sensor), what)
        world = worlds.get(element.get("component_id"), whole_chunk)
        posed.append(PosedCamera(label, made[sensor], *_pose(numbers(transform, what, 16), world, what)))
    return Reconstruction(tuple(posed), unposed=tuple(unposed))


def _component_worlds(chunk: ElementTree.Element, path: str) -> dict[str | None, _Similarity]:
    worlds = {}
    for component in chunk.iter("component"):
        transform = component.find("transform")
        if transform is not None:
            worlds[component.get("id")] = _similarity(transform, f"{path}: component {component.get('id')}")
    return worlds


def _similarity(transform: ElementTree.Element | None, what: str) -> _Similarity:
    """Scale, rotation and translation of a chunk's or component's `<transform>`, each optional."""
    if transform is None:
        return _IDENTITY
    rotation, translation = transform.findtext("rotation"), transform.findtext("translation")
    scale = transform.findtext("scale")
    return (
        1.0 if scale is None else number(scale, f"{what}: scale"),
        np.eye(3) if rotation is None else checked_rotation(numbers(rotation, what, 9), what),
        np.zeros(3) if translation is None else numbers(translation, what, 3),
    )


def _sensor_camera(sensor: ElementTree.Element | None, what: str) -> Camera:
    if sensor is None:
        raise CameraError(f"{what}: its sensor is not in the file.")
    calibrations = {element.get("class", "adjusted"): element for element in sensor.findall("calibration")}
    calibration = calibrations.get("adjusted", calibrations.get("initial"))
    kind = sensor.get("type", "frame")
    if calibration is None:
        if kind != "spherical":
            raise CameraError(f"{what}: its sensor has no <calibration>.")
        calibration = ElementTree.Element("calibration")
    resolution = sensor.find("resolution")
    size = None
    if resolution is not None:
        size = (
            whole(resolution.get("width"), f"{what}: width"),
            whole(resolution.get("height"), f"{what}: height"),
        )
    return camera_from_metashape(calibration, what, size, kind)


def _pose(transform: FloatArray, world: _Similarity, what: str) -> tuple[FloatArray, FloatArray]:
    matrix = transform.reshape(4, 4)
    scale, rotation, translation = world
    camera_to_world = rotation @ checked_rotation(matrix[:3, :3], what)
    return pose_from_centre(camera_to_world.T, scale * rotation @ matrix[:3, 3] + translation)


def write_metashape_cameras(path: Path | str, reconstruction: Reconstruction) -> None:
    """Write cameras and poses as a Metashape `cameras.xml`, the chunk's system being the world.

    Raises CameraError for cameras that Metashape has no model for, OutputError if the file cannot be written.
    """
    cameras, indices = distinct_cameras(reconstruction.cameras)
    root = ElementTree.Element("document", version="2.0.0")
    chunk = ElementTree.SubElement(root, "chunk", label="Chunk 1", enabled="true")
    sensors = ElementTree.SubElement(chunk, "sensors", next_id=str(len(cameras)))
    for identity, camera in enumerate(cameras):
        _add_sensor(sensors, identity, camera)
    _add_component(chunk)
    count = str(len(reconstruction.cameras))
    photos = ElementTree.SubElement(chunk, "cameras", next_id=count, next_group_id="0")
    for identity, (posed, index) in enumerate(zip(reconstruction.cameras, indices, strict=True)):
        attributes = {"id": str(identity), "sensor_id": str(index), "component_id": "0", "label": posed.name}
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = posed.rotation.T, posed.centre
        photo = ElementTree.SubElement(photos, "camera", attributes)
        ElementTree.SubElement(photo, "transform").text = _words(matrix)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    write_text(path, f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n')


def _add_sensor(sensors: ElementTree.Element, identity: int, camera: Camera) -> None:
    kind, parameters = metashape_calibration(camera)
    size = {"width": str(camera.width), "height": str(camera.height)}
    sensor = ElementTree.SubElement(
        sensors, "sensor", id=str(identity), label=f"Camera {identity}", type=kind
    )
    ElementTree.SubElement(sensor, "resolution", size)
    calibration = ElementTree.SubElement(sensor, "calibration", {"type": kind, "class": "adjusted"})
    ElementTree.SubElement(calibration, "resolution", size)
    for key, value in parameters:
        ElementTree.SubElement(calibration, key).text = exact(value)


def _add_component(chunk: ElementTree.Element) -> None:
    components = ElementTree.SubElement(chunk, "components", next_id="1", active_id="0")
    component = ElementTree.SubElement(components, "component", id="0", label="Component 1")
    transform = ElementTree.SubElement(component, "transform")
    ElementTree.SubElement(transform, "rotation").text = _words(np.eye(3))
    ElementTree.SubElement(transform, "translation").text = _words(np.zeros(3))
    ElementTree.SubElement(transform, "scale").text = exact(1.0)


def _words(values: FloatArray) -> str:
    return " ".join(exact(v) for v in values.ravel())
