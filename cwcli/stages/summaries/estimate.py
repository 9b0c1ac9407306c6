"""What `estimate` says: a line per source and vehicle."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from cwcli.channels.published import REJECTED
from cwcli.estimation.limit_check import is_bias_within_sensor_limits
from cwcli.estimation.measurements import QUANTITY_BY_KIND, Kind
from cwcli.estimation.online_availability import OnlineAvailability
from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.result import TrackSummary
from cwcli.estimation.summary import measured_quantity_name
from cwcli.pipeline.json_names import CellWithValues
from cwcli.pipeline.result import Cell, SummaryTable
from cwcli.signals.canonical import TimedSignal
from cwcli.signals.clocks import find_stamp_gaps
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import EGO_ID, StateFlag
from cwcli.stages.summaries import NIS_CELL_BY_IS_WITHIN_BOUNDS, cell_of_low_and_high_bound

FLAGGED_STATES_HEADINGS = {
    StateFlag.STARTING: "states soon after the start",
    StateFlag.AFTER_RESET: "states soon after a reset",
    StateFlag.BRIDGED: "states in long position gaps",
    StateFlag.REJECTING: "states while a source is rejected (only with --causal)",
}
"""Flag of states -> heading of their number in the table of tracks."""
MAX_LISTED_CHANNELS = 5
"""The largest number of channels that are listed; the rest are counted."""


def estimate_tables(tracks: Mapping[str, TrackSummary]) -> tuple[SummaryTable, ...]:
    """Return the stage's tables for the terminal."""
    ego = tracks[EGO_ID]
    found = _estimated_parameters_table(ego)
    return (_sources_table(ego), *([found] if found.rows else []), _noise_table(ego), _vehicles_table(tracks))


def online_states_table(online: Sequence[OnlineAvailability]) -> SummaryTable:
    """Return the table of the online states."""
    columns = (
        "channel",
        "states",
        "origin of noise and latencies",
        "median delay [s]",
        "95 % of delays below [s]",
        "longest delay [s]",
    )
    title = "Online states, and how long after their stamps they could be known (delay)"
    rows: list[tuple[Cell, ...]] = [
        (each.topic, each.n_states, each.parameters, *each.delay_median_p95_and_max_s()) for each in online
    ]
    after = tuple(f"known_after_{name}_s" for name in ("median", "p95", "max"))
    return SummaryTable("online", title, columns, tuple(rows), names=("channel", "states", "parameters from", *after))


def _sources_table(ego: TrackSummary) -> SummaryTable:
    """Return the table of the ego's sources with their counts and latencies."""
    rows: list[tuple[Cell, ...]] = [
        (
            report.source,
            measured_quantity_name(report),
            report.n_used,
            report.n_gated,
            _value_with_sigma_cell(1e3 * report.latency.found_s, 1e3 * report.latency.sigma_s, ".0f"),
            report.latency.status.value,
        )
        for report in ego.sources
    ]
    columns = (
        "source",
        "quantity",
        "measurements accepted",
        "measurements gated",
        "latency +- sigma [ms]",
        "latency status",
    )
    names = (*columns[:2], "used", "gated", "latency [ms]", "latency status")
    gated = any(report.n_gated for report in ego.sources)
    where = f", listed in {REJECTED.topic}" if gated else ""
    title = (
        f"Sensors of the ego: measurements accepted and gated (rejected as outliers{where}), and by how much their "
        "stamps are late (latency)"
    )
    return SummaryTable("sources", title, columns, tuple(rows), names=names)


def _estimated_parameters_table(ego: TrackSummary) -> SummaryTable:
    """Return the table with a row for each parameter that was estimated."""
    rows: list[tuple[Cell, ...]] = []
    for report in ego.sources:
        unit = QUANTITY_BY_KIND[report.kind].unit
        name = (report.source, measured_quantity_name(report))
        if not math.isnan(report.bias):
            status = ParameterStatus.USED if is_bias_within_sensor_limits(report) else ParameterStatus.CONTRADICTS
            bias = _value_with_sigma_cell(report.bias, report.bias_sigma, ".3g", time_s=None)
            rows.append((*name, "bias", bias, unit, _status_cell(status)))
        for label, found, own_unit in (("scale", report.scale, ""), ("lever arm", report.lever_arm_m, "m"),
                ("ahead of reference point", report.ahead_m, "m"),
                ("stamp jitter (sigma)", report.stamp_error, "s")):  # fmt: skip
            if found.status is not ParameterStatus.OFF:
                is_refused = found.status is ParameterStatus.CONTRADICTS and found.value == 0.0
                value = _value_with_sigma_cell(math.nan if is_refused else found.value, found.sigma, ".4g", time_s=None)
                rows.append((*name, label, value, own_unit, _status_cell(found.status)))
        slow = report.slow_error
        if slow.status is not ParameterStatus.OFF:
            text = "" if math.isnan(slow.sigma) else f"{slow.sigma:.3g}"
            text += "" if math.isnan(slow.time_s) else f" for {slow.time_s:.3g} s"
            value = CellWithValues(text, {"": slow.sigma, "sigma": None, "time_s": slow.time_s})
            label = "grade" if report.kind is Kind.ACCEL else "slow error"
            rows.append((*name, label, value, unit, _status_cell(slow.status)))
    columns = ("source", "quantity", "parameter", "value +- sigma", "unit", "use of the value")
    names = (*columns[:3], "value", "unit", "status")
    title = "Sensors of the ego: biases and other parameters estimated from this log"
    return SummaryTable("parameters", title, columns, tuple(rows), names=names)


def _noise_table(ego: TrackSummary) -> SummaryTable:
    """Return the table of the ego's sources with their noise and the consistency of the innovations."""
    rows: list[tuple[Cell, ...]] = [
        (
            report.source,
            measured_quantity_name(report),
            CellWithValues(
                "" if math.isnan(report.sigma) else f"{report.sigma:.3g} {QUANTITY_BY_KIND[report.kind].unit}",
                {"": report.sigma, "unit": QUANTITY_BY_KIND[report.kind].unit},
            ),
            report.noise_origin,
            report.nis_mean / report.nis_dof,
            cell_of_low_and_high_bound(*(bound / report.nis_dof for bound in report.nis_bounds)),
            NIS_CELL_BY_IS_WITHIN_BOUNDS[report.nis_inside],
        )
        for report in ego.sources
    ]
    columns = (
        "source",
        "quantity",
        "white noise (1 sigma)",
        "where the noise is from",
        "mean NIS per dof",
        "95 % bounds of NIS per dof",
        "NIS per dof within bounds",
    )
    title = (
        "Sensors of the ego: white noise (1 sigma), and the innovations over what it explains (NIS, normalised "
        "innovation squared, per degree of freedom (dof): about 1 if the noise is right)"
    )
    return SummaryTable(
        "noise",
        title,
        columns,
        tuple(rows),
        names=("source", "quantity", "white noise", "from", "NIS/dof", "bounds_95", "inside"),
    )


def _vehicles_table(tracks: Mapping[str, TrackSummary]) -> SummaryTable:
    """Return the table of the estimated tracks."""
    rows: list[tuple[Cell, ...]] = [
        (
            vehicle,
            track.n_states,
            track.span_s,
            track.max_speed_mps,
            track.median_sigma_m,
            sum(report.n_gated for report in track.sources),
            *(track.n_flagged[str(flag.name).lower()] for flag in FLAGGED_STATES_HEADINGS),
        )
        for vehicle, track in tracks.items()
    ]
    columns = (
        "vehicle",
        "states",
        "duration [s]",
        "max speed [m/s]",
        "median position sigma per axis [m]",
        "measurements gated",
        *FLAGGED_STATES_HEADINGS.values(),
    )
    flags = (str(f.name).lower().replace("_", " ") for f in FLAGGED_STATES_HEADINGS)
    names = (*columns[:2], "span [s]", columns[3], "median sigma [m]", "gated", *flags)
    title = "Estimated tracks (gated: rejected as outliers)"
    return SummaryTable("vehicles", title, columns, tuple(rows), names=names)


def _status_cell(status: ParameterStatus) -> CellWithValues:
    """Return the cell of a status. People read "applied", as of latencies, since "used" is said of measurements."""
    return CellWithValues("applied" if status is ParameterStatus.USED else status.value, {"": status.value})


def _value_with_sigma_cell(value: float, sigma: float, digits: str, **null_entries: None) -> CellWithValues:
    """Return a cell with a value and its sigma, "" without a value; `null_entries` are null in JSON."""
    text = "" if math.isnan(value) else f"{value:{digits}}"
    if text and not math.isnan(sigma):
        text += f" +- {sigma:{'.0f' if digits == '.0f' else '.2g'}}"
    return CellWithValues(text, {"": value, "sigma": sigma, **null_entries})


def format_gap_notes(signals: Iterable[TimedSignal], start_ns: int, end_ns: int) -> list[str]:
    """Return one line for each signal with gaps, a late start and an early end included: their number, and the longest
    one.

    Args:
        start_ns, end_ns: Span in which the signals should have been there.
    """
    notes = []
    for signal in signals:
        gaps = find_stamp_gaps(np.sort(signal.stamp_ns), start_ns=start_ns, end_ns=end_ns)
        if not gaps:
            continue
        longest = max(gaps, key=lambda gap: gap.duration_s)
        if longest.end_ns <= int(signal.stamp_ns.min()):
            place = "before its first message"
        elif longest.start_ns >= int(signal.stamp_ns.max()):
            place = "after its last message"
        else:
            place = f"from {(longest.start_ns - start_ns) / NS_PER_S:.1f} s after the first message of any channel"
        count = f"{len(gaps)} gaps without messages; the longest is" if len(gaps) > 1 else "a gap without messages,"
        notes.append(f"{signal.source}: {count} {longest.duration_s:.1f} s {place}")
    return notes[:MAX_LISTED_CHANNELS] + (
        [f"{len(notes) - MAX_LISTED_CHANNELS} more channels have gaps"] if len(notes) > MAX_LISTED_CHANNELS else []
    )
