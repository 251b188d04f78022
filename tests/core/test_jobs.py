import pytest
from fresco.core.jobs import Progress, drain, part


def counting(steps, log):
    try:
        for i in range(steps):
            yield Progress(i / steps, f"step {i}")
        return steps
    finally:
        log.append("cleaned")


def test_drain_returns_the_result_and_shows_every_step():
    seen, log = [], []
    assert drain(counting(3, log), seen.append) == 3
    assert [p.message for p in seen] == ["step 0", "step 1", "step 2"]
    assert log == ["cleaned"]


def test_closing_a_job_cleans_up():
    log = []
    job = counting(3, log)
    next(job)
    job.close()
    assert log == ["cleaned"]


def test_part_maps_fractions_into_the_longer_job_and_hands_on_the_result():
    seen = []

    def whole():
        return (yield from part(counting(2, []), 0.5, 1.0, "second: "))

    assert drain(whole(), seen.append) == 2
    assert [(p.fraction, p.message) for p in seen] == [(0.5, "second: step 0"), (0.75, "second: step 1")]


def test_closing_the_longer_job_closes_its_part():
    log = []
    job = part(counting(3, log), 0.0, 1.0)
    next(job)
    job.close()
    assert log == ["cleaned"]


def test_an_error_inside_a_part_reaches_the_caller():
    def failing():
        yield Progress(0.0, "start")
        raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        drain(part(failing(), 0.0, 1.0))
