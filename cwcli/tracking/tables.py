"""Tracked targets and their sensors as a table of metrics."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cwcli.metrics.table import MetricRow, Table, table_of_metric_rows
from cwcli.signals.columns import median_of_values
from cwcli.tracking.config import FilterConfig
from cwcli.tracking.detections import DetectionCounts, DetectionKind
from cwcli.tracking.tracker import TargetTrack, TrackResult

DETECTION_VALUE_NAMES_AND_UNITS: dict[DetectionKind, tuple[tuple[str, str], ...]] = {
    DetectionKind.POSITION: (("position", "m"),),
    DetectionKind.RADAR: (("range", "m"), ("azimuth", "rad"), ("range rate", "m/s")),
}
"""Names and units of a detection's values, by kind."""


def track_metric_tables(
    result: TrackResult, single: FilterConfig, kinds: Mapping[str, DetectionKind]
) -> dict[str, Table]:
    """The table `track` of metrics: `vehicle` is the id of a target, or "" for all, `source` a sensor."""
    rows: list[MetricRow] = []
    for source, count in result.counts.items():
        rows.extend(_sensor_metric_rows(source, count, result, kinds[source]))
    tuned = single if result.tuned is None else result.tuned.config
    rows.append(("", "", "process", "noise", process_noise_density(tuned), process_noise_unit(tuned)))
    if tuned.motion_model.turn_noise > 0.0:
        rows.append(("", "", "process", "turn_noise", turn_noise_density(tuned), "rad/s^1.5"))
    rows.append(("", "", "targets", "count", float(len(result.tracks)), ""))
    for track in result.tracks:
        rows.append((str(track.id), "", "state", "count", float(len(track)), ""))
        rows.append((str(track.id), "", "state", "seen_count", float((track.source >= 0).sum()), ""))
        rows.append((str(track.id), "", "position", "median_sigma", median_position_sigma_m(track), "m"))
    return {"track": table_of_metric_rows("track", rows)}


def _sensor_metric_rows(
    source: str, count: DetectionCounts, result: TrackResult, kind: DetectionKind
) -> list[MetricRow]:
    """The metrics of one sensor: counts, NIS, noise factors and clutter density."""
    quantity = "position" if kind == DetectionKind.POSITION else "radar"
    rows: list[MetricRow] = [("", source, quantity, "read_count", float(count.read), "")]
    rows.append(("", source, quantity, "used_count", float(count.used), ""))
    for reason, n in (*count.rejected.items(), *count.repaired.items()):
        rows.append(("", source, reason, "count", float(n), ""))
    check = result.consistency.get(source)
    if check is not None:
        per = check.dof or math.nan
        for metric, value in (
            ("nis_mean", check.nis_mean),
            ("nis_dof", check.dof),
            ("nis_per_dof", check.nis_mean / per),
            ("nis_lower", check.low / per),
            ("nis_upper", check.high / per),
            ("nis_inside", float(check.is_within_bounds)),
        ):
            rows.append(("", source, quantity, metric, value, ""))
    if result.tuned is not None:
        names = [name for name, _ in DETECTION_VALUE_NAMES_AND_UNITS[kind]]
        rows.extend(
            ("", source, name, "noise_factor", factor, "")
            for name, factor in zip(names, result.tuned.scale.get(source, ()), strict=False)
        )
    if source in result.clutter_density:
        rows.append(("", source, quantity, "clutter_density", result.clutter_density[source], ""))
    return rows


def process_noise_density(config: FilterConfig) -> float:
    """Process noise density of the acceleration or the jerk: the configured one, else the motion model's."""
    return config.motion_model.noise if config.noise is None else config.noise


def turn_noise_density(config: FilterConfig) -> float:
    """Process noise density of the turn rate, rad/s^1.5: the configured one, else the motion model's."""
    return config.motion_model.turn_noise if config.turn_noise is None else config.turn_noise


def process_noise_unit(config: FilterConfig) -> str:
    """Unit of the process noise density of the model."""
    return "m/s^2.5" if "ax_mps2" in config.motion_model.states else "m/s^1.5"


def median_position_sigma_m(track: TargetTrack) -> float:
    """Median over the track of the position's sigma per axis, m."""
    return median_of_values(np.sqrt(0.5 * (track.covariance[:, 0, 0] + track.covariance[:, 1, 1])))
