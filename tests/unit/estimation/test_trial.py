"""Trials of the parameter searches: each pass is run once, and is the pass that the filter runs without them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, Kind, estimate_track
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.noise import estimate_noise_and_manoeuvres
from cwcli.estimation.parameter import Parameter
from cwcli.estimation.passes import FilterStart, PassInput, SensorSeries, run_filter_pass
from cwcli.estimation.sensor_model import StateLayout
from cwcli.estimation.start import find_full_filter_start
from cwcli.estimation.trial import (
    N_REMEMBERED_PASSES,
    RESET_AFTER_REJECTIONS_IN_SEARCH,
    FilterTrials,
    cut_to_window,
    with_outlier_gate,
)
from cwcli.kernels import ekf
from tests.studies.city_drive import city_drive, measure

SPEED_MPS = 10.0


@pytest.fixture
def passes(monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """Innovations and last state of every pass that is run, in its order."""
    found: list[bytes] = []
    run = PassInput.run_filter

    def record(self: PassInput, start: FilterStart, motion: ekf.ProcessModel, *, smooth: bool) -> ekf.Pass:
        result = run(self, start, motion, smooth=smooth)
        found.append(result.nis.tobytes() + result.last_state.tobytes() + bytes([smooth]))
        return result

    monkeypatch.setattr(PassInput, "run_filter", record)
    return found


def straight_drive() -> StateLayout:
    """Fixes at 10 Hz and a speed at 5 Hz of a car that drives east at 10 m/s, 0.5 m and 0.2 m/s of noise."""
    rng = np.random.default_rng(0)
    fix_s, speed_s = np.arange(0.0, 20.0, 0.1), np.arange(0.05, 20.0, 0.2)
    xy = np.stack([SPEED_MPS * fix_s, 0.0 * fix_s], axis=1) + 0.5 * rng.standard_normal((200, 2))
    speed = np.stack([SPEED_MPS + 0.2 * rng.standard_normal(100), np.zeros(100)], axis=1)
    series = [
        SensorSeries("/gps", Kind.POSITION, fix_s, xy, np.tile([0.25, 0.0, 0.25], (200, 1))),
        SensorSeries("/speed", Kind.SPEED, speed_s, speed, np.tile([0.04, 0.0, 0.0], (100, 1))),
    ]
    return StateLayout(series, MotionParameters(), np.zeros(8), np.zeros(8))


def with_latency(layout: StateLayout, latency_s: float) -> StateLayout:
    return replace(layout, series=[replace(layout.series[0], latency_s=latency_s), layout.series[1]])


def test_a_trial_is_the_pass_of_the_filter() -> None:
    layout = straight_drive()
    trials = FilterTrials()
    for trial in (
        layout,
        with_latency(layout, 0.3),
        layout,
        replace(layout, parameters=MotionParameters(course_rad=0.1)),
    ):
        start = find_full_filter_start(trial.series, trial.prior, causal=False)
        motion = trial.parameters.to_process_model(trial.walk)
        alone = run_filter_pass(
            trial.series, start, motion, np.zeros(0), smooth=False, reset_after=RESET_AFTER_REJECTIONS_IN_SEARCH
        )
        found = trials.run_filter(trial)
        for one, other in zip(found.nis, alone.nis, strict=True):
            np.testing.assert_array_equal(one, other)
        assert trials.log_likelihood(trial) == found.log_likelihood == alone.log_likelihood


def test_an_equal_trial_is_not_run_again(passes: list[bytes]) -> None:
    layout = straight_drive()
    trials = FilterTrials()
    first = trials.run_filter(layout)
    again = replace(layout, series=[s.scale_noise_variance(1.0) for s in layout.series], walk=layout.walk.copy())
    assert trials.run_filter(again) is first
    assert trials.log_likelihood(with_latency(layout, 0.0)) == first.log_likelihood
    assert len(passes) == 1


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda s: replace(s, latency_s=0.1), id="latency"),
        pytest.param(lambda s: s.scale_noise_variance(2.0), id="noise"),
        pytest.param(lambda s: replace(s, values=s.values + 1.0), id="values"),
        pytest.param(lambda s: replace(s, stamp_error=Parameter(0.05)), id="stamp error"),
        pytest.param(lambda s: replace(s, place_m=(1.0, 0.5)), id="place"),
        pytest.param(lambda s: replace(s, gate_nis=0.1), id="gate"),
        pytest.param(lambda s: s.select_rows(s.time_s > 10.0), id="rows"),
    ],
)
def test_another_series_is_another_trial(passes: list[bytes], change: Callable[[SensorSeries], SensorSeries]) -> None:
    layout = straight_drive()
    trials = FilterTrials()
    trials.run_filter(layout)
    trials.run_filter(replace(layout, series=[change(layout.series[0]), layout.series[1]]))
    assert len(passes) == len(set(passes)) == 2


def test_another_motion_model_is_another_trial(passes: list[bytes]) -> None:
    layout = straight_drive()
    trials = FilterTrials()
    trials.run_filter(layout)
    trials.run_filter(replace(layout, parameters=replace(layout.parameters, jerk_sigma_mps3=4.0)))
    assert len(passes) == len(set(passes)) == 2


def test_what_is_remembered_stays_small(passes: list[bytes]) -> None:
    """After as many other trials as are remembered the first one is run again; the last of them is not."""
    layout = straight_drive()
    trials = FilterTrials()
    for k in range(N_REMEMBERED_PASSES + 1):
        trials.run_filter(with_latency(layout, 0.01 * k))
    trials.run_filter(with_latency(layout, 0.01 * N_REMEMBERED_PASSES))
    assert len(passes) == N_REMEMBERED_PASSES + 1
    trials.run_filter(layout)
    assert len(passes) == N_REMEMBERED_PASSES + 2
    assert passes[-1] == passes[0]


def test_the_windows_ends_are_inside_and_latencies_count() -> None:
    s = replace(straight_drive().series[0], time_s=np.arange(200) / 8.0, latency_s=0.25)
    assert cut_to_window(s, 1.0, 2.0).time_s.tolist() == [1.25 + k / 8.0 for k in range(9)]
    assert cut_to_window(s, -9.0, 99.0) is s


def test_the_searchs_gate_is_the_chi_square_quantile() -> None:
    """Of two degrees of freedom it is -2 log(1 - p): 23.026 at 1 - 1e-5; of one 19.511 (standard tables)."""
    position, speed = (with_outlier_gate(s) for s in straight_drive().series)
    assert position.gate_nis == pytest.approx(-2.0 * np.log(1e-5), rel=1e-6)
    assert speed.gate_nis == pytest.approx(19.511, abs=1e-3)


def test_noise_of_a_known_layout_is_not_fitted_again(passes: list[bytes]) -> None:
    layout = straight_drive()
    fits: dict[Any, Any] = {}
    rough = estimate_noise_and_manoeuvres(layout, every_row=False, known_fits=fits)
    n_rough = len(passes)
    again = estimate_noise_and_manoeuvres(layout, every_row=False, known_fits=fits)
    assert len(passes) == n_rough
    assert again.parameters == rough.parameters
    for one, other in zip(again.series, rough.series, strict=True):
        np.testing.assert_array_equal(one.noise, other.noise)


def test_no_pass_of_an_estimate_is_run_twice(passes: list[bytes]) -> None:
    """Ninety seconds are searched for latencies, noise, stamp errors and sensor errors."""
    estimate_track(measure(city_drive(1, 90.0), 1, {}), EstimatorConfig())
    assert len(passes) > 50
    assert len(set(passes)) == len(passes)
