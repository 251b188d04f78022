"""The command line: `fresco run project.toml`, and `blender --command fresco run project.toml`."""

from __future__ import annotations

import argparse
import os
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

from ..core.errors import FrescoError, ProjectError
from ..core.jobs import Job, Progress, drain, part
from ..core.project import (
    PhotoPose,
    Project,
    ProjectResult,
    Refinement,
    load_project,
    remarks,
    run_project_job,
)
from ..core.project.provenance import fresco_version
from . import cameras

DONE, FAILED, WRONG_PROJECT = 0, 1, 2
_BLENDER_MISSING = (
    "Fresco needs Blender's Python module to write .blend and .glb: install it with “pip install bpy”, or "
    "run “blender --command fresco run PROJECT”."
)
_DEFECT = (
    "This is a defect of Fresco, not of your project: please report it with the lines above. Finished stages "
    "are kept for the next run."
)
_LINE_STEP = 0.5  # s between two lines of progress of the same work


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command `fresco` and end the process with its exit code."""
    try:
        code = run_command(sys.argv[1:] if arguments is None else arguments, _start_blender)
    except Exception:
        traceback.print_exc()
        code = _stop(_DEFECT, FAILED)
    sys.stdout.flush()
    sys.stderr.flush()
    # Blender's module does not end by itself while anything is registered with it.
    os._exit(code)


def run_command(arguments: Sequence[str], start_blender: Callable[[], None]) -> int:
    """Run a command line; return the exit code: 0 done, 1 failed, 2 wrong project file or arguments."""
    try:
        options = _parser().parse_args(list(arguments))
    except SystemExit as stop:
        return int(stop.code or 0)
    return int(options.act(options, start_blender))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("fresco", description="Lay photographs onto laser scans.")
    parser.add_argument("--version", action="version", version=f"fresco {fresco_version()}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    run_parser = commands.add_parser("run", help="solve and texture a project, write what it asks for")
    run_parser.add_argument("project", help="project file (.toml)")
    run_parser.set_defaults(act=lambda options, start: run(Path(options.project), start))
    cameras.add_parser(commands)
    return parser


def run(path: Path, start_blender: Callable[[], None]) -> int:
    """Run a project file from its inputs to its outputs; see `run_command` for the exit code."""
    printer = ProgressPrinter()

    def work() -> None:
        project = load_project(path)
        printer.show(Progress(0.0, "Starting Blender"))
        start_blender()
        printer.end(drain(run_job(project), printer.show))

    return told(work)


def told(work: Callable[[], None]) -> int:
    """Do some work; say on one line what went wrong, and return the exit code."""
    try:
        work()
    except ProjectError as error:
        return _stop(str(error), WRONG_PROJECT)
    except FrescoError as error:
        return _stop(str(error), FAILED)
    except MemoryError:
        return _stop("There is not enough memory for this project.", FAILED)
    except KeyboardInterrupt:
        return _stop("Stopped.", FAILED)
    return DONE


def _stop(sentence: str, code: int) -> int:
    sys.stdout.flush()
    print(f"fresco: {sentence}", file=sys.stderr)
    return code


def run_job(project: Project) -> Job[ProjectResult]:
    """Solve, texture, show everything in a new scene, and write what the project asks for."""
    import bpy

    from ..core.project.repeated import are_unchanged, keep_unchanged, outputs_key
    from ..core.project.store import Store
    from ..core.report import project_report, write_report_job
    from .bridge.projects import previews_job, show_result
    from .outputs import Wanted, outputs_job
    from .preferences import preview_size

    versions = {"blender": bpy.app.version_string}
    result = yield from part(run_project_job(project, versions), 0.0, 0.8)
    output = project.output
    if result.scan.is_cloud:  # models need faces: the coloured points are written already
        if output.report:
            path = output.folder / f"{output.name}_report.html"
            yield from part(write_report_job(project_report(result), path), 0.8, 1.0)
        return result
    folder, layers = output.folder.resolve(), tuple(sorted(result.layers, key=lambda layer: layer != ""))
    models = tuple(model.path.stem for model in result.simplified.values())
    wanted = Wanted(folder, output.name, output.glb, False, output.report, output.blend, layers, models)
    store, key = Store(output.folder / "cache"), outputs_key(result.provenance)
    if are_unchanged(store, wanted.paths, key):
        yield Progress(1.0, "Everything is as the last run has written it")
        return result
    previews = yield from part(previews_job(result.project, preview_size(bpy.context)), 0.8, 0.85)
    yield Progress(0.85, "Building the scene")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    show_result(bpy.context, result, previews)
    yield from part(outputs_job(bpy.context, wanted, result.scan, project_report(result)), 0.87, 1.0)
    keep_unchanged(store, wanted.paths, key)
    return result


class ProgressPrinter:
    """Prints a line when the work changes, and now and then while it goes on."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._last_time = -_LINE_STEP
        self._last_message = ""

    def show(self, progress: Progress) -> None:
        """Print a step of a job, unless the same was just printed."""
        elapsed = time.perf_counter() - self._start
        if progress.message == self._last_message or elapsed - self._last_time < _LINE_STEP:
            return
        self._last_time, self._last_message = elapsed, progress.message
        self._print(progress.fraction, progress.message)

    def _print(self, fraction: float, message: str) -> None:
        minutes, seconds = divmod(time.perf_counter() - self._start, 60)
        print(f"{100 * fraction:3.0f} %  {int(minutes):2d}:{seconds:04.1f}  {message}", flush=True)

    def end(self, result: ProjectResult) -> None:
        """Print what became of every photo, what the user should know, and where the output is."""
        for pose in result.poses:
            print(f"  {pose.photo}: {describe(pose)}")
        for remark in remarks(result):
            print(f"  Note: {remark}")
        for name, layer in result.layers.items():
            if layer is not result.textured:
                print(f"  Layer {name}: {100 * layer.coverage:.1f} % of the surface covered")
        for name, chart in result.charts.items():
            print(f"  Colour chart{f' of {name}' if name else ''} in {chart.photo}: {chart.told}")
        for name, model in result.simplified.items():
            print(f"  Simplified model{f' of {name}' if name else ''}: {model.told}")
        folder = result.project.output.folder.resolve()
        told = [f"{100 * cloud.coverage:.1f} % of the points coloured" for cloud in result.clouds.values()]
        if result.textured is not None:
            told = [f"{100 * result.textured.coverage:.1f} % of the surface covered"]
        self._print(1.0, f"{', '.join(told)}; written to {folder}")


def describe(pose: PhotoPose) -> str:
    """Return a photo's result in words."""
    if not pose.solved:
        return f"not solved: {pose.failure}"
    parts = ["pose given"] if pose.given else []
    if pose.overlap_error is not None:
        parts.append(f"overlap error {pose.overlap_error:.2f} %")
    if pose.sure_pose is not None:
        parts.append(f"± {1000 * pose.pose.centre_sigma:.1f} mm, ± {pose.pose.rotation_sigma:.3f}°")
    return "; ".join([", ".join(parts), *(describe_step(step) for step in pose.refinements)])


def describe_step(step: Refinement) -> str:
    """Return in words what one step of refining did."""
    what, unit = {"edges": ("edges agree", ""), "joint": ("to other photos", " px")}[step.method]
    if not step.moved:
        return f"{what}: kept"
    return f"{what} {step.score_before:.2f} → {step.score_after:.2f}{unit}"


def _start_blender() -> None:
    """Import Blender's module and register the add-on in it, once."""
    try:
        import bpy
    except ImportError:
        raise FrescoError(_BLENDER_MISSING) from None
    if not hasattr(bpy.types.Scene, "fresco"):
        from . import register

        register()


def blender_command(arguments: Sequence[str]) -> int:
    """Run `blender --command fresco ARGUMENTS`; the add-on is registered already."""
    return run_command(arguments, lambda: None)
