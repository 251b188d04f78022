"""The job contract without a window: a step runs to its end, or leaves everything as it was."""

import bpy
import pytest


@pytest.fixture
def probe(context, module):
    """Register an operator whose job the test provides; yields the class."""
    jobs, errors = module("addon.jobs"), module("core.errors")
    progress = module("core.jobs").Progress

    class FRESCO_OT_test_probe(jobs.JobOperator):
        bl_idname = "fresco.test_probe"
        bl_label = "Probe"
        step = "scan"
        fail_with = None
        closed = False

        def start(self, context):
            return self.job()

        def job(self):
            try:
                for i in range(4):
                    yield progress(i / 4, f"Part {i}")
                if self.fail_with is not None:
                    raise self.fail_with
                return 42
            finally:
                type(self).closed = True

        def finish(self, context, result):
            context.scene["probe"] = result

    FRESCO_OT_test_probe.errors = errors
    bpy.utils.register_class(FRESCO_OT_test_probe)
    yield FRESCO_OT_test_probe
    bpy.utils.unregister_class(FRESCO_OT_test_probe)


def test_job_runs_to_its_end(probe, scene):
    assert bpy.ops.fresco.test_probe() == {"FINISHED"}
    assert scene["probe"] == 42
    assert probe.closed


def test_mendable_error_is_a_sentence_and_changes_nothing(probe, scene):
    probe.fail_with = probe.errors.ScanError("The scan is upside down: turn it over.")
    with pytest.raises(RuntimeError, match=r"The scan is upside down: turn it over\."):
        bpy.ops.fresco.test_probe()
    assert "probe" not in scene
    assert probe.closed
    status = bpy.context.window_manager.fresco_job
    assert status.error == "The scan is upside down: turn it over."
    assert status.error_step == "scan"
    assert not status.running

    probe.fail_with = None
    bpy.ops.fresco.test_probe()
    assert status.error == ""


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (MemoryError(), "not enough memory"),
        (OSError(28, "No space left on device", "/x/y.obj"), "/x/y.obj: No space"),
    ],
)
def test_the_machines_limits_are_sentences_too(probe, error, sentence):
    probe.fail_with = error
    with pytest.raises(RuntimeError, match=sentence):
        bpy.ops.fresco.test_probe()


def test_a_defect_is_not_hidden(probe, scene):
    probe.fail_with = ZeroDivisionError("a defect")
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        bpy.ops.fresco.test_probe()
    assert "probe" not in scene


def test_one_step_at_a_time(probe):
    status = bpy.context.window_manager.fresco_job
    status.running = True
    try:
        assert not bpy.ops.fresco.test_probe.poll()
        assert not bpy.ops.fresco.import_scan.poll()
    finally:
        status.running = False
    assert bpy.ops.fresco.test_probe.poll()


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.2, "1 s"), (59, "59 s"), (130, "2 min 10 s"), (3900, "1 h 05 min")]
)
def test_durations_read_as_a_person_says_them(module, seconds, text):
    assert module("addon.jobs").format_seconds(seconds) == text


def test_time_left_is_told_only_when_it_can_be(module):
    jobs = module("addon.jobs")
    assert jobs.time_left(0.5, 0.5) == ""
    assert jobs.time_left(10, 0.01) == ""
    assert jobs.time_left(10, 0.25) == "30 s left"
