"""The models that a project asks for, of every layer: OBJ into the originals, baked atlas, vertex colours."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ...arrays import AnyArray
from ...jobs import Job, part
from ...scans.scan import Scan
from ...texture import write_obj_job
from ...texture.colour.correction import ColourCorrection
from ..digest import digest
from ..entries import Project
from ..repeated import textured_key, unchanged_job
from ..store import Store
from .colour_chart import ChartResult, correction_for
from .delivery import DeliverySettings, bake_job, colour_job, write_coloured_ply
from .simplified import SimplifiedModel, model_arrays, model_from_arrays, simplified_job
from .textures import TexturedScan


def output_path(project: Project, ending: str) -> Path:
    """Path of an output file, such as `output_path(project, ".glb")`."""
    return project.output.folder / (project.output.name + ending)


def layer_ending(layer: str, ending: str) -> str:
    """Ending of an output file of a layer: `layer_ending("infrared", ".obj")`."""
    return f"_{layer}{ending}" if layer else ending


def models_job(
    project: Project,
    scan: Scan,
    layers: Mapping[str, TexturedScan],
    store: Store,
    charts: Mapping[str, ChartResult] | None = None,
    occluders: Sequence[Scan] = (),
) -> Job[dict[str, SimplifiedModel]]:
    """Write what is asked for, but for what an earlier run has written from the same inputs.

    Returns the simplified model of every layer, if such are wanted.
    """
    corrections = _corrections(project, layers, charts or {})
    jobs = [
        job
        for name in layers
        for job in _layer_jobs(project, scan, name, layers[name], store, corrections.get(name))
    ]
    end = 0.5 if project.simplify is not None else 1.0
    for number, job in enumerate(jobs):
        yield from part(job, end * number / len(jobs), end * (number + 1) / len(jobs))
    found: dict[str, SimplifiedModel] = {}
    for number, (name, textured) in enumerate(layers.items()):
        if project.simplify is not None:
            simplified = _simplified_job(
                project, scan, name, textured, store, occluders, corrections.get(name)
            )
            start, stop = (end + (1 - end) * (number + k) / len(layers) for k in (0, 1))
            found[name] = yield from part(simplified, start, stop, "Simplified model: ")
    return found


def _corrections(
    project: Project, layers: Mapping[str, TexturedScan], charts: Mapping[str, ChartResult]
) -> dict[str, ColourCorrection]:
    entries = {entry.layer: entry for entry in project.charts if entry.layer in layers}
    return {layer: correction_for(charts[layer], entry, layers[layer]) for layer, entry in entries.items()}


def _simplified_job(
    project: Project,
    scan: Scan,
    layer: str,
    textured: TexturedScan,
    store: Store,
    occluders: Sequence[Scan],
    correction: ColourCorrection | None,
) -> Job[SimplifiedModel]:
    """Return the simplified model of a layer, made or as the last run has left it."""
    assert project.simplify is not None
    settings, offset = project.atlas or DeliverySettings(), scan.offset
    name = project.output.name + layer_ending(layer, "_simplified")
    path = project.output.folder / name / f"{name}.obj"
    priority = {entry.photo.name: entry.priority for entry in project.photos}
    make = partial(
        simplified_job,
        path.parent,
        name,
        (scan.vertices, scan.faces),
        textured,
        project.simplify,
        replace(project.texture, gain_anchor=None),
        settings,
        offset,
        [(other.vertices, other.faces) for other in occluders if not other.is_cloud],
        correction,
        [priority.get(view.name, 0.0) for view in textured.views],
    )
    key = digest(textured_key(textured), offset, settings, project.simplify, _numbers(correction))
    kept = f"simplified-{digest(layer)[:12]}"
    yield from unchanged_job(store, path, key, partial(_kept_job, make, store, kept, key))
    arrays = store.load_arrays(kept, key)
    if arrays is None:
        arrays = yield from _kept_job(make, store, kept, key)
    return model_from_arrays(path, arrays)


def _kept_job(
    make: Callable[[], Job[SimplifiedModel]], store: Store, name: str, key: str
) -> Job[dict[str, AnyArray]]:
    model = yield from make()
    arrays = model_arrays(model)
    store.save_arrays(name, key, arrays)
    return arrays


def _numbers(correction: ColourCorrection | None) -> AnyArray | tuple[()]:
    return () if correction is None else correction.coefficients


def _layer_jobs(
    project: Project,
    scan: Scan,
    layer: str,
    textured: TexturedScan,
    store: Store,
    correction: ColourCorrection | None,
) -> Iterator[Job[Any]]:
    output, settings = project.output, project.atlas or DeliverySettings()
    key = digest(textured_key(textured), scan.offset)
    corrected = digest(key, settings, _numbers(correction))
    if output.obj:
        path = output_path(project, layer_ending(layer, ".obj"))
        yield unchanged_job(store, path, key, partial(_obj_job, path, textured, scan))
    if project.atlas is not None:
        name = output.name + layer_ending(layer, "_atlas")
        folder = output.folder / name
        bake = partial(bake_job, folder, name, textured, settings, scan.offset, None, correction)
        yield unchanged_job(store, folder / f"{name}.obj", corrected, bake)
    if output.colours:
        path = output_path(project, layer_ending(layer, "_colours.ply"))
        colour = partial(_coloured_job, path, textured, settings, scan, correction)
        yield unchanged_job(store, path, corrected, colour)


def _obj_job(path: Path, textured: TexturedScan, scan: Scan) -> Job[Path]:
    selection, views = textured.selection, textured.views
    return write_obj_job(path, textured.vertices, textured.faces, selection, views, scan.offset)


def _coloured_job(
    path: Path,
    textured: TexturedScan,
    settings: DeliverySettings,
    scan: Scan,
    correction: ColourCorrection | None,
) -> Job[Path]:
    colours = yield from colour_job(textured, settings, correction)
    return write_coloured_ply(path, textured, colours, scan.offset)
