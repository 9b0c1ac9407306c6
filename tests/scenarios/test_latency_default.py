"""The default against `--latency none` on bundled scenarios; in full: `python -m tests.studies.latency_default`."""

from __future__ import annotations

import pytest

from tests.studies.latency_default import one_run


@pytest.mark.parametrize(
    ("scenario", "seed"),
    [
        ("straight", 0),  # 108 +- 27 ms were found and applied: 1.02 m instead of 0.085 m
        ("straight", 1007),
        ("curve", 1001),
        ("rear-end", 6),  # 91 +- 46 ms: 1.24 m
        ("rear-end", 1007),  # 313 +- 40 ms: 4.4 m instead of 0.06 m
        ("city", 1002),
    ],
)
def test_default_is_not_worse_where_there_is_no_latency(scenario: str, seed: int) -> None:
    run = one_run(scenario, seed)
    assert run.applied_ms == {}
    assert not run.is_worse


def test_a_late_receiver_of_the_city_drive_is_found_and_corrected() -> None:
    run = one_run("city", 1000, ("sensors.gnss.latency_s=0.1",))
    assert run.applied_ms == {"position": pytest.approx(100.0, abs=20.0)}
    assert run.ratio < 0.3
