"""A corner of a room with painted panels, photographed by rays through core's camera: known truth."""

import cv2
import numpy as np

SIZE = (480, 320)
K = np.array([[520.0, 0, 236.5], [0, 520.0, 163.0], [0, 0, 1]])
DISTORTION = (-0.12, 0.03, 0.001, -0.0005)
PANELS = {
    "red panel": (0, 0.5, 1.7, 0.5, 1.5),
    "green panel": (1, 0.6, 1.6, 0.7, 1.9),
    "blue tile": (2, 0.9, 1.7, 0.8, 1.5),
}
"""Name -> plane (0: x = 0, 1: y = 0, 2: z = 0), and the rectangle on it."""
COLORS = {"red panel": (220, 60, 50), "green panel": (60, 200, 80), "blue tile": (70, 90, 230)}
CELLS = 24
SIDE = 2.4


def walls():
    """Three square walls that meet at the origin: vertices (V,3) m, faces (F,3), plane of each face (F,)."""
    steps = np.linspace(0, SIDE, CELLS + 1)
    a, b = (grid.ravel() for grid in np.meshgrid(steps, steps))
    corner = (np.arange(CELLS)[:, None] * (CELLS + 1) + np.arange(CELLS)).ravel()
    lower = np.stack([corner, corner + 1, corner + CELLS + 2], axis=1)
    upper = np.stack([corner, corner + CELLS + 2, corner + CELLS + 1], axis=1)
    square = np.concatenate([lower, upper])
    vertices, faces, planes = [], [], []
    for plane, (first, second) in enumerate([(1, 2), (0, 2), (0, 1)]):
        points = np.zeros((len(a), 3))
        points[:, first], points[:, second] = a, b
        turned = square[:, ::-1] if plane == 1 else square  # all face into the room
        faces.append(turned + len(vertices) * len(a))
        vertices.append(points)
        planes.append(np.full(len(square), plane))
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(planes)


def panel_faces(vertices, faces, planes):
    """Name -> numbers of the faces inside each painted panel."""
    centres = vertices[faces].mean(axis=1)
    return {name: np.flatnonzero(inside) for name, inside in on_panels(centres, planes).items()}


def write_scan(path, offset=(0, 0, 0)):
    """Write the walls as a PLY in double precision, the panels as a face label."""
    vertices, faces, planes = walls()
    label = np.zeros(len(faces), dtype=np.int32)
    for number, numbers in enumerate(panel_faces(vertices, faces, planes).values(), 1):
        label[numbers] = number
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\n"
        "property int region\nend_header\n"
    )
    rows = np.zeros(len(faces), dtype=[("n", "u1"), ("v", "<i4", 3), ("region", "<i4")])
    rows["n"], rows["v"], rows["region"] = 3, faces, label
    path.write_bytes(header.encode() + (vertices + offset).astype("<f8").tobytes() + rows.tobytes())
    return vertices, faces


def write_cloud(path, spacing=0.02, offset=(0, 0, 0)):
    """Write the walls as a PLY of scattered, coloured points; -> points (N,3) m and the plane of each."""
    random = np.random.default_rng(3)
    steps = np.arange(spacing / 2, SIDE, spacing)
    a, b = (grid.ravel() for grid in np.meshgrid(steps, steps))
    points, planes = [], []
    for plane, (first, second) in enumerate([(1, 2), (0, 2), (0, 1)]):
        wall = random.normal(0, 0.0005, (len(a), 3))
        wall[:, first] = a + random.uniform(-0.4, 0.4, len(a)) * spacing
        wall[:, second] = b + random.uniform(-0.4, 0.4, len(a)) * spacing
        points.append(wall)
        planes.append(np.full(len(a), plane))
    points, planes = np.concatenate(points), np.concatenate(planes)
    rows = np.zeros(len(points), dtype=[("xyz", "<f8", 3), ("rgb", "u1", 3)])
    rows["xyz"], rows["rgb"] = points + offset, paint(points, planes)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz")
    header += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue")) + "end_header\n"
    path.write_bytes(header.encode() + rows.tobytes())
    return points, planes


def look_at(eye, target):
    """World -> camera pose at `eye` that looks at `target`, z up: rotation (3,3), translation (3,)."""
    forward = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    right = np.cross(forward, (0, 0, 1.0))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return rotation, -rotation @ np.asarray(eye, dtype=float)


POSES = [look_at(eye, (0.7, 0.7, 0.65)) for eye in [(4.0, 3.4, 2.2), (3.2, 4.2, 1.8), (4.4, 2.6, 2.8)]]


def on_panels(points, plane):
    """Name -> which points (N,) of the walls lie on the painted panel."""
    inside = {}
    for name, (wall, a0, a1, b0, b1) in PANELS.items():
        others = np.delete(points, wall, axis=1)
        inside[name] = (plane == wall) & (others > (a0, b0)).all(axis=1) & (others < (a1, b1)).all(axis=1)
    return inside


def paint(points, plane):
    """Colour (N,3) of points on the walls: stripes per wall, panels in a colour of their own."""
    shade = 70 + 25 * ((points * 5).astype(int).sum(axis=1) % 3)
    color = np.stack([shade, shade + 10 * plane, shade + 20], axis=1)
    for name, inside in on_panels(points, plane).items():
        color[inside] = COLORS[name]
    return color.astype(np.uint8)


def take_photo(camera, rotation, translation):
    """Photo (H,W,3) RGB and the masks of the panels that it shows whole."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1).astype(float)) @ rotation
    eye = -rotation.T @ translation
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -eye / rays
    image = np.full((len(rays), 3), 15, dtype=np.uint8)
    hit_plane = np.full(len(rays), -1)
    hit_point = np.zeros((len(rays), 3))
    for plane in range(3):
        points = eye + depth[:, plane, None] * rays
        others = np.delete(points, plane, axis=1)
        hit = (depth[:, plane] > 0) & (others >= 0).all(axis=1) & (others <= SIDE).all(axis=1)
        hit_plane[hit], hit_point[hit] = plane, points[hit]
    seen = hit_plane >= 0
    image[seen] = paint(hit_point[seen], hit_plane[seen])
    shape = (camera.height, camera.width)
    masks = {name: inside.reshape(shape) for name, inside in on_panels(hit_point, hit_plane).items()}
    return image.reshape(camera.height, camera.width, 3), masks


def write_png(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    _, data = cv2.imencode(".png", image[..., ::-1] if image.ndim == 3 else image)
    path.write_bytes(data.tobytes())


def write_all(folder, camera, offset=(0, 0, 0)):
    """Write scan, photos and masks into a folder: scan.ply, photos/NAME.png, masks/NAME/REGION.png."""
    folder.mkdir(parents=True, exist_ok=True)
    write_scan(folder / "scan.ply", offset)
    for number, (rotation, translation) in enumerate(POSES, 1):
        image, masks = take_photo(camera, rotation, translation)
        write_png(folder / "photos" / f"wall {number}.png", image)
        for name, mask in masks.items():
            write_png(folder / "masks" / f"wall {number}" / f"{name}.png", mask.astype(np.uint8) * 255)
