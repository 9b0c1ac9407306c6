"""Score tracks against the truth of the targets, when the log has one."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.table import MetricRow
from cwcli.pipeline.result import Cell, SummaryTable
from cwcli.signals.builders.motion import MAP_FRAME_IDS
from cwcli.signals.canonical import TargetTruthSignal
from cwcli.signals.columns import EastNorthRows, FloatArray, Int64Array
from cwcli.signals.geodesy import LocalMap
from cwcli.text import finite_or_none
from cwcli.tracking.gospa import TargetErrors, TargetMoments, TrackingScores, score_tracks
from cwcli.tracking.tracker import TrackResult

GOSPA_CUTOFF_M = 5.0
"""Cut-off distance of GOSPA, m. Chosen by hand; not fitted."""
TARGET_ERROR_NAMES_AND_UNITS = (("x", "m"), ("y", "m"), ("vx", "m/s"), ("vy", "m/s"))
"""Names and units of the components of a target's error."""
MAX_TARGETS_SHOWN = 20
"""Greatest number of targets in the summary; chosen for a short table."""


@dataclass(frozen=True)
class TargetTruthScores:
    """Scores against a truth channel.

    Attributes:
        names: Ids of the true targets; `scores.targets` names them by index.
        scores: GOSPA, switches, errors.
    """

    topic: str
    names: tuple[str, ...]
    scores: TrackingScores


def score_tracks_against_truth(
    truth: TargetTruthSignal,
    result: TrackResult,
    moments_ns: Int64Array,
    *,
    in_map: bool,
    local_map: LocalMap | None,
) -> tuple[TargetTruthScores | None, tuple[str, ...]]:
    """Score the tracks against the truth at the times of the scans.

    Args:
        moments_ns: Times of comparison; the truth is interpolated to them, never across a gap.
        in_map: Whether the tracks are in the map frame.

    Returns:
        The scores, and notes on how the frames were aligned; None where the frames differ or no time has a truth.
    """
    is_geographic = truth.latitude_deg is not None and np.isfinite(truth.latitude_deg).all()
    notes: list[str] = []
    xy = np.column_stack([truth.x_m, truth.y_m])
    if in_map and is_geographic and local_map is not None:
        assert truth.latitude_deg is not None
        assert truth.longitude_deg is not None
        height = np.full(len(xy), local_map.origin_alt_m)
        xy = np.column_stack(local_map.map_from_wgs84(truth.latitude_deg, truth.longitude_deg, height)[:2])
    elif truth.frame_id and (truth.frame_id in MAP_FRAME_IDS) != in_map:
        frame = "the map" if in_map else "the car's frame"
        return None, (f"{truth.source}: the truth is in {truth.frame_id} and the tracks are in {frame}: not compared",)
    elif in_map and local_map is not None:
        notes.append(f"{truth.source}: its map frame is assumed to be that of the ego state")
    velocity = np.column_stack([truth.vx_mps, truth.vy_mps])
    if not np.isfinite(velocity).all():
        velocity = _target_velocities_by_central_differences(truth, xy)
        notes.append(f"{truth.source}: the true velocities are differences of the positions")
    true = TargetMoments(
        truth.stamp_ns, truth.id.codes.astype(np.int64), np.column_stack([xy, velocity])
    ).interpolate_at(moments_ns)
    if not len(true.stamp_ns):
        return None, (f"{truth.source}: no truth at the times of the scans",)
    scores = score_tracks(
        true, TargetMoments.from_tracks(result.tracks).interpolate_at(true.stamp_ns), cutoff_m=GOSPA_CUTOFF_M
    )
    return TargetTruthScores(truth.source, truth.id.values, scores), tuple(notes)


def _target_velocities_by_central_differences(truth: TargetTruthSignal, xy: EastNorthRows) -> FloatArray:
    """Return the velocities (n, 2) of the targets as central differences; NaN for a target with a single row."""
    out = np.full_like(xy, np.nan)
    for code in np.unique(truth.id.codes):
        rows = np.flatnonzero(truth.id.codes == code)
        if len(rows) > 1:
            time_s = (truth.stamp_ns[rows] - truth.stamp_ns[rows[0]]) * 1e-9
            out[rows] = np.gradient(xy[rows], time_s, axis=0)
    return out


def format_score_record_json(result: TrackResult, errors: TargetTruthScores | None) -> str:
    """Return the sums for the metrics as JSON for the record `cwcli.run.track`, so that logs can be pooled."""
    entry: dict[str, Any] = {
        "tracks": len(result.tracks),
        "nis_inside": [check.is_within_bounds for check in result.consistency.values() if check.dof > 0.0],
    }
    if errors is not None:
        scores = errors.scores
        tracked = [target for target in scores.targets if target.n_tracked]
        entry["truth"] = {
            "moments": len(scores.stamp_ns),
            "gospa_sum_m": math.fsum(scores.distance.tolist()),
            "position_square_sum_m2": math.fsum(t.n_tracked * t.position_rmse_m**2 for t in tracked),
            "velocity_square_sum_m2ps2": finite_or_none(
                math.fsum(t.n_tracked * t.velocity_rmse_mps**2 for t in tracked)
            ),
            "tracked": sum(target.n_tracked for target in tracked),
            "present": sum(target.n for target in scores.targets),
            "switches": scores.id_switches,
        }
    return json.dumps(entry)


def target_score_metric_rows(errors: TargetTruthScores) -> list[MetricRow]:
    """Return the scores as rows of the stage's table."""
    rows: list[MetricRow] = []
    topic, names, scores = errors.topic, errors.names, errors.scores
    for target in scores.targets:
        name = names[target.id]
        for (quantity, unit), value in zip(TARGET_ERROR_NAMES_AND_UNITS, target.rmse, strict=True):
            rows.append((name, topic, quantity, "rmse", value, unit))
        rows.append((name, topic, "position", "rmse", target.position_rmse_m, "m"))
        rows.append((name, topic, "velocity", "rmse", target.velocity_rmse_mps, "m/s"))
        rows.append((name, topic, "truth", "count", float(target.n), ""))
        rows.append((name, topic, "truth", "tracked_count", float(target.n_tracked), ""))
        rows.append((name, topic, "id", "switch_count", float(target.id_switches), ""))
    for metric, value, unit in _gospa_metric_rows(scores):
        rows.append(("", topic, "gospa", metric, value, unit))
    rows.append(("", topic, "id", "switch_count", float(scores.id_switches), ""))
    return rows


def _gospa_metric_rows(scores: TrackingScores) -> tuple[tuple[str, float, str], ...]:
    return (
        ("mean", float(scores.distance.mean()), "m"),
        ("localisation_mean", float(scores.localisation.mean()), "m^2"),
        ("missed_mean", float(scores.missed.mean()), "m^2"),
        ("false_mean", float(scores.false.mean()), "m^2"),
        ("missed_targets_mean", float(scores.n_missed.mean()), ""),
        ("false_tracks_mean", float(scores.n_false.mean()), ""),
    )


def build_score_sections(errors: TargetTruthScores, n_tracks: int) -> tuple[SummaryTable, ...]:
    """Build the sections of the summary; GOSPA where there is more than one target or track."""
    found = [_build_target_errors_section(errors)]
    if len(errors.scores.targets) > 1 or n_tracks > 1:
        found.append(_build_gospa_section(errors))
    return tuple(section for section in found if section.rows)


def _build_target_errors_section(errors: TargetTruthScores) -> SummaryTable:
    rows: list[tuple[Cell, ...]] = [
        (errors.names[one.id], one.n, _tracked_percent(one), *(float(value) for value in one.rmse), one.id_switches)
        for one in errors.scores.targets[:MAX_TARGETS_SHOWN]
    ]
    columns = (
        "true target",
        "times compared",
        "times with a track [%]",
        "RMS error of x [m]",
        "RMS error of y [m]",
        "RMS error of vx [m/s]",
        "RMS error of vy [m/s]",
        "changes of track id",
    )
    names = ("true target", "moments", "tracked [%]", "x [m]", "y [m]", "vx [m/s]", "vy [m/s]", "id switches")
    title = f"Errors of the tracks against the truth of {errors.topic}"
    return SummaryTable("errors", title, columns, tuple(rows), names=names)


def _tracked_percent(target: TargetErrors) -> float:
    return 100.0 * target.n_tracked / target.n if target.n else math.nan


def _build_gospa_section(errors: TargetTruthScores) -> SummaryTable:
    parts = _gospa_metric_rows(errors.scores)
    rows: list[tuple[Cell, ...]] = [(name.replace("_", " "), unit, value) for name, value, unit in parts]
    rows.append(("id switches", "", errors.scores.id_switches))
    title = (
        f"GOSPA against the truth of {errors.topic}: position errors, missed and false targets in one distance "
        "(p = 2, cut-off 5 m)"
    )
    return SummaryTable(
        "gospa", title, ("part of GOSPA", "unit", "value"), tuple(rows), names=("part", "unit", "value")
    )
