"""Photographs of the sample: Cycles renders a wide pinhole picture, which is bent into what the lens sees.

Pixels have the centre of the top-left pixel at (0, 0). The lens is OpenCV's Brown-Conrady model, evaluated by
OpenCV itself, so that the sample does not depend on the camera models it is there to try.
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import bpy
import cv2
import numpy as np
from mathutils import Matrix, Vector

WIDTH, HEIGHT, SENSOR = 1500, 1000, 36.0
OVERSAMPLING = 1.1


@dataclass(frozen=True)
class Lens:
    """A calibrated lens: focal length (mm on 36 mm), centre offset (pixels), k1, k2, p1, p2, k3."""

    name: str
    focal: float
    offset: tuple
    distortion: tuple

    @property
    def matrix(self):
        """Camera matrix (3,3) in pixels."""
        f = self.focal / SENSOR * WIDTH
        return np.array(
            [[f, 0, (WIDTH - 1) / 2 + self.offset[0]], [0, f, (HEIGHT - 1) / 2 + self.offset[1]], [0, 0, 1]]
        )

    def normalised(self, pixels):
        """Undistorted image coordinates (x/z, y/z) of pixels: (N,2) -> (N,2)."""
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-8)
        points = np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        return cv2.undistortPointsIter(points, self.matrix, np.array(self.distortion), None, None, stop)[:, 0]

    def project(self, points):
        """Pixels of points in the camera frame: (N,3) -> (N,2)."""
        zero = np.zeros(3)
        return cv2.projectPoints(
            np.asarray(points, float), zero, zero, self.matrix, np.array(self.distortion)
        )[0][:, 0]


@dataclass(frozen=True)
class Shot:
    """A photograph: where the camera stands, what it looks at (m), its roll (degrees) and exposure (EV)."""

    name: str
    lens: Lens
    position: tuple
    target: tuple
    roll: float
    exposure: float

    @property
    def rotation(self):
        """World to camera (3,3), OpenCV axes."""
        forward = np.subtract(self.target, self.position)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, (0, 0, 1))
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        c, s = np.cos(np.radians(self.roll)), np.sin(np.radians(self.roll))
        return np.array([c * right + s * down, -s * right + c * down, forward])

    @property
    def translation(self):
        """World to camera (3,), metres."""
        return -self.rotation @ np.asarray(self.position, dtype=float)

    def pixels(self, points):
        """Pixels of world points: (N,3) -> (N,2)."""
        return self.lens.project(np.asarray(points) @ self.rotation.T + self.translation)


WIDE = Lens("24 mm", 24.0, (6.3, -4.1), (-0.118, 0.082, 0.0006, -0.0004, -0.017))
NORMAL = Lens("35 mm", 35.0, (-4.2, 3.6), (-0.064, 0.051, -0.0003, 0.0005, 0.0))
LONG = Lens("50 mm", 50.0, (2.7, 5.2), (0.024, -0.031, 0.0002, 0.0003, 0.0))

SHOTS = (
    Shot("01_overview", WIDE, (3.05, -4.05, 1.62), (2.1, 0.0, 1.72), 0.6, 0.0),
    Shot("02_corner", WIDE, (4.25, -3.35, 1.75), (0.9, -0.75, 1.6), -0.9, 0.5),
    Shot("03_saint", NORMAL, (1.75, -4.1, 1.5), (1.35, 0.0, 1.9), 0.3, -0.3),
    Shot("04_annunciation", NORMAL, (3.2, -4.3, 1.68), (2.9, 0.0, 1.85), -0.4, 0.2),
    Shot("05_detail", LONG, (3.2, -5.2, 1.6), (2.86, 0.0, 1.85), 1.2, -0.5),
    Shot("06_low", WIDE, (1.7, -3.0, 0.95), (1.95, 0.0, 1.95), -1.5, 0.3),
    Shot("07_door", NORMAL, (4.1, -2.1, 1.45), (0.0, -1.5, 1.35), 0.5, -0.2),
)


def build_scene(parts, samples):
    """Put the sample's parts, their pictures and the light into an empty Blender scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = samples
    scene.cycles.seed = 1
    scene.cycles.use_denoising = True
    scene.cycles.denoiser = "OPENIMAGEDENOISE"
    scene.cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
    scene.cycles.denoising_prefilter = "FAST"
    scene.cycles.max_bounces = 2
    scene.render.threads_mode = "FIXED"
    scene.render.threads = 2
    for part in parts:
        scene.collection.objects.link(_part_object(part))
    _light(scene)
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)


def _part_object(part):
    mesh = bpy.data.meshes.new(part.name)
    mesh.from_pydata(part.vertices.tolist(), [], part.faces.tolist())
    mesh.uv_layers.new().uv.foreach_set("vector", part.uv[part.faces.ravel()].astype(np.float32).ravel())
    mesh.shade_smooth()
    mesh.set_sharp_from_angle(angle=np.radians(28))
    height, width = part.picture.shape[:2]
    image = bpy.data.images.new(part.name, width, height)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = part.picture[::-1] / 255.0
    image.pixels.foreach_set(rgba.ravel())
    material = bpy.data.materials.new(part.name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture = nodes.new("ShaderNodeTexImage")
    texture.image, texture.interpolation = image, "Cubic"
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.95
    shader.inputs["Specular IOR Level"].default_value = 0.1
    links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    mesh.materials.append(material)
    return bpy.data.objects.new(part.name, mesh)


def _light(scene):
    """Soft daylight from the open side, a low sun from the left that gives the relief its shadow."""
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.82, 0.9, 1.0, 1.0)
    background.inputs["Strength"].default_value = 0.62
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle, sun.color = 1.7, np.radians(4), (1.0, 0.93, 0.82)
    lamp = bpy.data.objects.new("sun", sun)
    lamp.rotation_mode = "QUATERNION"
    lamp.rotation_quaternion = Vector((0.62, -0.85, 0.95)).to_track_quat("Z", "Y")
    scene.collection.objects.link(lamp)


def photograph(shot, scratch, rng):
    """Render one shot: (HEIGHT, WIDTH, 3) uint8 RGB, lens distortion and exposure included."""
    focal = shot.lens.matrix[0, 0] * OVERSAMPLING
    half = _half_extent(shot.lens) * 1.01 * focal
    size = np.ceil(2 * half).astype(int)
    wide = _render_pinhole(shot, focal, size, Path(scratch) / "wide.exr")
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    x = shot.lens.normalised(np.stack([u.ravel(), v.ravel()], axis=1))
    at = (focal * x + (size - 1) / 2).astype(np.float32).reshape(HEIGHT, WIDTH, 2)
    linear = cv2.remap(wide, at[..., 0], at[..., 1], cv2.INTER_CUBIC)
    linear = np.clip(linear * 2.0**shot.exposure, 0, 1)
    coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.clip(np.rint(255 * coded + rng.normal(0, 0.8, coded.shape)), 0, 255).astype(np.uint8)


def _half_extent(lens):
    """Largest |x/z| and |y/z| seen at the frame's edge: (2,)."""
    u, v = np.linspace(-0.5, WIDTH - 0.5, 200), np.linspace(-0.5, HEIGHT - 0.5, 200)
    edge = np.concatenate([np.stack(np.broadcast_arrays(u, end), 1) for end in (-0.5, HEIGHT - 0.5)])
    edge = np.concatenate([edge] + [np.stack(np.broadcast_arrays(end, v), 1) for end in (-0.5, WIDTH - 0.5)])
    return np.abs(lens.normalised(edge)).max(axis=0)


def _render_pinhole(shot, focal, size, path):
    """Linear RGB picture of a pinhole with its centre in the middle of the frame: (H,W,3) float32."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = map(int, size)
    scene.render.resolution_percentage = 100
    camera = scene.camera.data
    camera.sensor_fit, camera.sensor_width = "HORIZONTAL", SENSOR
    camera.lens = SENSOR * focal / size[0]
    pose = np.eye(4)
    pose[:3, :3] = shot.rotation.T @ np.diag([1.0, -1.0, -1.0])  # Blender looks along -z with y up
    pose[:3, 3] = shot.position
    scene.camera.matrix_world = Matrix(pose.tolist())
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    pixels = np.empty(size[0] * size[1] * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return np.ascontiguousarray(pixels.reshape(size[1], size[0], 4)[::-1, :, :3])


def write_jpeg(path, image, shot, quality=87):
    """Save a photo with the EXIF entries a camera writes."""
    coded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
    exif = b"Exif\0\0" + exif_block(shot)
    header = b"\xff\xd8\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif
    Path(path).write_bytes(header + coded[2:])


def exif_block(shot):
    """A TIFF block with make, model, lens, focal lengths and exposure. Source: CIPA DC-008 (EXIF 2.32)."""
    text = {0x010F: "Fresco", 0x0110: "Sample 1500", 0x0131: "make_sample.py"}
    shutter = round(60 * 2.0**-shot.exposure)
    photo = {
        0x829A: (1, shutter), 0x829D: (8, 1), 0x8827: 200, 0x9003: "2024:06:01 10:00:00",
        0x920A: (round(shot.lens.focal * 10), 10), 0xA002: WIDTH, 0xA003: HEIGHT,
        0xA405: round(shot.lens.focal), 0xA434: f"Sample {shot.lens.name}",
    }  # fmt: skip
    start = 8
    first_size = 2 + 12 * (len(text) + 2) + 4
    data_start = start + first_size
    text_data = b"".join(v.encode() + b"\0" for v in text.values())
    second_start = data_start + len(text_data)
    first = _directory(text | {0x0112: 1, 0x8769: second_start}, start)
    return b"II*\0" + struct.pack("<I", start) + first + _directory(photo, second_start)


def _directory(entries, start):
    """One image file directory with its data behind it."""
    behind = start + 2 + 12 * len(entries) + 4
    table, data = struct.pack("<H", len(entries)), b""
    for tag, value in sorted(entries.items()):
        if isinstance(value, str):
            raw = value.encode() + b"\0"
            kind, count = 2, len(raw)
        elif isinstance(value, tuple):
            raw, kind, count = struct.pack("<II", *value), 5, 1
        elif tag == 0x8769:
            raw, kind, count = struct.pack("<I", value), 4, 1
        else:
            raw, kind, count = struct.pack("<HH", value, 0), 3, 1
        if len(raw) > 4:
            field = struct.pack("<I", behind + len(data))
            data += raw
        else:
            field = raw.ljust(4, b"\0")
        table += struct.pack("<HHI", tag, kind, count) + field
    return table + struct.pack("<I", 0) + data
