"""What `estimate` says: a line per source and vehicle, and the metrics table."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from cwcli.estimation.latency import Latency
from cwcli.estimation.measurements import QUANTITIES
from cwcli.estimation.result import SourceReport, Track
from cwcli.metrics.table import MetricRow, Table, metric_table
from cwcli.pipeline.result import Cell, Section
from cwcli.signals.canonical import TimedSignal
from cwcli.signals.clocks import find_gaps
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import EGO_ID, StateFlag
from cwcli.stages.summaries import NIS_WORDS, bounds_text
from cwcli.text import finite

MAX_GAP_NOTES = 5


@dataclass(frozen=True)
class TrackSummary:
    """What is told of a track, without its arrays.

    Attributes:
        n_states, span_s, max_speed_mps: Its size.
        median_sigma_m: Median of the horizontal one-sigma per axis, NaN without states.
        n_flagged: States with each `StateFlag`, by its name.
        sources, notes: As in `Track`.
    """

    n_states: int
    span_s: float
    max_speed_mps: float
    median_sigma_m: float
    n_flagged: Mapping[str, int]
    sources: tuple[SourceReport, ...]
    notes: tuple[str, ...]


def summarise(track: Track) -> TrackSummary:
    """The summary of a track."""
    n = len(track.stamp_ns)
    variance = 0.5 * (track.covariance[:, 0, 0] + track.covariance[:, 1, 1])
    return TrackSummary(
        n_states=n,
        span_s=float(track.stamp_ns[-1] - track.stamp_ns[0]) / NS_PER_S if n else 0.0,
        max_speed_mps=float(np.abs(track.state[:, 2]).max()) if n else math.nan,
        median_sigma_m=float(np.median(np.sqrt(variance))) if n else math.nan,
        n_flagged={str(f.name).lower(): int(np.count_nonzero(track.flags & f)) for f in StateFlag},
        sources=track.sources,
        notes=track.notes,
    )


def sections(tracks: Mapping[str, TrackSummary]) -> tuple[Section, ...]:
    """The stage's tables for the terminal."""
    ego = tracks[EGO_ID]
    return _sources_section(ego), _noise_section(ego), _vehicles_section(tracks)


def estimate_tables(tracks: Mapping[str, TrackSummary]) -> dict[str, Table]:
    """One table; its source is a topic, or "" for the track as a whole."""
    rows: list[MetricRow] = []
    for vehicle, track in tracks.items():
        for report in track.sources:
            rows.extend(_report_rows(vehicle, report))
        rows.append((vehicle, "", "state", "count", float(track.n_states), ""))
        rows += [(vehicle, "", "state", f"{name}_count", float(n), "") for name, n in track.n_flagged.items()]
        rows.append((vehicle, "", "position", "median_sigma", track.median_sigma_m, "m"))
    return {"estimate": metric_table("estimate", rows)}


def source_record(tracks: Mapping[str, TrackSummary]) -> str:
    """Every source's diagnostics as JSON, for the metadata record: what can't be told from the channels later."""
    return json.dumps(
        [
            {
                "vehicle": vehicle,
                "source": report.source,
                "quantity": report.kind.name.lower(),
                "read": report.n_read,
                "used": report.n_used,
                "gated": report.n_gated,
                "nis_per_dof": finite(report.nis_mean / report.nis_dof),
                "nis_inside": report.nis_inside,
                "latency_s": finite(report.latency.applied_s),
                "latency_found_s": finite(report.latency.found_s),
                "latency_sigma_s": finite(report.latency.sigma_s),
                "latency_status": report.latency.status.value,
            }
            for vehicle, track in tracks.items()
            for report in track.sources
        ]
    )


def gap_notes(signals: Iterable[TimedSignal], start_ns: int, end_ns: int) -> list[str]:
    """One line for each signal with gaps, a late start and an early end included: how many, and where the longest is.

    Args:
        signals: Canonical signals.
        start_ns, end_ns: Span in which the signals should have been there.
    """
    notes = []
    for signal in signals:
        gaps = find_gaps(np.sort(signal.stamp_ns), start_ns=start_ns, end_ns=end_ns)
        if not gaps:
            continue
        longest = max(gaps, key=lambda gap: gap.duration_s)
        at_s = (longest.start_ns - start_ns) / NS_PER_S
        count = len(gaps)
        notes.append(
            f"{signal.source}: {count} gap{'s' if count > 1 else ''}, the longest {longest.duration_s:.1f} s "
            f"from {at_s:.1f} s on"
        )
    return notes[:MAX_GAP_NOTES] + (
        [f"{len(notes) - MAX_GAP_NOTES} more channels have gaps"] if len(notes) > MAX_GAP_NOTES else []
    )


def _sources_section(ego: TrackSummary) -> Section:
    rows: list[tuple[Cell, ...]] = [
        (
            report.source,
            _quantity(report),
            report.n_used,
            report.n_gated,
            _latency_text(report.latency),
            report.latency.status.value,
            _bias_text(report),
        )
        for report in ego.sources
    ]
    columns = ("source", "quantity", "used", "gated", "latency [ms]", "latency status", "bias")
    return Section("sources", "Ego sources: what was used and corrected", columns, tuple(rows))


def _noise_section(ego: TrackSummary) -> Section:
    rows: list[tuple[Cell, ...]] = [
        (
            report.source,
            _quantity(report),
            f"{report.sigma:.3g} {QUANTITIES[report.kind].unit}",
            report.noise_origin,
            report.nis_mean / report.nis_dof,
            bounds_text(*(bound / report.nis_dof for bound in report.nis_bounds)),
            NIS_WORDS[report.nis_inside],
        )
        for report in ego.sources
    ]
    columns = ("source", "quantity", "noise", "from", "NIS/dof", "95 % bounds", "inside")
    return Section("noise", "Ego sources: noise and consistency of the innovations", columns, tuple(rows))


def _vehicles_section(tracks: Mapping[str, TrackSummary]) -> Section:
    rows: list[tuple[Cell, ...]] = [
        (
            vehicle,
            track.n_states,
            track.span_s,
            track.max_speed_mps,
            track.median_sigma_m,
            sum(report.n_gated for report in track.sources),
            *track.n_flagged.values(),
        )
        for vehicle, track in tracks.items()
    ]
    columns = (
        "vehicle",
        "states",
        "span [s]",
        "max speed [m/s]",
        "median sigma [m]",
        "gated",
        *(str(f.name).lower().replace("_", " ") for f in StateFlag),
    )
    return Section("vehicles", "Estimated tracks", columns, tuple(rows))


def _report_rows(vehicle: str, report: SourceReport) -> list[MetricRow]:
    unit = QUANTITIES[report.kind].unit
    values = (
        ("read_count", float(report.n_read), ""),
        ("used_count", float(report.n_used), ""),
        ("gated_count", float(report.n_gated), ""),
        ("reset_count", float(report.n_resets), ""),
        ("noise_sigma", report.sigma, unit),
        ("nis_per_dof", report.nis_mean / report.nis_dof, ""),
        ("nis_lower", report.nis_bounds[0] / report.nis_dof, ""),
        ("nis_upper", report.nis_bounds[1] / report.nis_dof, ""),
        ("latency", report.latency.applied_s, "s"),
        ("latency_found", report.latency.found_s, "s"),
        ("latency_sigma", report.latency.sigma_s, "s"),
        ("bias", report.bias, unit),
        ("bias_sigma", report.bias_sigma, unit),
    )
    return [(vehicle, report.source, _quantity(report), metric, value, u) for metric, value, u in values]


def _quantity(report: SourceReport) -> str:
    return report.kind.name.lower().replace("_", " ")


def _latency_text(latency: Latency) -> str:
    if math.isnan(latency.found_s):
        return ""
    value = f"{1e3 * latency.found_s:.0f}"
    return value if math.isnan(latency.sigma_s) else f"{value} +- {1e3 * latency.sigma_s:.0f}"


def _bias_text(report: SourceReport) -> str:
    if math.isnan(report.bias):
        return ""
    return f"{report.bias:.3g} {QUANTITIES[report.kind].unit}"
