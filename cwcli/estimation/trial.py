"""Trials of a parameter search: the filter runs over the rows of a window, once for each set of parameters.

All searches of the estimator work in the same five steps, and take them from here: cut the rows to a window, average
what comes often, gate or drop outliers, let the noise agree with the innovations, and score the pass. What is tried is
a `StateLayout`: series with their stamps and noise, a motion model, and the parameter states.

No pass is run twice. Series are never changed in place, so that two trials are equal where their arrays are the same
objects and their numbers are equal; a trial that was run a moment ago is answered from memory. Trials with the same
series share their start and their time order, and those with the same stamps their time order.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Generic, TypeVar

import numpy as np

from cwcli.estimation.passes import (
    FilterStart,
    PassInput,
    PassResult,
    RowTimeOrder,
    SensorSeries,
    build_pass_input,
)
from cwcli.estimation.score import INNOVATION_CAP_PROBABILITY
from cwcli.estimation.sensor_model import StateLayout
from cwcli.estimation.start import find_full_filter_start
from cwcli.kernels import ekf
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.metrics.chi_square import nis_gate_limit
from cwcli.work_share import count_and_show_finished_work

SEARCH_PROGRESS_UNIT_NAME = "passes of the filter"
"""The unit in which the searches report their progress."""
USUAL_PASSES_PER_SEARCH = 70.0
"""Passes of the filter that one search usually takes; measured on the scenario `city`. Only the progress that is shown
depends on it."""
N_REMEMBERED_PASSES = 6
"""Number of passes whose results are kept. Chosen: a search returns to one of its last three trials or to none."""
N_REMEMBERED_ROW_TIME_ORDERS = 4
"""Number of time orders that are kept. Chosen: a search compares at most three latencies in turn."""
RESET_AFTER_REJECTIONS_IN_SEARCH = 50
"""Rejections in a row after which a source is used again during a search. Chosen above that of the final pass."""
MAX_NOISE_MATCHINGS = 3
"""Greatest number of rounds of innovation matching per trial. Chosen for speed; not fitted."""
MAX_NOISE_FACTOR_AT_CONVERGENCE = 1.1
"""The noise of a trial has converged when its factor differs from 1 by less than this factor. Chosen by hand."""

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


class _RecentValues(Generic[Key, Value]):
    """The last few values by their keys, with the series whose identities stand in the keys."""

    def __init__(self, n_kept: int) -> None:
        self._n_kept = n_kept
        self._values: dict[Key, tuple[Value, Sequence[SensorSeries]]] = {}

    def find_value(self, key: Key) -> Value | None:
        """Return the value, which then counts as the newest; None where it is not remembered."""
        known = self._values.pop(key, None)
        if known is None:
            return None
        self._values[key] = known
        return known[0]

    def remember_value(self, key: Key, value: Value, series: Sequence[SensorSeries]) -> None:
        """Keep a value; the oldest one goes where there are too many."""
        self._values[key] = value, series
        if len(self._values) > self._n_kept:
            del self._values[next(iter(self._values))]


@dataclass
class _TrialPass:
    """A pass that was run, and its result by series once that was asked for."""

    prepared: PassInput
    found: ekf.Pass
    result: PassResult | None = None

    def result_by_series(self) -> PassResult:
        """Return the result with its innovations split by series."""
        if self.result is None:
            self.result = self.prepared.split_result_by_series(self.found)
        return self.result


class FilterTrials:
    """Passes of the filter for the trials of one search."""

    def __init__(self, start: FilterStart | None = None, *, start_position_sigma_m: float | None = None) -> None:
        """Begin with nothing remembered.

        Args:
            start: Start of every pass; None: that which the series of each trial show.
            start_position_sigma_m: One sigma of the start's position (m); None: that of the first position.
        """
        self._start, self._start_position_sigma_m = start, start_position_sigma_m
        self._passes: _RecentValues[Hashable, _TrialPass] = _RecentValues(N_REMEMBERED_PASSES)
        self._inputs: _RecentValues[Hashable, tuple[FilterStart, PassInput]] = _RecentValues(1)
        self._inputs_of_any_noise: _RecentValues[Hashable, PassInput] = _RecentValues(N_REMEMBERED_ROW_TIME_ORDERS)
        self._orders: _RecentValues[Hashable, RowTimeOrder] = _RecentValues(N_REMEMBERED_ROW_TIME_ORDERS)

    def run_filter(self, trial: StateLayout) -> PassResult:
        """Return the filter's result over all rows of a trial; it has no output states."""
        return self._find_or_run(trial).result_by_series()

    def log_likelihood(self, trial: StateLayout) -> float:
        """Return the log-likelihood of the rows that the filter uses."""
        return self._find_or_run(trial).found.log_likelihood

    def reuse_pass_of_known_trial(self, trial: StateLayout, known_trial: StateLayout) -> None:
        """Answer a trial with the pass of a known one, because its gate rejected nothing and is all that differs."""
        self._passes.remember_value(trial_key(trial), self._find_or_run(known_trial), trial.series)

    def _find_or_run(self, trial: StateLayout) -> _TrialPass:
        key = trial_key(trial)
        if (known := self._passes.find_value(key)) is not None:
            return known
        start, prepared = self._find_start_and_build_pass_input(trial)
        motion = trial.parameters.to_process_model(trial.walk)
        found = _TrialPass(prepared, prepared.run_filter(start, motion, smooth=False))
        self._passes.remember_value(key, found, trial.series)
        count_and_show_finished_work(SEARCH_PROGRESS_UNIT_NAME)
        return found

    def _find_start_and_build_pass_input(self, trial: StateLayout) -> tuple[FilterStart, PassInput]:
        key = *_series_keys(trial.series), trial.prior.tobytes()
        if (known := self._inputs.find_value(key)) is not None:
            return known
        start = self._start or find_full_filter_start(trial.series, trial.prior, causal=False)
        if self._start_position_sigma_m is not None:
            start.covariance[0, 0] = start.covariance[1, 1] = self._start_position_sigma_m**2
        rows = *map(_key_of_series_without_noise, trial.series), start.time_s
        if (like := self._inputs_of_any_noise.find_value(rows)) is not None:
            prepared = like.replace_noise(trial.series)
        else:
            prepared = self._order_rows_and_build_pass_input(trial.series, start.time_s)
        self._inputs_of_any_noise.remember_value(rows, prepared, trial.series)
        self._inputs.remember_value(key, (start, prepared), trial.series)
        return start, prepared

    def _order_rows_and_build_pass_input(self, series: Sequence[SensorSeries], start_s: float) -> PassInput:
        times = *((id(s.time_s), s.latency_s, s.kind, s.interval_s) for s in series), start_s
        prepared = build_pass_input(
            series,
            start_s,
            np.zeros(0),
            reset_after=RESET_AFTER_REJECTIONS_IN_SEARCH,
            time_order=self._orders.find_value(times),
        )
        self._orders.remember_value(times, prepared.time_order, series)
        return prepared


def trial_key(trial: StateLayout) -> Hashable:
    """Return what two equal trials have in common; it holds while the arrays of the trial live."""
    return (
        *_series_keys(trial.series),
        trial.parameters.hashable_key_of_equal_parameters,
        trial.walk.tobytes(),
        trial.prior.tobytes(),
    )


def _series_keys(series: Sequence[SensorSeries]) -> tuple[Hashable, ...]:
    return tuple([_series_key(s) for s in series])


def _series_key(s: SensorSeries) -> Hashable:
    """Return what tells a series from others."""
    return id(s.noise), s.noise_origin, _key_of_series_without_noise(s)


def _key_of_series_without_noise(s: SensorSeries) -> Hashable:
    """Return what tells a series from those with other rows; written out, as it is made some thousand times a log."""
    return (
        id(s.time_s), id(s.values), id(s.pitch_rate), s.source, s.kind, s.latency_s, s.stamp_error, s.place_m,
        s.gate_nis, s.floor, s.bias_state, s.latency_state, s.slow_state, s.scale_state, s.lever_state, s.ahead_state,
        s.interval_s, s.is_exact,
    )  # fmt: skip


def with_outlier_gate(s: SensorSeries) -> SensorSeries:
    """Return the series with the gate of a search, which rejects only what no noise explains."""
    return replace(s, gate_nis=nis_gate_limit(INNOVATION_CAP_PROBABILITY, s.n_values_per_row))


def cut_to_window(s: SensorSeries, begin_s: float, end_s: float) -> SensorSeries:
    """Return the rows that were measured in a window, both ends included."""
    measured_s = s.time_s - s.latency_s
    return s.select_rows((measured_s >= begin_s) & (measured_s <= end_s))
