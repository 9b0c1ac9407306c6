"""Tracks against the truth of the targets, when the log has one."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cwcli.signals.build_motion import MAP_FRAMES
from cwcli.signals.canonical import TargetTruthSignal
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.geodesy import LocalMap
from cwcli.text import finite
from cwcli.tracking.gospa import TargetMoments, TrackingScores, score
from cwcli.tracking.tracker import TrackResult

CUTOFF_M = 5.0


@dataclass(frozen=True)
class TruthScores:
    """Scores against a truth channel.

    Attributes:
        topic: The truth channel.
        names: Ids of the true targets; `scores.targets` names them by index.
        scores: GOSPA, switches, errors.
    """

    topic: str
    names: tuple[str, ...]
    scores: TrackingScores


def scores_of(
    truth: TargetTruthSignal,
    result: TrackResult,
    moments_ns: Int64Array,
    *,
    in_map: bool,
    local_map: LocalMap | None,
) -> tuple[TruthScores | None, tuple[str, ...]]:
    """Compare the tracks with the truth at the moments of the scans, and say how the frames were brought together.

    Args:
        truth: Where the targets were.
        result: The tracks.
        moments_ns: When to compare; the truth is interpolated to them, never across a gap.
        in_map: The tracks' frame is the map.
        local_map: Where the map lies on the earth, if that is known.

    Returns:
        None where the frames don't fit, or no moment has a truth.
    """
    is_geographic = truth.latitude_deg is not None and np.isfinite(truth.latitude_deg).all()
    notes: list[str] = []
    xy = np.column_stack([truth.x_m, truth.y_m])
    if in_map and is_geographic and local_map is not None:
        assert truth.latitude_deg is not None
        assert truth.longitude_deg is not None
        height = np.full(len(xy), local_map.origin_alt_m)
        xy = np.column_stack(local_map.map_from_wgs84(truth.latitude_deg, truth.longitude_deg, height)[:2])
    elif truth.frame_id and (truth.frame_id in MAP_FRAMES) != in_map:
        frame = "the map" if in_map else "the car's frame"
        return None, (f"{truth.source}: the truth is in {truth.frame_id} and the tracks are in {frame}: not compared",)
    elif in_map and local_map is not None:
        notes.append(f"{truth.source}: its map is taken to be that of the ego state")
    velocity = np.column_stack([truth.vx_mps, truth.vy_mps])
    if not np.isfinite(velocity).all():
        velocity = _driven(truth, xy)
        notes.append(f"{truth.source}: the true velocities are differences of the positions")
    true = TargetMoments(truth.stamp_ns, truth.id.codes.astype(np.int64), np.column_stack([xy, velocity])).at(
        moments_ns
    )
    if not len(true.stamp_ns):
        return None, (f"{truth.source}: no truth at the times of the scans",)
    scores = score(true, TargetMoments.of(result.tracks).at(true.stamp_ns), cutoff_m=CUTOFF_M)
    return TruthScores(truth.source, truth.id.values, scores), tuple(notes)


def _driven(truth: TargetTruthSignal, xy: FloatArray) -> FloatArray:
    """Velocities (n, 2) of each target as central differences; NaN for one with a single row."""
    out = np.full_like(xy, np.nan)
    for code in np.unique(truth.id.codes):
        rows = np.flatnonzero(truth.id.codes == code)
        if len(rows) > 1:
            time_s = (truth.stamp_ns[rows] - truth.stamp_ns[rows[0]]) * 1e-9
            out[rows] = np.gradient(xy[rows], time_s, axis=0)
    return out


def score_record(result: TrackResult, errors: TruthScores | None) -> str:
    """What the metrics need, as JSON for the record `cwcli.run.track`: sums, so that logs can be pooled."""
    entry: dict[str, Any] = {
        "tracks": len(result.tracks),
        "nis_inside": [check.is_inside for check in result.consistency.values() if check.dof > 0.0],
    }
    if errors is not None:
        scores = errors.scores
        tracked = [target for target in scores.targets if target.n_tracked]
        entry["truth"] = {
            "moments": len(scores.stamp_ns),
            "gospa_sum_m": math.fsum(scores.distance.tolist()),
            "position_square_sum_m2": math.fsum(t.n_tracked * t.position_rmse_m**2 for t in tracked),
            "velocity_square_sum_m2ps2": finite(math.fsum(t.n_tracked * t.velocity_rmse_mps**2 for t in tracked)),
            "tracked": sum(target.n_tracked for target in tracked),
            "present": sum(target.n for target in scores.targets),
            "switches": scores.id_switches,
        }
    return json.dumps(entry)
