"""What was found of the sources against what such sensors can be: the last check, of the estimate's own numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from cwcli.estimation.contradiction import Contradiction, Quantity
from cwcli.estimation.latency import LatencyStatus
from cwcli.estimation.measurements import RATES, Kind
from cwcli.estimation.parameter import Parameter, ParameterStatus
from cwcli.estimation.result import SourceReport
from cwcli.estimation.sensor_limits import (
    ACCEL_BIAS,
    LATENCY,
    STAMP_SIGMA,
    WHITE_NOISE,
    YAW_RATE_BIAS,
    Limit,
    limit_of_error,
)
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

CAR = "how a car moves"
"""What a source without another one beside it contradicts."""


def beyond_limits(reports: Sequence[SourceReport], known: Sequence[Contradiction] = ()) -> tuple[Contradiction, ...]:
    """The sources of which something was found that no such sensor has.

    Args:
        reports: Of one vehicle's sources.
        known: What is told already: of these sources nothing is told again.
    """
    told = {quantity for each in known for quantity in (each.who, each.against)}
    found = []
    for report in reports:
        who = Quantity(report.source, report.kind)
        words = next(iter(_words(report)), None)
        if words is not None and who not in told:
            found.append(Contradiction(who, _reference_of(report, reports), words))
    return tuple(found)


def is_bias_possible(report: SourceReport) -> bool:
    """Whether a sensor can have the bias that was found; an accelerometer's has gravity through its mount in it."""
    if report.kind is Kind.YAW_RATE:
        return YAW_RATE_BIAS.holds(report.bias)
    mounted = 0.0 if report.mounting is None else STANDARD_GRAVITY_MPS2 * math.sin(report.mounting.nose_up_rad)
    return ACCEL_BIAS.holds(report.bias - mounted)


def _words(report: SourceReport) -> Iterator[str]:
    """What no such sensor has, one thing after the other."""
    if not is_bias_possible(report):
        limit = YAW_RATE_BIAS if report.kind is Kind.YAW_RATE else ACCEL_BIAS
        yield _beyond("a bias", report.bias, limit)
    for name, part, parameter in (
        ("a scale", "scale", report.scale),
        ("a lever arm", "lever", report.lever_arm_m),
        ("a place ahead", "ahead", report.ahead_m),
    ):
        limit = limit_of_error(part, report.kind)
        if parameter.status is ParameterStatus.CONTRADICTS or _is_beyond(parameter, limit):
            yield _beyond(name, parameter.value, limit)
    if report.stamp_error.status is ParameterStatus.CONTRADICTS:
        yield f"its stamps err by more than {STAMP_SIGMA.high:g} s from row to row"
    if report.slow_error.status is ParameterStatus.CONTRADICTS:
        yield _beyond("a slow error", report.slow_error.sigma, limit_of_error("slow", report.kind))
    if report.latency.status is LatencyStatus.CONTRADICTS:
        yield _beyond("a latency", report.latency.found_s, LATENCY)
    if report.kind in WHITE_NOISE and not WHITE_NOISE[report.kind].holds(report.sigma) and report.n_used:
        yield _beyond("white noise", report.sigma, WHITE_NOISE[report.kind])


def _is_beyond(parameter: Parameter, limit: Limit) -> bool:
    """Whether a parameter that is used is one that no such sensor has; one that was given is the user's."""
    return parameter.status is ParameterStatus.USED and not limit.holds(parameter.value)


def _beyond(name: str, value: float, limit: Limit) -> str:
    unit = f" {limit.unit}" if limit.unit else ""
    bound = limit.high if value >= limit.high else limit.low
    return f"together they need {name} of {value:.3g}{unit}, and such a sensor has at most {bound:g}{unit}"


def _reference_of(report: SourceReport, reports: Sequence[SourceReport]) -> Quantity | str:
    """What a source was compared with: the position; of a position, what tells most of the motion."""
    used = [r for r in reports if r.n_used and (r.source, r.kind) != (report.source, report.kind)]
    if report.kind is Kind.POSITION:
        order: tuple[Kind, ...] = (Kind.SPEED, *RATES, Kind.VELOCITY, Kind.HEADING, Kind.POSITION)
    else:
        order = (Kind.POSITION,)
    for kind in order:
        for r in used:
            if r.kind is kind:
                return Quantity(r.source, r.kind)
    return CAR
