"""Headline metrics of `track`, from its record: errors of the targets against their truth, and consistency."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from cwcli.logs.log import Log
from cwcli.metrics.headline import Headline
from cwcli.stages.records import json_entry, number, run_records
from cwcli.stages.track_truth import TruthScores
from cwcli.text import finite
from cwcli.tracking.tracker import TrackResult


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


def add_tracking(headline: Headline, log: Log, *, with_truth: bool) -> None:
    """Add the metrics of the tracks; nothing if the log has none, or if an older version made them."""
    entry: Mapping[str, Any] = json_entry(run_records(log).get("track", {}), "scores", dict)
    if not entry:
        return
    headline.count("tracking.targets_count", number(entry, "tracks"))
    inside = entry.get("nis_inside")
    if isinstance(inside, list):
        headline.share("tracking.nis_inside_share", [bool(each) for each in inside])
    truth = entry.get("truth")
    if not with_truth or not isinstance(truth, dict):
        return
    tracked = number(truth, "tracked")
    headline.add("tracking.gospa_m", number(truth, "gospa_sum_m"), number(truth, "moments"))
    headline.add("tracking.position_rmse_m", number(truth, "position_square_sum_m2"), tracked)
    headline.add("tracking.velocity_rmse_mps", number(truth, "velocity_square_sum_m2ps2"), tracked)
    headline.add("tracking.tracked_share", tracked, number(truth, "present"))
    headline.count("tracking.switch_count", number(truth, "switches"))
