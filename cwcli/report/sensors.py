"""The sensors: what the estimator found of each, whether it is consistent, and the errors against a truth over time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TypeGuard

import numpy as np

from cwcli.digest.drive import Drive
from cwcli.digest.encounters import DriveEncounters
from cwcli.evaluation.evaluation_context import EgoTruth
from cwcli.evaluation.truth import covariances_nearest_in_time
from cwcli.pipeline.records import RecordedSummary, read_recorded_summary
from cwcli.pipeline.result import Cell, SummaryTable
from cwcli.report.drawing import Figure, rounded_json_numbers
from cwcli.report.signal_figures import SignalCurve, stacked_curves_figure
from cwcli.report.views import SensorsView, TableView
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.units import STANDARD_GRAVITY_MPS2
from cwcli.signals.vehicle_state import HEADING, SPEED
from cwcli.text import format_number, join_names

SENSOR_TABLE_KEYS = ("sources", "parameters", "noise", "errors", "nees", "link", "reception")
"""Keys of the tables of `estimate` about the sensors, in the order of the page."""
MAX_TABLE_ROWS = 60
"""The greatest number of rows of a table. Chosen by hand; not fitted."""
MAX_INTERPOLATION_GAP_S = 0.5
"""Longest gap in s across which states are interpolated. Chosen by hand; not fitted."""
ELLIPSE_95_SIGMAS = math.sqrt(-2.0 * math.log(0.05))
"""Half axis of the 95 % ellipse in standard deviations (Rayleigh distribution)."""
INTERVAL_95_SIGMAS = 1.96
"""Half width of the 95 % interval in standard deviations (normal distribution)."""
MIN_REMARKED_LATENCY_MS = 100.0
"""Least corrected latency, ms, that is remarked; the figures do not show smaller ones. Chosen by hand; not fitted."""
MIN_REMARKED_PITCH_DEG = 3.0
"""Least pitch angle, deg, that is remarked; road grades reach smaller ones. Chosen by hand; not fitted."""


def build_sensors_view(drive: Drive) -> SensorsView | None:
    """Collect what the records say of the sensors; None where they say nothing."""
    estimate = read_recorded_summary(drive.records.get("estimate", {}))
    found = {section.key: section for section in estimate.sections}
    tables = tuple(_table_view_of_section(found[key]) for key in SENSOR_TABLE_KEYS if key in found and found[key].rows)
    notes = tuple(
        f"{stage}: {note}" for stage, record in drive.records.items() for note in read_recorded_summary(record).notes
    )
    if not (tables or notes or estimate.verdict):
        return None
    return SensorsView(estimate.verdict, tables, tuple(dict.fromkeys(notes)), tuple(_iter_sensor_remarks(estimate)))


def _iter_sensor_remarks(results: RecordedSummary) -> Iterator[str]:
    """Yield sentences that explain the figures: applied latencies and pitched IMUs."""
    for source, quantity, late_s in _iter_late_sources(results):
        word, side = ("late", "ahead of") if late_s > 0.0 else ("early", "behind")
        yield (
            f"The {quantity} of {source} came {abs(late_s):.2f} s {word} by its stamps; that is corrected, so the "
            f"estimate (blue) lies as far {side} what was measured (grey)."
        )
    for source, bias_mps2, pitch_deg in _iter_pitched_imu_bias_and_pitch(results):
        yield (
            f"The acceleration of {source} is off by {bias_mps2:.2f} m/s²: that of an IMU pitched by "
            f"{pitch_deg:.0f} degrees."
        )


def sensor_remarks_sentence(drive: Drive) -> str:
    """Summarise the remarks on the sensors in a sentence; "" if there are none."""
    results = read_recorded_summary(drive.records.get("estimate", {}))
    said = [
        f"the {quantity} of {source} came {abs(late_s):.2f} s {'late' if late_s > 0.0 else 'early'} (corrected)"
        for source, quantity, late_s in _iter_late_sources(results)
    ]
    said += [f"{imu} is pitched by {deg:.0f} degrees" for imu, _, deg in _iter_pitched_imu_bias_and_pitch(results)]
    return f"Of the sensors {join_names(said)}." if said else ""


def _iter_late_sources(results: RecordedSummary) -> Iterator[tuple[str, str, float]]:
    """Yield source, quantity and latency [s] of each source whose applied latency shows in the figures."""
    for source, quantity, found, status in results.rows_of_table_columns_or_empty(
        "sources", "source", "quantity", "latency +- sigma [ms]", "latency status"
    ):
        latency_ms = leading_number_or_nan(found)
        if status == "applied" and MIN_REMARKED_LATENCY_MS <= abs(latency_ms) < math.inf:
            yield str(source), str(quantity), latency_ms / 1000.0


def _iter_pitched_imu_bias_and_pitch(results: RecordedSummary) -> Iterator[tuple[str, float, float]]:
    """Yield source, acceleration bias [m/s^2] and pitch [deg] of each IMU that is pitched more than a road."""
    for source, quantity, parameter, value in results.rows_of_table_columns_or_empty(
        "parameters", "source", "quantity", "parameter", "value +- sigma"
    ):
        bias = leading_number_or_nan(value)
        if (quantity, parameter) == ("accel", "bias") and abs(bias) < STANDARD_GRAVITY_MPS2:
            pitch_deg = math.degrees(math.asin(abs(bias) / STANDARD_GRAVITY_MPS2))
            if pitch_deg >= MIN_REMARKED_PITCH_DEG:
                yield str(source), bias, pitch_deg


def leading_number_or_nan(cell: Cell) -> float:
    """Parse the number at the beginning of `1013 +- 88`; NaN if there is none."""
    try:
        return float(str(cell).partition(" ")[0])
    except ValueError:
        return math.nan


def _table_view_of_section(section: SummaryTable) -> TableView:
    """Convert a summary's table to the page's form."""
    numeric = [any(_is_number(row[k]) for row in section.rows) for k in range(len(section.columns))]
    rows = tuple(tuple(map(_cell_text, row)) for row in section.rows[:MAX_TABLE_ROWS])
    return TableView(section.title, tuple(zip(map(_heading_text, section.columns), numeric, strict=True)), rows)


def _heading_text(column: str) -> str:
    """Format a column name such as `loss_share` as `loss share`."""
    return column.replace("_", " ")


def _is_number(cell: Cell) -> TypeGuard[int | float]:
    """Whether a cell is a number and no truth value."""
    return isinstance(cell, int | float) and not isinstance(cell, bool)


def _cell_text(cell: Cell) -> str:
    """Format a cell as text."""
    if cell is None:
        return "-"
    return format_number(cell) if isinstance(cell, float) else str(cell)


def truth_error_figure(
    drive: Drive, truth: EgoTruth, drive_encounters: DriveEncounters, n_pieces: int
) -> Figure | None:
    """Draw the errors against the truth over time; None if states and truth have no common time."""
    curves = truth_error_curves(drive, truth)
    if not curves or drive.ego is None:
        return None
    figure = stacked_curves_figure(drive, curves, drive_encounters, n_pieces, around_zero=True)
    span = drive.seconds_since_start(drive.ego.sort_by_stamp_without_repeats().stamp_ns[[0, -1]])
    figure["layout"]["xaxis"]["range"] = rounded_json_numbers(span, 2)
    return figure


def truth_error_curves(drive: Drive, truth: EgoTruth) -> list[SignalCurve]:
    """Compute the errors of position, speed and heading with 95 % bands; [] without a common time.

    The position's band is the extent of its 95 % ellipse in the direction of the error: the line leaves the band where
    the truth leaves the ellipse.
    """
    ego = drive.ego
    if ego is None:
        return []
    states = ego.sort_by_stamp_without_repeats()
    state = interpolate_signal_at_times(
        states.stamp_ns, states.state, truth.stamp_ns, max_gap_s=MAX_INTERPOLATION_GAP_S
    )
    error = state[:, :2] - truth.xy
    if not np.isfinite(error).any():
        return []
    covariance = covariances_nearest_in_time(truth.stamp_ns, states)
    distance = np.hypot(*error.T)
    curves = [
        SignalCurve(
            "position",
            "m",
            3,
            truth.stamp_ns,
            distance,
            ELLIPSE_95_SIGMAS * sigma_along_error(error, covariance[:, :2, :2]),
        )
    ]
    turn = math.degrees(1.0)
    for title, unit, decimals, true, column, scale in (
        ("speed", "m/s", 3, truth.speed_mps, SPEED, 1.0),
        ("heading", "deg", 2, truth.heading_rad, HEADING, turn),
    ):
        if true is None or not np.isfinite(true).any():
            continue
        difference = state[:, column] - true
        difference = wrap_angle(difference) if column == HEADING else difference
        sigma = np.sqrt(np.maximum(covariance[:, column, column], 0.0))
        curves.append(
            SignalCurve(title, unit, decimals, truth.stamp_ns, difference * scale, INTERVAL_95_SIGMAS * sigma * scale)
        )
    return curves


def sigma_along_error(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Compute one standard deviation in the direction of each error.

    Args:
        error: Shape (n, 2).
        covariance: Shape (n, 2, 2), positive definite.

    Returns:
        Shape (n,): `1 / sqrt(u' P^-1 u)` for the unit vector u of the error; the root of the mean variance where it is
        zero.
    """
    distance = np.hypot(*error.T)
    with np.errstate(invalid="ignore", divide="ignore"):
        u = error / distance[:, None]
        weighted = np.einsum("ni,nij,nj->n", u, np.linalg.inv(covariance), u)
        extent = 1.0 / np.sqrt(weighted)
    mean = np.sqrt(0.5 * np.trace(covariance, axis1=1, axis2=2))
    return np.asarray(np.where(distance > 0.0, extent, mean), np.float64)
