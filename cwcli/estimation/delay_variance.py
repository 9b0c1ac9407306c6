"""Variance of the states due to what is not known of the sources' delays.

A source that is late by e, and is not corrected for it, gives the state of e ago: its position lies v e behind, its
speed a e, its heading w e. All rows of a source have the same e, so that the filter does not average it out. How much
of that the states take up, and for how long, the filter itself shows: it runs again with the stamps of one source moved
by one sigma of its delay (`covariance_from_unknown_delays`). Beside a gyroscope what a bend adds to the heading lasts
for half a minute.

A clock of all sources that is off by e moves the whole state: the covariance grows by x' x'^T sigma^2 with the rate of
change x' of the state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cwcli.estimation.latency import Latency, LatencyStatus
from cwcli.estimation.measurements import Kind
from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries
from cwcli.estimation.sensor_limits import UNKNOWN_DELAY_SIGMA_IN_STAMP_SIGMAS, UNKNOWN_DELAY_SIGMA_S
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, StateCovariances, StateRows
from cwcli.signals.vehicle_state import ACCEL, HEADING, JERK, SPEED, YAW_ACCEL, YAW_RATE, X, Y

MEASUREMENT_KINDS_BY_STATE = {
    X: (Kind.POSITION,),
    SPEED: (Kind.SPEED, Kind.VELOCITY, Kind.POSITION),
    HEADING: (Kind.HEADING, Kind.YAW_RATE),
}
"""State -> kinds that show it, the first that a log has counts."""


@dataclass(frozen=True)
class DelaySigmas:
    """One sigma of what is not known of the delays, s.

    Attributes:
        position, speed, heading: Of the sources of each quantity.
        clock: Of the clock that the sources share.
    """

    position: float = 0.0
    speed: float = 0.0
    heading: float = 0.0
    clock: float = 0.0

    def elementwise_max(self, other: DelaySigmas) -> DelaySigmas:
        """Return the larger sigma of each quantity."""
        return DelaySigmas(
            max(self.position, other.position),
            max(self.speed, other.speed),
            max(self.heading, other.heading),
            max(self.clock, other.clock),
        )


def unknown_delay_sigma_s(latency: Latency, stamp_sigma_s: float = 0.0) -> float:
    """Return one sigma of what a source is still late by, s.

    It is 0 where the user trusts or gives the stamps, and of the reference, whose clock the states have. A value d
    with sigma s that is not corrected is combined with the prior p: its mean is d p^2 / (p^2 + s^2), its variance
    s^2 p^2 / (p^2 + s^2). One beyond what sensors have contradicts the prior, so that it counts as it is.

    Args:
        latency: The latency that was found.
        stamp_sigma_s: One sigma of the stamp errors, s. Where the delay varies its mean is not small.
    """
    prior_s = math.hypot(UNKNOWN_DELAY_SIGMA_S, UNKNOWN_DELAY_SIGMA_IN_STAMP_SIGMAS * stamp_sigma_s)
    if latency.status in (LatencyStatus.OFF, LatencyStatus.GIVEN, LatencyStatus.REFERENCE):
        return 0.0
    if latency.applied_s != 0.0 or latency.status is LatencyStatus.CALIBRATED:
        return latency.sigma_s if math.isfinite(latency.sigma_s) else 0.0
    if latency.status is LatencyStatus.CONTRADICTS:
        return math.hypot(latency.found_s, latency.sigma_s)
    sigma_s = latency.reach_s if latency.status is LatencyStatus.NOT_OBSERVABLE else latency.sigma_s
    if not math.isfinite(sigma_s) or sigma_s <= 0.0:
        return prior_s
    share = prior_s**2 / (prior_s**2 + sigma_s**2)
    found_s = latency.found_s if math.isfinite(latency.found_s) else 0.0
    return math.hypot(share * found_s, math.sqrt(share) * sigma_s)


def _stamp_sigma_s(s: SensorSeries) -> float:
    return s.stamp_error.value if s.stamp_error.status is ParameterStatus.USED else 0.0


def unphysical_lead_of_fixes_s(s: SensorSeries, latency: Latency) -> float:
    """Return how early the fixes of an unknown place on the car were taken for, s; else 0.

    No receiver sends a fix before it is measured. At an even speed fixes that seem early are those of an antenna ahead
    of the rear axle, and then right as they are.
    """
    is_found = latency.status in (LatencyStatus.APPLIED, LatencyStatus.DRIFTS)
    return max(-latency.applied_s, 0.0) if is_found and s.kind is Kind.POSITION and s.place_m is None else 0.0


def delay_sigmas_of_best_known_sources(
    series: Sequence[SensorSeries], latencies: Sequence[Latency], clock_sigma_s: float = 0.0
) -> DelaySigmas:
    """Return what is not known of the delays of each quantity, by its best known source."""
    found = {}
    for state, kinds in MEASUREMENT_KINDS_BY_STATE.items():
        of_kind = [
            [
                math.hypot(unknown_delay_sigma_s(latency, _stamp_sigma_s(s)), unphysical_lead_of_fixes_s(s, latency))
                for s, latency in zip(series, latencies, strict=True)
                if s.kind is kind and len(s) and not s.is_exact
            ]
            for kind in kinds
        ]
        found[state] = next((min(sigmas) for sigmas in of_kind if sigmas), 0.0)
    return DelaySigmas(found[X], found[SPEED], found[HEADING], clock_sigma_s)


def delay_sigmas_s(series: Sequence[SensorSeries], latencies: Sequence[Latency], min_sigmas: DelaySigmas) -> FloatArray:
    """Return one sigma of what is not known of the delay of each series (n,), s.

    Args:
        series, latencies: Parallel.
        min_sigmas: Least sigma of the sources of each quantity.
    """
    least_s = {Kind.POSITION: min_sigmas.position, Kind.SPEED: min_sigmas.speed, Kind.HEADING: min_sigmas.heading}
    return np.array(
        [
            max(
                math.hypot(unknown_delay_sigma_s(latency, _stamp_sigma_s(s)), unphysical_lead_of_fixes_s(s, latency)),
                least_s.get(s.kind, 0.0),
            )
            if len(s) and not s.is_exact and latency.status is not LatencyStatus.REFERENCE
            else 0.0
            for s, latency in zip(series, latencies, strict=True)
        ]
    )


def covariance_from_unknown_delays(
    series: Sequence[SensorSeries],
    sigmas_s: FloatArray,
    state: StateRows,
    estimate_states: Callable[[Sequence[SensorSeries]], StateRows],
    *,
    causal: bool,
) -> StateCovariances:
    """Return the covariance (m, 8, 8) of states (m, 8): how they change with the delay of each source.

    All quantities of one topic have one clock, so their stamps are moved together. No state moves by more than it
    changes in that time anywhere in the track, or before it: a row that the gate then rejects is no delay.

    Args:
        series: Series of one vehicle.
        sigmas_s: Shape (n,): one sigma of the delay of each series.
        state: The states as they are.
        estimate_states: Estimates the states from other series.
        causal: No later state may count.
    """
    grown = np.zeros((len(state), N_MOTION_STATES, N_MOTION_STATES))
    rate = np.abs(np.nan_to_num(_state_changes_per_second(state)))
    rate[:, X] = rate[:, Y] = np.hypot(rate[:, X], rate[:, Y])
    rate = np.maximum.accumulate(rate) if causal else rate.max(axis=0, initial=0.0)
    for source in dict.fromkeys(s.source for s in series):
        own_s = [sigma if s.source == source else 0.0 for s, sigma in zip(series, sigmas_s.tolist(), strict=True)]
        if not any(own_s):
            continue
        moved_series = [replace(s, latency_s=s.latency_s - sigma_s) for s, sigma_s in zip(series, own_s, strict=True)]
        most = max(own_s) * rate
        change = np.clip(np.nan_to_num(estimate_states(moved_series) - state), -most, most)
        grown += change[:, :, None] * change[:, None, :]
    return grown


def covariance_from_clock_error(state: StateRows, sigma_s: float) -> StateCovariances:
    """Return the covariance (m, 8, 8) that a clock of all sources adds to states (m, 8), with one sigma of it, s."""
    rate = _state_changes_per_second(state)
    return np.asarray(sigma_s**2 * rate[:, :, None] * rate[:, None, :])


def _state_changes_per_second(state: StateRows) -> StateRows:
    """Return the change of each state in a second, (m, 8); 0 of the highest derivatives."""
    speed, heading = state[:, SPEED], state[:, HEADING]
    rate = np.zeros((len(state), N_MOTION_STATES))
    rate[:, X], rate[:, Y] = speed * np.cos(heading), speed * np.sin(heading)
    rate[:, SPEED], rate[:, HEADING] = state[:, ACCEL], state[:, YAW_RATE]
    rate[:, ACCEL], rate[:, YAW_RATE] = state[:, JERK], state[:, YAW_ACCEL]
    return rate
