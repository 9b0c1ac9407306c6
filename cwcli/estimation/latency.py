"""Latency of a source with its status, and which latencies are searched (by `latency_search`)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum

import numpy as np

from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, Kind
from cwcli.estimation.noise_matching import MIN_ROWS_FOR_NOISE
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.sensor_limits import LATENCY_RANGE
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import FloatArray

MIN_SIGNIFICANT_SIGMAS = 3.0
"""Least distance from zero, in sigmas, of a value that counts as significant. Chosen by hand; not fitted."""
MAX_DRIFT_EXTRAPOLATION_S = 150.0
"""Time from the middle up to which a drift is extrapolated, s: half of the window of the search."""

MS_PER_MINUTE_OF_UNIT_DRIFT = 6e4
"""Milliseconds per minute in a drift of one second per second."""


class LatencyStatus(StrEnum):
    """How the latency of a source was treated.

    Attributes:
        REFERENCE: The latencies of the others are relative to this source.
        APPLIED: Found, significant, and corrected.
        DRIFTS: It changes along the log, and is corrected along a line.
        NOT_SIGNIFICANT: Found, but not significantly different from zero: not corrected.
        NOT_OBSERVABLE: The log does not suffice to determine it: not corrected.
        GIVEN: Corrected by the user's value.
        CALIBRATED: Corrected by the value of a calibration, or by the mean of it and the log.
        CONTRADICTS: Found beyond what a sensor can be late by (`sensor_limits.LATENCY_RANGE`): not corrected.
        OFF: Not searched.
    """

    REFERENCE = "reference"
    APPLIED = "applied"
    DRIFTS = "drifts"
    NOT_SIGNIFICANT = "not significant"
    NOT_OBSERVABLE = "not observable"
    GIVEN = "given"
    CALIBRATED = "calibrated"
    CONTRADICTS = "contradicts"
    OFF = "off"


CORRECTED_LATENCY_STATUSES = (
    LatencyStatus.APPLIED,
    LatencyStatus.DRIFTS,
    LatencyStatus.GIVEN,
    LatencyStatus.CALIBRATED,
)
"""Statuses of latencies that are corrected."""


@dataclass(frozen=True)
class Latency:
    """One source's latency.

    Attributes:
        status: How it was treated.
        found_s: The value that was found or given, positive = late; NaN where there is none.
        sigma_s: One sigma of what was found (see `latency_evidence.LatencyEvidence.block_scatter_sigma_s`); NaN where
            nothing was.
        bound_s: The least sigma that any estimator without bias could have, by the filter's information about it; NaN
            where it was not looked for.
        reach_s: NOT_OBSERVABLE: one sigma of what it may be, by the scatter over the log, s; NaN where not known.
        drift: How much it grows in a second, seconds; 0 but for DRIFTS.
        middle_s: Stamp, since the epoch, at which it is `found_s` where it drifts.
    """

    status: LatencyStatus
    found_s: float = float("nan")
    sigma_s: float = float("nan")
    bound_s: float = float("nan")
    reach_s: float = float("nan")
    drift: float = 0.0
    middle_s: float = 0.0

    @property
    def applied_s(self) -> float:
        """Correction that is subtracted from the stamps, s; of a drift that in the middle."""
        return self.found_s if self.status in CORRECTED_LATENCY_STATUSES else 0.0

    @property
    def remaining_sigma_s(self) -> float:
        """One sigma of the remaining latency of the corrected stamps, s; infinite where unknown."""
        if self.status in (LatencyStatus.OFF, LatencyStatus.GIVEN, LatencyStatus.REFERENCE):
            return 0.0
        left_s = math.hypot(self.found_s - self.applied_s, self.sigma_s)
        return left_s if math.isfinite(left_s) else math.inf

    def drift_correction_s(self, time_s: FloatArray) -> FloatArray:
        """Return the correction (n,), s, relative to that in the middle, for stamps (n,), s since the epoch.

        It is constant farther from the middle than `MAX_DRIFT_EXTRAPOLATION_S`, beyond the window in which the line was
        found.
        """
        return np.asarray(
            self.drift * np.clip(time_s - self.middle_s, -MAX_DRIFT_EXTRAPOLATION_S, MAX_DRIFT_EXTRAPOLATION_S)
        )


def mark_latency_beyond_limits(latency: Latency) -> Latency:
    """Return the latency, marked as a contradiction and not corrected where no sensor can be so late."""
    found = latency.status in (LatencyStatus.APPLIED, LatencyStatus.DRIFTS)
    if not found or LATENCY_RANGE.contains_or_is_nan(latency.found_s):
        return latency
    return replace(latency, status=LatencyStatus.CONTRADICTS, drift=0.0)


def remove_latency_drift(series: SensorSeries, latency: Latency) -> SensorSeries:
    """Correct the stamps of a series for the drift, so that the remaining latency is constant."""
    return (
        replace(series, time_s=series.time_s - latency.drift_correction_s(series.time_s)) if latency.drift else series
    )


UNSEARCHED_LATENCY = Latency(LatencyStatus.OFF)
"""Latency that was not searched."""


def latency_given_by_user(series: SensorSeries, config: EstimatorConfig) -> Latency | None:
    """Return the latency that the user gave for this source and kind, or for the source; None where there is none."""
    latency_by_source: Mapping[str, float] = {} if isinstance(config.latency, str) else config.latency
    named = latency_by_source.get(f"{series.source}:{series.kind.name.lower()}", latency_by_source.get(series.source))
    return None if named is None else Latency(LatencyStatus.GIVEN, float(named))


def latencies_known_without_search(series: Sequence[SensorSeries], config: EstimatorConfig) -> list[Latency | None]:
    """Return for each series its latency if it is the reference, given or not observable; None if it is to be found."""
    if config.latency == "none":
        return [UNSEARCHED_LATENCY for _ in series]
    roles: list[Latency | None] = []
    for s, is_reference in zip(series, is_latency_reference_by_series(series), strict=True):
        if (given_latency_s := latency_given_by_user(s, config)) is not None:
            roles.append(given_latency_s)
        elif is_reference:
            roles.append(Latency(LatencyStatus.REFERENCE))
        elif s.is_exact:
            roles.append(UNSEARCHED_LATENCY)
        elif len(s) < MIN_ROWS_FOR_NOISE:
            roles.append(Latency(LatencyStatus.NOT_OBSERVABLE))
        else:
            roles.append(None)
    return roles


def is_latency_reference_by_series(series: Sequence[SensorSeries]) -> list[bool]:
    """Return for each series whether it is a reference of the others: see `_reference_source_and_kinds`."""
    source, kinds = _reference_source_and_kinds(series)
    return [s.source == source and s.kind in kinds for s in series]


def _reference_source_and_kinds(series: Sequence[SensorSeries]) -> tuple[str, tuple[Kind, ...]]:
    """Return source and kinds of the reference: the IMU, else the speed (with its yaw rate), else the position."""
    for s in series:
        if s.bias_state >= 0 and len(s):
            return s.source, KINDS_THAT_IMU_MEASURES_TOO
    for s in series:
        if s.kind is Kind.SPEED and len(s):
            return s.source, (Kind.SPEED, *KINDS_THAT_IMU_MEASURES_TOO)
    for s in series:
        if s.kind in KINDS_THAT_IMU_MEASURES_TOO and len(s):
            return s.source, KINDS_THAT_IMU_MEASURES_TOO
    for s in series:
        if s.kind is Kind.POSITION and len(s):
            return s.source, (Kind.POSITION,)
    return "", ()
