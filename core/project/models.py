"""The models that a project asks for, of every layer: OBJ into the originals, baked atlas, vertex colours."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from ..jobs import Job, part
from ..scans.scan import Scan
from ..texture import write_obj_job
from .delivery import DeliverySettings, bake_job, colour_job, write_coloured_ply
from .digest import digest
from .entries import Project
from .repeated import textured_key, unchanged_job
from .store import Store
from .textures import TexturedScan


def output_path(project: Project, ending: str) -> Path:
    """Path of an output file, such as `output_path(project, ".glb")`."""
    return project.output.folder / (project.output.name + ending)


def layer_ending(layer: str, ending: str) -> str:
    """Ending of an output file of a layer: `layer_ending("infrared", ".obj")`."""
    return f"_{layer}{ending}" if layer else ending


def models_job(project: Project, scan: Scan, layers: Mapping[str, TexturedScan], store: Store) -> Job[None]:
    """Write what is asked for, but for what an earlier run has written from the same inputs."""
    jobs = [job for name in layers for job in _layer_jobs(project, scan, name, layers[name], store)]
    for number, job in enumerate(jobs):
        yield from part(job, number / len(jobs), (number + 1) / len(jobs))


def _layer_jobs(
    project: Project, scan: Scan, layer: str, textured: TexturedScan, store: Store
) -> Iterator[Job[Any]]:
    output, settings = project.output, project.atlas or DeliverySettings()
    key = digest(textured_key(textured), scan.offset)
    if output.obj:
        path = output_path(project, layer_ending(layer, ".obj"))
        yield unchanged_job(store, path, key, partial(_obj_job, path, textured, scan))
    if project.atlas is not None:
        name = output.name + layer_ending(layer, "_atlas")
        folder = output.folder / name
        bake = partial(bake_job, folder, name, textured, settings, scan.offset)
        yield unchanged_job(store, folder / f"{name}.obj", digest(key, settings), bake)
    if output.colours:
        path = output_path(project, layer_ending(layer, "_colours.ply"))
        colour = partial(_coloured_job, path, textured, settings, scan)
        yield unchanged_job(store, path, digest(key, settings), colour)


def _obj_job(path: Path, textured: TexturedScan, scan: Scan) -> Job[Path]:
    selection, views = textured.selection, textured.views
    return write_obj_job(path, textured.vertices, textured.faces, selection, views, scan.offset)


def _coloured_job(path: Path, textured: TexturedScan, settings: DeliverySettings, scan: Scan) -> Job[Path]:
    colours = yield from colour_job(textured, settings)
    return write_coloured_ply(path, textured, colours, scan.offset)
