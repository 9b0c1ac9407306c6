"""Estimated tracks without their arrays: as a table of metrics, and as JSON for the record of the run."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping

import numpy as np

from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, QUANTITY_BY_KIND
from cwcli.estimation.result import SourceReport, Track, TrackSummary
from cwcli.metrics.table import MetricRow, Table, table_of_metric_rows
from cwcli.signals.columns import median_of_values
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import StateFlag
from cwcli.text import finite_or_none


def summarise_track(track: Track) -> TrackSummary:
    """Summarise a track."""
    n = len(track.stamp_ns)
    variance = 0.5 * (track.covariance[:, 0, 0] + track.covariance[:, 1, 1])
    return TrackSummary(
        n_states=n,
        span_s=float(track.stamp_ns[-1] - track.stamp_ns[0]) / NS_PER_S if n else 0.0,
        max_speed_mps=float(np.abs(track.state[:, 2]).max()) if n else math.nan,
        median_sigma_m=median_of_values(np.sqrt(variance)) if n else math.nan,
        n_flagged={str(f.name).lower(): int(np.count_nonzero(track.flags & f)) for f in StateFlag},
        sources=track.sources,
        notes=track.notes,
        contradictions=track.contradictions,
        corrections=track.corrections,
    )


def build_estimate_table(tracks: Mapping[str, TrackSummary]) -> dict[str, Table]:
    """Return the table `estimate`; its source is a topic, or "" for the track as a whole."""
    rows: list[MetricRow] = []
    for vehicle, track in tracks.items():
        for report in track.sources:
            rows.extend(_source_metric_rows(vehicle, report))
        rows.append((vehicle, "", "state", "count", float(track.n_states), ""))
        rows += [(vehicle, "", "state", f"{name}_count", float(n), "") for name, n in track.n_flagged.items()]
        rows.append((vehicle, "", "position", "median_sigma", track.median_sigma_m, "m"))
    return {"estimate": table_of_metric_rows("estimate", rows)}


def format_source_diagnostics_json(tracks: Mapping[str, TrackSummary]) -> str:
    """Return the diagnostics of every source as JSON for the metadata record, as the channels do not hold them."""
    return json.dumps(
        [
            {
                "vehicle": vehicle,
                "source": report.source,
                "quantity": report.kind.name.lower(),
                "read": report.n_read,
                "used": report.n_used,
                "gated": report.n_gated,
                "resets": 0 if report.kind in KINDS_THAT_IMU_MEASURES_TOO else report.n_resets,
                "nis_per_dof": finite_or_none(report.nis_mean / report.nis_dof),
                "nis_inside": report.nis_inside,
                "stamp_sigma_s": finite_or_none(report.stamp_error.value),
                "latency_s": finite_or_none(report.latency.applied_s),
                "latency_found_s": finite_or_none(report.latency.found_s),
                "latency_sigma_s": finite_or_none(report.latency.sigma_s),
                "latency_drift": finite_or_none(report.latency.drift),
                "latency_status": report.latency.status.value,
            }
            for vehicle, track in tracks.items()
            for report in track.sources
        ]
    )


def _source_metric_rows(vehicle: str, report: SourceReport) -> list[MetricRow]:
    unit = QUANTITY_BY_KIND[report.kind].unit
    values = (
        ("read_count", float(report.n_read), ""),
        ("used_count", float(report.n_used), ""),
        ("gated_count", float(report.n_gated), ""),
        ("reset_count", float(report.n_resets), ""),
        ("noise_sigma", report.sigma, unit),
        ("nis_per_dof", report.nis_mean / report.nis_dof, ""),
        ("nis_lower", report.nis_bounds[0] / report.nis_dof, ""),
        ("nis_upper", report.nis_bounds[1] / report.nis_dof, ""),
        ("stamp_sigma", report.stamp_error.value, "s"),
        ("latency", report.latency.applied_s, "s"),
        ("latency_found", report.latency.found_s, "s"),
        ("latency_sigma", report.latency.sigma_s, "s"),
        ("bias", report.bias, unit),
        ("bias_sigma", report.bias_sigma, unit),
        ("scale", report.scale.value, ""),
        ("scale_sigma", report.scale.sigma, ""),
        ("lever_arm", report.lever_arm_m.value, "m"),
        ("lever_arm_sigma", report.lever_arm_m.sigma, "m"),
        ("ahead", report.ahead_m.value, "m"),
        ("ahead_sigma", report.ahead_m.sigma, "m"),
        ("slow_sigma", report.slow_error.sigma, unit),
        ("slow_time", report.slow_error.time_s, "s"),
    )
    return [(vehicle, report.source, measured_quantity_name(report), metric, value, u) for metric, value, u in values]


def measured_quantity_name(report: SourceReport) -> str:
    """Return the name of the quantity that a source measures."""
    return report.kind.name.lower().replace("_", " ")
