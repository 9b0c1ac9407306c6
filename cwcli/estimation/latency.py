"""What is known of each source's latency, and whose latency is looked for at all. The search: `latency_search`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.measurements import RATES, Kind
from cwcli.estimation.noise import MIN_ROWS_FOR_NOISE
from cwcli.estimation.passes import Series
from cwcli.estimation.sensor_limits import LATENCY
from cwcli.signals.columns import FloatArray

SIGNIFICANT_SIGMAS = 3.0
DRIFT_REACH_S = 150.0  # half of what is searched


class LatencyStatus(StrEnum):
    """What was made of a source's latency.

    Attributes:
        REFERENCE: The others' latencies are against this source.
        APPLIED: Found, clearly there, and corrected.
        DRIFTS: It changes along the log, and is corrected along a line.
        NOT_SIGNIFICANT: Found, but it may as well be zero: not corrected.
        NOT_OBSERVABLE: The log has too little in it to tell: not corrected.
        GIVEN: Corrected as the user said.
        CALIBRATED: Corrected as a calibration says, or as it and the log say together.
        CONTRADICTS: Found beyond what a sensor can be late by (`sensor_limits.LATENCY`): not corrected.
        OFF: Not looked for.
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


CORRECTED = (LatencyStatus.APPLIED, LatencyStatus.DRIFTS, LatencyStatus.GIVEN, LatencyStatus.CALIBRATED)


@dataclass(frozen=True)
class Latency:
    """One source's latency.

    Attributes:
        status: What was made of it.
        found_s: The value that was found or given, positive = late; NaN where there is none.
        sigma_s: One sigma of what was found (see `latency_evidence.Evidence.sigma_s`); NaN where nothing was.
        bound_s: The least sigma that any estimator without bias could have, by the filter's information about it; NaN
            where it was not looked for.
        drift: How much it grows in a second, seconds; 0 but for DRIFTS.
        middle_s: Stamp, since the epoch, at which it is `found_s` where it drifts.
    """

    status: LatencyStatus
    found_s: float = float("nan")
    sigma_s: float = float("nan")
    bound_s: float = float("nan")
    drift: float = 0.0
    middle_s: float = 0.0

    @property
    def applied_s(self) -> float:
        """What is taken off the stamps, seconds; where it drifts, in the middle."""
        return self.found_s if self.status in CORRECTED else 0.0

    @property
    def left_s(self) -> float:
        """One sigma of what the corrected stamps are still late by; infinite where nothing tells."""
        if self.status in (LatencyStatus.OFF, LatencyStatus.GIVEN, LatencyStatus.REFERENCE):
            return 0.0
        left_s = math.hypot(self.found_s - self.applied_s, self.sigma_s)
        return left_s if math.isfinite(left_s) else math.inf

    def drifted_s(self, time_s: FloatArray) -> FloatArray:
        """How much more than in the middle is taken off stamps (n,), seconds since the epoch.

        Farther from the middle than DRIFT_REACH_S it is held: the line was not found there.
        """
        return np.asarray(self.drift * np.clip(time_s - self.middle_s, -DRIFT_REACH_S, DRIFT_REACH_S))


def within_limits(latency: Latency) -> Latency:
    """The latency, not to be corrected where no sensor is late by so much."""
    found = latency.status in (LatencyStatus.APPLIED, LatencyStatus.DRIFTS)
    if not found or LATENCY.holds(latency.found_s):
        return latency
    return replace(latency, status=LatencyStatus.CONTRADICTS, drift=0.0)


def straightened(series: Series, latency: Latency) -> Series:
    """The series with its stamps as they would be if the latency stayed as it is in the middle."""
    return replace(series, time_s=series.time_s - latency.drifted_s(series.time_s)) if latency.drift else series


NO_LATENCY = Latency(LatencyStatus.OFF)


def given_latency(series: Series, config: EstimatorConfig) -> Latency | None:
    """The latency that the user gives for this source and kind, or for the source; None where there is none."""
    given: Mapping[str, float] = {} if isinstance(config.latency, str) else config.latency
    named = given.get(f"{series.source}:{series.kind.name.lower()}", given.get(series.source))
    return None if named is None else Latency(LatencyStatus.GIVEN, float(named))


def latency_roles(series: Sequence[Series], config: EstimatorConfig) -> list[Latency | None]:
    """Decide which series is the reference and which latency is given; None is to be found."""
    if config.latency == "none":
        return [NO_LATENCY for _ in series]
    roles: list[Latency | None] = []
    for s, is_reference in zip(series, references(series), strict=True):
        if (given := given_latency(s, config)) is not None:
            roles.append(given)
        elif is_reference:
            roles.append(Latency(LatencyStatus.REFERENCE))
        elif s.is_exact:
            roles.append(NO_LATENCY)
        elif len(s) < MIN_ROWS_FOR_NOISE:
            roles.append(Latency(LatencyStatus.NOT_OBSERVABLE))
        else:
            roles.append(None)
    return roles


def references(series: Sequence[Series]) -> list[bool]:
    """Which series the others are compared with: see `_reference`."""
    source, kinds = _reference(series)
    return [s.source == source and s.kind in kinds for s in series]


def _reference(series: Sequence[Series]) -> tuple[str, tuple[Kind, ...]]:
    """The IMU if there is one, else the speed (with a yaw rate of the same source), else the position."""
    for s in series:
        if s.bias_state >= 0 and len(s):
            return s.source, RATES
    for s in series:
        if s.kind is Kind.SPEED and len(s):
            return s.source, (Kind.SPEED, *RATES)
    for s in series:
        if s.kind in RATES and len(s):
            return s.source, RATES
    for s in series:
        if s.kind is Kind.POSITION and len(s):
            return s.source, (Kind.POSITION,)
    return "", ()
