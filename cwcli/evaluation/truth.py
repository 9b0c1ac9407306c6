"""Compare the estimate with a truth channel: align the frames, then compute song2016's table 1 and NEES."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field

import numpy as np

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.estimation.consistency import (
    ErrorTableRow,
    compare_errors_with_truth,
    effective_count_of_squared_errors,
    nees,
)
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.result import Track
from cwcli.estimation.verdict import NeesOfQuantity
from cwcli.evaluation.truth_rules import TruthRule, find_truth_rules
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.metrics.chi_square import chi_square_mean_bounds
from cwcli.metrics.table import MetricRow
from cwcli.pipeline.result import Cell, SummaryTable
from cwcli.signals.angles import wrap_angle
from cwcli.signals.canonical import PoseSignal, PositionSignal, Signal
from cwcli.signals.columns import EastNorthRows, FloatArray, Int64Array, LatLonAlt
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.vehicle_state import EGO_ID, HEADING, SPEED, X
from cwcli.stages.summaries import NIS_CELL_BY_IS_WITHIN_BOUNDS, cell_of_low_and_high_bound

MAX_INTERPOLATED_EGO_GAP_S = 0.5
"""Longest gap of the ego's track that is interpolated, s. Chosen by hand; not fitted."""
MIN_TRUTH_ROWS = 20
"""Least number of truth rows for a comparison. Chosen by hand; not fitted."""
QUANTITY_LABELS = {"position": "position on one axis"}
"""Quantity -> its label in the table of errors against a truth, where the error of the position is that on one axis;
other tables give its distance on the plane."""
DEGREES_OF_FREEDOM_BY_QUANTITY = {"position": 2, "speed": 1, "heading": 1}
"""Degrees of freedom of each quantity with a NEES."""
FIRST_STATE_OF_QUANTITY = {"position": X, "speed": SPEED, "heading": HEADING}
"""Quantity with a NEES -> index of the first of its states in the order of `STATE_NAMES`."""


@dataclass(frozen=True)
class TruthErrors:
    """Errors against a truth channel.

    Attributes:
        rows: Errors of each quantity, measured and estimated, as in song2016's table 1.
        nees: NEES of position, speed and heading, as far as the truth has them.
        n: Number of truth rows compared.
        notes: How the frames were aligned, and how the truth's device is mounted.
        rules: Quantity -> rule by which the truth differs from the track, where its NEES is too large and there is one.
    """

    topic: str
    rows: tuple[ErrorTableRow, ...]
    nees: tuple[NeesOfQuantity, ...]
    n: int
    notes: tuple[str, ...]
    rules: Mapping[str, TruthRule] = field(default_factory=dict)


def build_truth_errors_section(errors: TruthErrors) -> SummaryTable:
    """Build the section with the errors for the summary."""
    rows: list[tuple[Cell, ...]] = [
        (
            QUANTITY_LABELS.get(row.name, row.name),
            row.unit,
            row.n,
            row.measured_sigma,
            row.estimated_sigma,
            row.change_percent,
            row.estimated_bias,
        )
        for row in errors.rows
    ]
    columns = (
        "quantity",
        "unit",
        "times compared",
        "RMS error of measurements",
        "RMS error of estimates",
        "change of error by estimation [%]",
        "bias of estimates",
    )
    title = f"Errors of measurements and estimates against the truth of {errors.topic}"
    names = ("error of", "unit", "rows", "measured", "estimated", "change [%]", "bias")
    return SummaryTable("errors", title, columns, tuple(rows), names=names)


def build_nees_section(errors: TruthErrors) -> SummaryTable:
    """Build the section with the NEES for the summary."""
    rows: list[tuple[Cell, ...]] = [
        (
            each.name,
            each.per_dof,
            cell_of_low_and_high_bound(*each.bounds),
            NIS_CELL_BY_IS_WITHIN_BOUNDS[each.is_within_bounds],
        )
        for each in errors.nees
    ]
    title = (
        "Errors over what the covariance promises (NEES, normalised estimation error squared, per degree of freedom "
        "(dof): about 1 if the covariance is right)"
    )
    columns = ("quantity", "NEES/dof", "95 % bounds of NEES/dof", "NEES/dof within bounds")
    return SummaryTable("nees", title, columns, tuple(rows), names=("error_of", "nees_per_dof", "bounds_95", "inside"))


def truth_error_metric_rows(errors: TruthErrors) -> list[MetricRow]:
    """Return the errors as rows of the stage's table."""
    values = [
        (error.name, metric, value, unit)
        for error in errors.rows
        for metric, value, unit in (
            ("measured_error_sigma", error.measured_sigma, error.unit),
            ("measured_error_bias", error.measured_bias, error.unit),
            ("estimated_error_sigma", error.estimated_sigma, error.unit),
            ("estimated_error_bias", error.estimated_bias, error.unit),
            ("error_change", error.change_percent, "%"),
            ("error_count", float(error.n), ""),
        )
    ]
    for each in errors.nees:
        dof = DEGREES_OF_FREEDOM_BY_QUANTITY[each.name]
        values += [
            (each.name, "nees_mean", each.per_dof * dof, ""),
            (each.name, "nees_lower", each.bounds[0] * dof, ""),
            (each.name, "nees_upper", each.bounds[1] * dof, ""),
        ]
    return [(EGO_ID, errors.topic, *each) for each in values]


def compare_track_with_truth(
    truths: Sequence[Signal],
    measurements: Sequence[Measurements],
    ego: Track,
    local_map: LocalMap | None,
    origin: LatLonAlt | None,
) -> TruthErrors | None:
    """Compare the ego's track with the truth, at the truth's stamps; None without a usable truth channel."""
    if not truths or not isinstance(truths[0], PoseSignal | PositionSignal):
        return None
    signal = truths[0]
    inside = (signal.stamp_ns >= ego.stamp_ns[0]) & (signal.stamp_ns <= ego.stamp_ns[-1])
    stamp_ns = signal.stamp_ns[inside]
    if len(stamp_ns) < MIN_TRUTH_ROWS:
        return None
    fixes = next(m for m in measurements if m.kind is Kind.POSITION)
    measured_xy = _interpolate_at_ns(stamp_ns, fixes.stamp_ns, fixes.values, 1.5)
    xy, notes = place_truth_in_map_with_notes(signal, inside, local_map, origin, measured_xy)
    truth: dict[str, FloatArray] = {"position": xy}
    estimated_xy = _interpolate_at_ns(stamp_ns, ego.stamp_ns, ego.state[:, :2], MAX_INTERPOLATED_EGO_GAP_S)
    estimated: dict[str, FloatArray] = {"position": estimated_xy}
    measured: dict[str, FloatArray] = {"position": measured_xy}
    if isinstance(signal, PoseSignal):
        notes = (*notes, *notes_on_truth_mounting(signal))
        for name, values, kind, column in (
            ("speed", signal.speed_mps, Kind.SPEED, 2),
            ("heading", signal.travel_rad, Kind.HEADING, 3),
            ("accel", signal.accel_mps2, Kind.ACCEL, 4),
            ("yaw_rate", signal.yaw_rate_radps, Kind.YAW_RATE, 5),
        ):
            if values is None or not np.isfinite(values[inside]).any():
                continue
            truth[name] = values[inside]
            estimated[name] = _interpolate_at_ns(
                stamp_ns, ego.stamp_ns, ego.state[:, column], MAX_INTERPOLATED_EGO_GAP_S
            )
            raw = _first_measured_stamps_and_values(measurements, kind)
            if raw is not None:
                measured[name] = _interpolate_at_ns(stamp_ns, *raw, MAX_INTERPOLATED_EGO_GAP_S)
    covariance = covariances_nearest_in_time(stamp_ns, ego)
    rows = tuple(compare_errors_with_truth(truth, measured, estimated))
    known = np.isfinite(estimated_xy - xy).all(axis=1)
    consistency = tuple(
        _nees_of_quantity(name, estimated[name] - truth[name], covariance)
        for name in DEGREES_OF_FREEDOM_BY_QUANTITY
        if name in truth and name in estimated
    )
    doubted = [each.name for each in consistency if each.is_too_large]
    rules = find_truth_rules(stamp_ns, truth, ego, covariance, doubted) if doubted else {}
    consistency = tuple(
        replace(each, truth_rule=rule.text, per_dof_without_rule=rule.nees_per_dof)
        if (rule := rules.get(each.name)) is not None
        else each
        for each in consistency
    )
    return TruthErrors(signal.source, rows, consistency, int(known.sum()), notes, rules)


def notes_on_truth_mounting(signal: PoseSignal) -> tuple[str, ...]:
    """Return a note on the angle of a truth's device against the direction of travel, where it is significant."""
    mounting = signal.mounting
    return (mounting.mounting_note(signal.source),) if mounting is not None and mounting.is_significant else ()


def _nees_of_quantity(name: str, error: FloatArray, covariance: FloatArray) -> NeesOfQuantity:
    """Compute the NEES of one quantity from its error (n,) or (n, 2) and the covariance (n, 8, 8)."""
    first, dof = FIRST_STATE_OF_QUANTITY[name], DEGREES_OF_FREEDOM_BY_QUANTITY[name]
    error = (wrap_angle(error) if name == "heading" else error).reshape(len(error), dof)
    known = np.isfinite(error).all(axis=1)
    if not known.any():
        return NeesOfQuantity(name, math.nan, (math.nan, math.nan))
    own = covariance[known, first : first + dof, first : first + dof]
    values = nees(error[known], own)
    low, high = chi_square_mean_bounds(dof, effective_count_of_squared_errors(error[known], own))
    return NeesOfQuantity(name, float(values.mean()) / dof, (low / dof, high / dof))


def _first_measured_stamps_and_values(
    measurements: Sequence[Measurements], kind: Kind
) -> tuple[Int64Array, FloatArray] | None:
    """Return stamps and values of the first source of a kind; an IMU is used for acceleration and yaw rate."""
    source = next((m for m in measurements if m.kind is kind), None)
    if source is not None:
        values = source.values[:, 0]
        return source.stamp_ns, np.unwrap(values) if kind is Kind.HEADING else values
    imu = next((m for m in measurements if m.kind is Kind.IMU), None)
    axis = {Kind.ACCEL: 0, Kind.YAW_RATE: 5}.get(kind)
    return None if imu is None or axis is None else (imu.stamp_ns, imu.values[:, axis])


def place_truth_in_map_with_notes(
    signal: PoseSignal | PositionSignal,
    row_mask: np.ndarray[tuple[int, ...], np.dtype[np.bool_]],
    local_map: LocalMap | None,
    truth_origin: LatLonAlt | None,
    measured_xy: EastNorthRows,
) -> tuple[FloatArray, tuple[str, ...]]:
    """Convert the positions of a truth to the map frame; returns them and notes on how they were placed.

    Args:
        row_mask: Shape (all,): mask of its n wanted rows.
        local_map: Georeference of the map, or None where it has none.
        truth_origin: Latitude, longitude (deg) and altitude (m) of a Cartesian truth's origin, or None.
        measured_xy: Shape (n, 2): measured positions at the same rows, for a truth whose origin is not known.

    Returns:
        Shape (n, 2), and notes.
    """
    if isinstance(signal, PositionSignal):
        assert local_map is not None
        x_m, y_m, _ = local_map.map_from_wgs84(
            signal.latitude_deg[row_mask], signal.longitude_deg[row_mask], signal.altitude_m[row_mask]
        )
        return np.column_stack([x_m, y_m]), ()
    xyz = np.column_stack([signal.x_m, signal.y_m, signal.z_m])[row_mask]
    if local_map is None:
        return xyz[:, :2], ()
    if signal.latitude_deg is not None and signal.longitude_deg is not None:
        latitude_deg, longitude_deg = signal.latitude_deg[row_mask], signal.longitude_deg[row_mask]
        x_m, y_m, _ = local_map.map_from_wgs84(latitude_deg, longitude_deg, np.full(len(xyz), local_map.origin_alt_m))
        return np.column_stack([x_m, y_m]), ()
    if truth_origin is not None:
        latitude_deg, longitude_deg, altitude_m = LocalMap(*truth_origin).wgs84_from_map(*xyz.T)
        x_m, y_m, _ = local_map.map_from_wgs84(latitude_deg, longitude_deg, altitude_m)
        return np.column_stack([x_m, y_m]), (f"{signal.source}: placed by its given origin",)
    offset = np.nanmedian(measured_xy - xyz[:, :2], axis=0)
    note = (
        f"{signal.source}: its origin is not known, so it was shifted onto the measured positions by "
        f"({offset[0]:.2f}, {offset[1]:.2f}) m; a constant error does not show (--truth-origin gives the origin)"
    )
    return xyz[:, :2] + offset, (note,)


def _interpolate_at_ns(at_ns: Int64Array, stamp_ns: Int64Array, values: FloatArray, max_gap_s: float) -> FloatArray:
    return interpolate_signal_at_times(stamp_ns, values, at_ns, max_gap_s=max_gap_s)


def covariances_nearest_in_time(at_ns: Int64Array, states: Track | VehicleStates) -> FloatArray:
    """Return the covariances (n, 8, 8) of the states nearest in time; the states are in stamp order."""
    stamp_ns = states.stamp_ns
    last = len(stamp_ns) - 1
    after = np.clip(np.searchsorted(stamp_ns, at_ns), min(1, last), last)
    nearest = np.where(at_ns - stamp_ns[after - 1] < stamp_ns[after] - at_ns, after - 1, after)
    return np.asarray(states.covariance[nearest], np.float64)
