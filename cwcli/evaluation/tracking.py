"""Headline metrics of `track`, from its record: errors of the targets against their truth, and consistency."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import Headline
from cwcli.stages.records import json_entry, number, run_records


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
