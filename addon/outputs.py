"""What Fresco delivers from a scene: one job that the window and the command line share."""

from __future__ import annotations

import contextlib
import io
import json
import logging
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import bpy

from ..core.arrays import FloatArray
from ..core.errors import OutputError
from ..core.files import output_error
from ..core.jobs import Job, Progress, part
from ..core.project import TexturedScan
from ..core.project.stages.cloud import ColouredCloud, write_coloured_cloud
from ..core.project.stages.models import layer_ending
from ..core.report import Report, write_report_job
from ..core.scans import Scan
from ..core.texture import write_obj_job
from ..core.texture.colour.correction import ColourCorrection
from .background import beside_job, one_step_job
from .bridge.texture import read_gains, show_layer
from .bridge.world import read_offset


@dataclass(frozen=True)
class Wanted:
    """Which files to write: `folder / (name + ending)` each; models of every one of `layers`.

    `models` are the names of simplified models that belong to them.
    """

    folder: Path
    name: str
    glb: bool = True
    obj: bool = True
    report: bool = True
    blend: bool = True
    layers: tuple[str, ...] = ("",)
    models: tuple[str, ...] = ()

    def path(self, ending: str) -> Path:
        """Path of an output file."""
        return self.folder / (self.name + ending)

    @property
    def paths(self) -> list[Path]:
        """Paths of all files that are wanted."""
        models = {".glb": self.glb, ".obj": self.obj}
        endings = [layer_ending(layer, e) for layer in self.layers for e, on in models.items() if on]
        others = {"_report.html": self.report, ".blend": self.blend}
        simplified = [self.model_path(name) for name in self.models if self.glb]
        return [*(self.path(e) for e in [*endings, *(e for e, on in others.items() if on)]), *simplified]

    def model_path(self, model: str) -> Path:
        """Path of the .glb of a simplified model."""
        return self.folder / f"{model}.glb"


def outputs_job(context: bpy.types.Context, wanted: Wanted, scan: Scan, report: Report) -> Job[list[Path]]:
    """Write what is wanted; each file appears complete or not at all. Raises OutputError."""
    jobs: list[Callable[[], Job[Path]]] = []
    if wanted.obj:
        for layer, textured in zip(wanted.layers, report.textures, strict=True):
            path = wanted.path(layer_ending(layer, ".obj"))
            jobs.append(partial(_obj_job, path, scan, textured))
    if wanted.report:
        jobs.append(lambda: write_report_job(report, wanted.path("_report.html")))
    if wanted.glb:
        for layer in wanted.layers:
            jobs.append(partial(_glb_job, context, wanted.path(layer_ending(layer, ".glb")), layer))
        for model in wanted.models:
            jobs.append(partial(_model_glb_job, context, wanted.model_path(model), model))
    if wanted.blend:
        jobs.append(lambda: _blend_job(wanted.path(".blend")))
    return (yield from _written_job(wanted.folder, jobs))


def cloud_outputs_job(
    wanted: Wanted,
    scan: Scan,
    report: Report,
    clouds: Mapping[str, tuple[ColouredCloud, ColourCorrection | None]],
) -> Job[list[Path]]:
    """Write coloured points, a PLY for each layer: models would need faces. Raises OutputError."""
    jobs: list[Callable[[], Job[Path]]] = []
    for layer, (cloud, correction) in clouds.items():
        path = wanted.path(layer_ending(layer, "_colours.ply"))
        jobs.append(partial(_points_job, path, cloud, scan.offset, correction))
    if wanted.report:
        jobs.append(lambda: write_report_job(report, wanted.path("_report.html")))
    if wanted.blend:
        jobs.append(lambda: _blend_job(wanted.path(".blend")))
    return (yield from _written_job(wanted.folder, jobs))


def _points_job(
    path: Path, cloud: ColouredCloud, offset: FloatArray, correction: ColourCorrection | None
) -> Job[Path]:
    job = one_step_job(partial(write_coloured_cloud, path, cloud, offset, correction), f"Writing {path.name}")
    return (yield from beside_job(job))


def _written_job(folder: Path, jobs: Sequence[Callable[[], Job[Path]]]) -> Job[list[Path]]:
    """Run the jobs that write files into a folder, which is made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise output_error(folder, error) from error
    written = []
    for number, job in enumerate(jobs):
        written.append((yield from part(job(), number / len(jobs), (number + 1) / len(jobs))))
    return written


def _obj_job(path: Path, scan: Scan, textured: TexturedScan) -> Job[Path]:
    selection, views = textured.selection, textured.views
    return write_obj_job(path, textured.vertices, textured.faces, selection, views, scan.offset)


def _glb_job(context: bpy.types.Context, path: Path, layer: str) -> Job[Path]:
    """Write scan, texture of a layer and cameras as one binary glTF, by Blender's exporter."""
    yield Progress(0.0, f"Writing {path.name}")
    fresco = context.scene.fresco
    chosen = {photo.camera for photo in fresco.photos if photo.is_posed} | {fresco.scan}
    with _layer_shown(context.scene, layer):
        _write_glb(context, path, chosen)
    return path


def _model_glb_job(context: bpy.types.Context, path: Path, model: str) -> Job[Path]:
    """Write a simplified model with its pages as one binary glTF."""
    yield Progress(0.0, f"Writing {path.name}")
    obj = context.scene.objects[model]
    hidden = obj.hide_get()
    obj.hide_set(False)  # what is hidden cannot be selected
    try:
        _write_glb(context, path, {obj})
    finally:
        obj.hide_set(hidden)
    return path


def _write_glb(context: bpy.types.Context, path: Path, chosen: set[bpy.types.Object]) -> None:
    """Write objects of the scene; raises OutputError."""
    if not hasattr(bpy.types, "EXPORT_SCENE_OT_gltf"):
        raise OutputError(f"{path}: enable Blender's add-on “glTF 2.0 format” to write it.")
    temporary = path.with_name(f".{path.name}.part.glb")
    with _selected(context, chosen), _quiet(), _told(path, temporary):
        bpy.ops.export_scene.gltf(
            filepath=str(temporary),
            export_format="GLB",
            use_selection=True,
            export_cameras=True,
            export_animations=False,
            export_skins=False,
            export_morph=False,
        )
        _complete_glb(temporary, read_offset(context.scene), read_gains(context.scene))
        temporary.replace(path)


def _complete_glb(path: Path, offset: FloatArray, gains: Mapping[str, FloatArray]) -> None:
    """Write into a GLB file what Blender's exporter leaves out: the photos' gains and the scene's offset.

    A factor in glTF may not exceed 1, so all gains are divided by the largest one; `asset.extras` keeps it
    (`gain_scale`) beside the offset (`world_offset`, metres in the scan's axes). Source: glTF 2.0, 4.4 (12
    bytes of header, then the JSON chunk, then the binary one) and 5.22.
    """
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    content = json.loads(data[20 : 20 + length])
    scale = max([1.0, *(float(gain.max()) for gain in gains.values())])
    for material in content.get("materials", []):
        if material["name"] in gains:
            factor = [*(gains[material["name"]] / scale).tolist(), 1.0]
            material.setdefault("pbrMetallicRoughness", {})["baseColorFactor"] = factor
    content["asset"]["extras"] = {"world_offset": offset.tolist(), "gain_scale": scale}
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    header = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    path.write_bytes(header + text + rest)


def _blend_job(path: Path) -> Job[Path]:
    """Write a copy of the scene's file."""
    yield Progress(0.0, f"Writing {path.name}")
    with _told(path, path.with_name(path.name + "@")), _no_old_version():
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=True)
    return path


@contextlib.contextmanager
def _told(path: Path, temporary: Path) -> Iterator[None]:
    """Turn what Blender or the system says of a failed write into a sentence; leave no half-written file."""
    try:
        yield
    except OSError as error:
        raise output_error(path, error) from error
    except RuntimeError as error:
        last = str(error).strip().splitlines()[-1].removeprefix("Error: ")
        raise OutputError(f"{path}: cannot be written: {last}") from error
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def _no_old_version() -> Iterator[None]:
    """Keep Blender from leaving the file of the run before as .blend1, and restore its preference after."""
    paths = bpy.context.preferences.filepaths
    before = paths.save_version
    paths.save_version = 0
    try:
        yield
    finally:
        paths.save_version = before


@contextlib.contextmanager
def _selected(context: bpy.types.Context, chosen: set[bpy.types.Object]) -> Iterator[None]:
    """Select exactly some objects, and restore the selection after."""
    before = [(obj, obj.select_get()) for obj in context.view_layer.objects]
    try:
        for obj, _ in before:
            obj.select_set(obj in chosen)
        yield
    finally:
        for obj, selected in before:
            obj.select_set(selected)


@contextlib.contextmanager
def _layer_shown(scene: bpy.types.Scene, layer: str) -> Iterator[None]:
    """Show a layer, for only what is shown is exported, and the one before after."""
    before = scene.fresco.layer
    if before == layer:
        yield
        return
    show_layer(scene, layer)
    try:
        yield
    finally:
        show_layer(scene, before)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the exporter's own chatter off the terminal."""
    with contextlib.redirect_stdout(io.StringIO()):
        level = logging.root.manager.disable
        logging.disable(logging.INFO)
        try:
            yield
        finally:
            logging.disable(level)
