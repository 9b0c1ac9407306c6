"""Check the constants that were found of the sources against the limits of such sensors, after the estimate."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from cwcli.estimation.contradiction import CAR_MOTION_TEXT, Contradiction, SourceQuantity
from cwcli.estimation.fix_scatter import (
    is_lasting_error_large,
    is_sigma_a_lasting_error,
    is_slow_error_one_of_speed,
    lasting_error_sigma,
)
from cwcli.estimation.latency import MS_PER_MINUTE_OF_UNIT_DRIFT, LatencyStatus
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, QUANTITY_BY_KIND, Kind
from cwcli.estimation.parameter import Parameter, ParameterStatus
from cwcli.estimation.result import SourceReport
from cwcli.estimation.sensor_limits import (
    ACCEL_BIAS_RANGE,
    LATENCY_CHANGE_PER_SECOND_RANGE,
    LATENCY_RANGE,
    STAMP_SIGMA_RANGE,
    WHITE_NOISE_RANGE_BY_KIND,
    YAW_RATE_BIAS_RANGE,
    ParameterRange,
    range_of_sensor_error,
)
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

MIN_BLAMED_BIAS_SHARE_OF_LIMIT = 0.5
"""Least bias of an inertial sensor, as a share of its limit, that is blamed for errors that last: the worst of the data
sheets, of which the limit is twice. Not fitted."""


def find_values_beyond_sensor_limits(
    reports: Sequence[SourceReport], known_contradictions: Sequence[Contradiction] = ()
) -> tuple[Contradiction, ...]:
    """Return contradictions for the sources with a constant beyond the limits of such sensors."""
    contradicted = {quantity for each in known_contradictions for quantity in (each.who, each.against)}
    found = []
    for report in reports:
        who = SourceQuantity(report.source, report.kind)
        words = next(iter(_iter_texts_on_exceeded_limits(report)), None)
        if words is not None and who not in contradicted:
            found.append(Contradiction(who, reference_quantity_of_comparison(report, reports), words))
        elif who not in contradicted and report.kind is Kind.POSITION and report.noise_origin != "message":
            found += _contradictions_of_lasting_fix_errors(report, reports)
    return tuple(found)


def _contradictions_of_lasting_fix_errors(fixes: SourceReport, reports: Sequence[SourceReport]) -> list[Contradiction]:
    """Return a contradiction where the noise of fixes is large only because another source has another motion.

    An inertial sensor with a bias near its limit is blamed first: a wrong scale is taken for a bias in a single bend.
    """
    if not is_sigma_a_lasting_error(fixes.kind, fixes.sigma, fixes.scatter):
        return []
    who = SourceQuantity(fixes.source, fixes.kind)
    what = f"lie {fixes.sigma:.1f} m beside the motion for long, and scatter by only {fixes.scatter:.2f} m"
    most = max(
        (r for r in reports if r.kind in KINDS_THAT_IMU_MEASURES_TOO and r.n_used),
        key=_bias_to_limit_ratio,
        default=None,
    )
    if most is None or _bias_to_limit_ratio(most) < MIN_BLAMED_BIAS_SHARE_OF_LIMIT:
        return [Contradiction(who, reference_quantity_of_comparison(fixes, reports), f"its fixes {what}")]
    return [Contradiction(SourceQuantity(most.source, most.kind), who, f"with it the fixes {what}")]


def find_contradictions_of_changing_latencies(
    reports: Sequence[SourceReport], known_contradictions: Sequence[Contradiction]
) -> list[Contradiction]:
    """Return contradictions of the sources whose latency changes faster than clocks drift.

    Such a latency steps, or the stamps are wrong. The line is used all the same: it is nearer to the truth than a
    constant.
    """
    contradicted_sources = {quantity.source for each in known_contradictions for quantity in (each.who, *each.allies)}
    found: dict[str, Contradiction] = {}
    for report in reports:
        drift = report.latency.drift
        if (
            report.source in contradicted_sources
            or not report.n_used
            or LATENCY_CHANGE_PER_SECOND_RANGE.contains_or_is_nan(drift)
        ):
            continue
        who = SourceQuantity(report.source, Kind.IMU if report.kind in KINDS_THAT_IMU_MEASURES_TOO else report.kind)
        what = (
            f"its latency changes by {MS_PER_MINUTE_OF_UNIT_DRIFT * drift:.0f} ms a minute, and a clock's by at most "
            f"{MS_PER_MINUTE_OF_UNIT_DRIFT * LATENCY_CHANGE_PER_SECOND_RANGE.high:.0f} ms: "
            "it steps, or the stamps are wrong"
        )
        found.setdefault(report.source, Contradiction(who, reference_quantity_of_comparison(report, reports), what))
    return list(found.values())


def doubt_sentence_on_lasting_errors(reports: Sequence[SourceReport]) -> str:
    """Return a sentence on a source whose errors last although no sensor is clearly wrong; "" where there is none."""
    for report in reports:
        is_along = is_slow_error_one_of_speed(report)
        is_doubted = report.slow_error.status is not ParameterStatus.USED and is_lasting_error_large(report)
        if report.n_used and (is_along or is_doubted):
            unit = QUANTITY_BY_KIND[report.kind].unit
            others = ", ".join(
                str(SourceQuantity(r.source, r.kind))
                for r in reports
                if r.n_used and r.kind not in (report.kind, Kind.POSITION)
            )
            who = SourceQuantity(report.source, report.kind)
            sigma = report.slow_error.sigma if is_along else lasting_error_sigma(report)
            how = f"errs by {sigma:.2g} {unit} for long, and scatters by {report.scatter:.2g} {unit}"
            if is_along:
                how += f", {report.slow_error.along_to_across:.2g} times as much along the way as across it"
            return f"{who} {how}: it wanders, or one of {others or 'the others'} is late, smoothed or of another scale"
    return ""


def _bias_to_limit_ratio(report: SourceReport) -> float:
    """Return the bias of an inertial sensor as a share of its limit, or 0 where none was found."""
    limit = YAW_RATE_BIAS_RANGE if report.kind is Kind.YAW_RATE else ACCEL_BIAS_RANGE
    share = abs(_bias_without_gravity(report)) / limit.high
    return share if math.isfinite(share) else 0.0


def is_bias_within_sensor_limits(report: SourceReport) -> bool:
    """Whether a sensor can have the bias that was found; gravity through the mounting is subtracted first."""
    limit = YAW_RATE_BIAS_RANGE if report.kind is Kind.YAW_RATE else ACCEL_BIAS_RANGE
    return limit.contains_or_is_nan(_bias_without_gravity(report))


def _bias_without_gravity(report: SourceReport) -> float:
    """Return the bias of an inertial sensor without gravity through its mounting; NaN where none was found."""
    if report.kind is Kind.YAW_RATE or report.mounting is None:
        return report.bias
    return report.bias - STANDARD_GRAVITY_MPS2 * math.sin(report.mounting.nose_up_rad)


def _iter_texts_on_exceeded_limits(report: SourceReport) -> Iterator[str]:
    """Yield a text on each constant that no such sensor has."""
    if not is_bias_within_sensor_limits(report):
        limit = YAW_RATE_BIAS_RANGE if report.kind is Kind.YAW_RATE else ACCEL_BIAS_RANGE
        yield _exceeded_limit_text("a bias", report.bias, limit)
    for name, part, parameter in (
        ("a scale", "scale", report.scale),
        ("a lever arm", "lever", report.lever_arm_m),
        ("a place ahead", "ahead", report.ahead_m),
    ):
        limit = range_of_sensor_error(part, report.kind)
        if parameter.status is ParameterStatus.CONTRADICTS or _is_used_beyond_limit(parameter, limit):
            yield _exceeded_limit_text(name, parameter.value, limit)
    if report.stamp_error.status is ParameterStatus.CONTRADICTS:
        yield f"its stamps err by more than {STAMP_SIGMA_RANGE.high:g} s from row to row"
    if report.slow_error.status is ParameterStatus.CONTRADICTS:
        yield _exceeded_limit_text("a slow error", report.slow_error.sigma, range_of_sensor_error("slow", report.kind))
    if report.latency.status is LatencyStatus.CONTRADICTS:
        yield _exceeded_limit_text("a latency", report.latency.found_s, LATENCY_RANGE)
    if (
        report.kind in WHITE_NOISE_RANGE_BY_KIND
        and report.noise_origin != "message"  # stated, and not found against another source
        and not WHITE_NOISE_RANGE_BY_KIND[report.kind].contains_or_is_nan(report.sigma)
        and report.n_used
    ):
        yield _exceeded_limit_text("white noise", report.sigma, WHITE_NOISE_RANGE_BY_KIND[report.kind])


def _is_used_beyond_limit(parameter: Parameter, limit: ParameterRange) -> bool:
    """Whether a parameter that was found and used lies beyond its limit; given ones are not checked."""
    return parameter.status is ParameterStatus.USED and not limit.contains_or_is_nan(parameter.value)


def _exceeded_limit_text(name: str, value: float, limit: ParameterRange) -> str:
    unit = f" {limit.unit}" if limit.unit else ""
    bound = limit.high if value >= limit.high else limit.low
    return f"together they need {name} of {value:.3g}{unit}, and such a sensor has at most {bound:g}{unit}"


def reference_quantity_of_comparison(report: SourceReport, reports: Sequence[SourceReport]) -> SourceQuantity | str:
    """Return what a source was compared with: the position; for a position the best source of motion."""
    used = [r for r in reports if r.n_used and (r.source, r.kind) != (report.source, report.kind)]
    if report.kind is Kind.POSITION:
        order: tuple[Kind, ...] = (Kind.SPEED, *KINDS_THAT_IMU_MEASURES_TOO, Kind.VELOCITY, Kind.HEADING, Kind.POSITION)
    else:
        order = (Kind.POSITION,)
    for kind in order:
        for r in used:
            if r.kind is kind:
                return SourceQuantity(r.source, r.kind)
    return CAR_MOTION_TEXT
