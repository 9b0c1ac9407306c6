"""The second half of zhang2011: the worked example, figures 14 to 16, and figures 17 to 19 on a few seeds."""

import numpy as np
import pytest

from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.observer import observe
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.reproduction.findings import Finding
from cwcli.reproduction.zhang2011.drives import DRIVES, drive_part
from cwcli.reproduction.zhang2011.motion import example_part, observers, run_errors, run_part, run_table
from cwcli.simulation.single_track import PAPER_RUNS, simulate_paper_run

CAR = load_vehicle()


def failed(findings: tuple[Finding, ...]) -> list[str]:
    return [f"{each.what}: {each.ours:.4g}" for each in findings if each.has_failed]


def test_the_worked_example() -> None:
    assert failed(example_part().findings) == []


@pytest.mark.parametrize("figure", PAPER_RUNS)
def test_simulated_runs(figure: str) -> None:
    part = run_part(figure)
    assert failed(part.findings) == []
    assert [len(curve.x) for curve in part.plots[0].curves] == [len(part.plots[0].curves[0].x)] * 6


@pytest.mark.parametrize("start", ["turning", "straight"])
@pytest.mark.parametrize("figure", PAPER_RUNS)
def test_static_errors_and_convergence_whatever_the_start(figure: str, start: str) -> None:
    settings = PAPER_RUNS[figure]
    run = simulate_paper_run(settings, CAR, start=start)  # type: ignore[arg-type]
    bound = 3.0 if settings.load == "half" else 10.0
    found = {
        name: run_errors(run, observe(run.lanes, run.speed, *chosen))
        for name, chosen in observers(settings, CAR).items()
    }
    assert max(found["zhang2011"].static_percent) < bound
    assert max(found["zhang2011"].converged_s) <= 1.0
    for k in range(2):
        assert found["cwcli"].static_percent[k] <= max(found["zhang2011"].static_percent[k], 0.05)
    if settings.load == "full":
        assert max(found["cwcli, told half load, estimates the load"].static_percent) < 5.0


def test_the_other_reading_of_the_noise_also_settles() -> None:
    run = simulate_paper_run(PAPER_RUNS["fig 14"], CAR)
    track = observe(run.lanes, run.speed, CAR, ObserverConfig("zhang2011", noise_reading="discrete"))
    assert max(run_errors(run, track).static_percent) < 3.0


def test_a_run_as_a_table() -> None:
    table = run_table("fig 14")
    assert len(table) == 51
    row = table.records()[-1]
    assert row["zhang2011_yaw_rate_radps"] == pytest.approx(row["yaw_rate_radps"], rel=0.01)
    assert row["yaw_rate_radps"] == pytest.approx(2.0 * 0.41463, abs=1e-3)  # twice the worked example's angle


def test_the_linear_runs_are_exact() -> None:
    coarse, fine = (
        simulate_paper_run(PAPER_RUNS["fig 16"].__class__("x", "full", 0.01, 80.0, 80.0, step_s=step), CAR)
        for step in (0.05, 0.01)
    )
    np.testing.assert_allclose(coarse.state, fine.state, atol=1e-9)


@pytest.mark.parametrize("figure", DRIVES)
def test_drives(figure: str) -> None:
    assert failed(drive_part(figure, 3).findings) == []
