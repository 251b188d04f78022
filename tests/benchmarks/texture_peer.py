"""One program textures the scene in FOLDER: python texture_peer.py PROGRAM FOLDER (see texture_peers.py).

Writes FOLDER/PROGRAM.npz: either `view`, `uv` (pixels of the photos) and `gain`, or `page`, `uv` (in [0, 1],
v up) and the names of the `pages`. The interpreter needs numpy and the program itself only.
"""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import numpy as np

TEXTURE_SIZE = 8192
"""Side of the other programs' textures: finer on the surface than the photos."""
OPEN3D_SIZE = 2048
"""Open3D's time and memory grow with this and with the number of photos: larger ones are not reached."""
CPU_LIMIT = 300
"""Seconds after which a program is stopped."""


def fresco(folder: Path, scene) -> None:
    selection, _ = _fresco_selection(scene)
    np.savez(folder / "fresco.npz", view=selection.view, uv=selection.uv, gain=selection.gain)


def fresco_atlas(folder: Path, scene) -> None:
    from fresco.core.texture import bake_atlas

    selection, views = _fresco_selection(scene)
    atlas = bake_atlas(folder, "fresco-atlas", scene["vertices"], scene["faces"], selection, views)
    pages = [path.name for path in atlas.paths]
    uv = (atlas.layout.uv + 0.5) / atlas.layout.size
    uv[..., 1] = 1 - uv[..., 1]
    uv[selection.view < 0] = 0
    np.savez(folder / "fresco-atlas.npz", page=atlas.layout.page, uv=uv, pages=pages)


def _fresco_selection(scene):
    import cv2
    from fresco.core.cameras import PerspectiveCamera
    from fresco.core.texture import View, select_views

    height, width = cv2.imread(str(scene["image"][0])).shape[:2]
    views = [
        View(PerspectiveCamera(width, height, K), R, t, Path(str(image)))
        for K, R, t, image in zip(scene["K"], scene["R"], scene["t"], scene["image"], strict=True)
    ]
    return select_views(scene["vertices"], scene["faces"], views), views


def meshlab(folder: Path, scene, projected: bool = False) -> None:
    import pymeshlab

    _write_ply(folder / "scan.ply", scene)
    (folder / "scene.mlp").write_text(_meshlab_project(scene))
    name = "meshlab-projected" if projected else "meshlab"
    meshes = pymeshlab.MeshSet()
    meshes.load_project(str(folder / "scene.mlp"))
    if projected:
        meshes.compute_texcoord_parametrization_triangle_trivial_per_wedge(textdim=TEXTURE_SIZE, border=1)
        meshes.compute_color_and_texture_from_active_rasters_projection(
            textname=f"{name}.png", texsize=TEXTURE_SIZE, dorefill=True
        )
    else:
        meshes.compute_texcoord_parametrization_and_texture_from_registered_rasters(
            texturesize=TEXTURE_SIZE, texturename=f"{name}.png", colorcorrection=True
        )
    mesh = meshes.current_mesh()
    if mesh.face_number() != len(scene["faces"]):
        raise SystemExit(f"MeshLab changed the number of faces to {mesh.face_number()}")
    uv = mesh.wedge_tex_coord_matrix().reshape(-1, 3, 2)
    meshes.save_current_mesh(str(folder / f"{name}.obj"))
    np.savez(folder / f"{name}.npz", page=np.zeros(len(uv), int), uv=uv, pages=[f"{name}.png"])


def meshlab_projected(folder: Path, scene) -> None:
    meshlab(folder, scene, projected=True)


def _write_ply(path: Path, scene) -> None:
    vertices, faces = scene["vertices"].astype("<f4"), scene["faces"]
    rows = np.zeros(len(faces), dtype=[("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, faces
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(head.encode() + vertices.tobytes() + rows.tobytes())


def _meshlab_project(scene) -> str:
    """A project of MeshLab; its cameras look along -z with y up, a pixel is 1 mm."""
    rasters = []
    for K, R, t, image in zip(scene["K"], scene["R"], scene["t"], scene["image"], strict=True):
        turned = np.eye(4)
        turned[:3, :3] = np.diag([1, -1, -1]) @ R
        x, y, z = (R.T @ t).tolist()  # minus the camera's centre
        width, height = round(2 * K[0, 2] + 1), round(2 * K[1, 2] + 1)
        rasters.append(
            f'<MLRaster label="{Path(str(image)).name}"><VCGCamera CameraType="0" LensDistortion="0 0" '
            f'TranslationVector="{x} {y} {z} 1" FocalMm="{float(K[0, 0])}" '
            f'PixelSizeMm="1 1" ViewportPx="{width} {height}" CenterPx="{width // 2} {height // 2}" '
            f'RotationMatrix="{" ".join(map(str, turned.ravel().tolist()))}"/>'
            f'<Plane semantic="RGB" fileName="{image}"/></MLRaster>'
        )
    identity = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1"
    return (
        "<!DOCTYPE MeshLabDocument><MeshLabProject><MeshGroup>"
        f'<MLMesh label="scan" filename="scan.ply"><MLMatrix44>{identity}</MLMatrix44></MLMesh>'
        f"</MeshGroup><RasterGroup>{''.join(rasters)}</RasterGroup></MeshLabProject>"
    )


def open3d(folder: Path, scene) -> None:
    import open3d as o3d

    mesh = o3d.t.geometry.TriangleMesh(
        o3d.core.Tensor(scene["vertices"].astype(np.float32)),
        o3d.core.Tensor(scene["faces"].astype(np.int64)),
    )
    mesh.compute_uvatlas(OPEN3D_SIZE, gutter=2.0, max_stretch=0.5, parallel_partitions=8, nthreads=1)
    images = [o3d.t.io.read_image(str(image)) for image in scene["image"]]
    poses = []
    for R, t in zip(scene["R"], scene["t"], strict=True):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = R, t
        poses.append(o3d.core.Tensor(pose))
    lenses = [o3d.core.Tensor(K) for K in scene["K"]]
    albedo = mesh.project_images_to_albedo(images, lenses, poses, OPEN3D_SIZE, True)
    o3d.t.io.write_image(str(folder / "open3d.png"), albedo)
    uv = mesh.triangle["texture_uvs"].numpy()
    np.savez(folder / "open3d.npz", page=np.zeros(len(uv), int), uv=uv, pages=["open3d.png"])


def colmap(folder: Path, scene) -> None:
    import pycolmap

    offered = [name for name in dir(pycolmap) if "textur" in name.lower()]
    raise SystemExit(f"pycolmap {pycolmap.__version__} offers {offered or 'no mesh texturer'}")


if __name__ == "__main__":
    programs = {
        "fresco": fresco,
        "fresco-atlas": fresco_atlas,
        "meshlab": meshlab,
        "meshlab-projected": meshlab_projected,
        "open3d": open3d,
        "colmap": colmap,
    }
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_LIMIT, CPU_LIMIT + 10))
    target = Path(sys.argv[2])
    with np.load(target / "scene.npz") as stored:
        programs[sys.argv[1]](target, dict(stored))
