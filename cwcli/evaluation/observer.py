"""Headline metrics of `observe`: the lateral motion against a truth channel."""

from __future__ import annotations

import math

from cwcli.channels.binding import bind
from cwcli.channels.lateral_state import read_observed
from cwcli.channels.published import OBSERVER
from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import Headline
from cwcli.signals.codec import Role
from cwcli.stages.summaries.observe import truth_errors

METRICS_OF: dict[str, tuple[str, float]] = {
    "lateral_speed_mps": ("observer.lateral_speed_rmse_mps", 1.0),
    "yaw_rate_radps": ("observer.yaw_rate_rmse_degps", math.degrees(1.0)),
    "lateral_deviation_m": ("observer.lateral_deviation_rmse_m", 1.0),
    "heading_deviation_rad": ("observer.heading_deviation_rmse_deg", math.degrees(1.0)),
}
"""State -> metric, and its unit's size in that of the metric."""


def add_observer(headline: Headline, log: Log, *, with_truth: bool) -> None:
    """Add the errors of the observer; nothing if the log has no observer, or no truth of the lateral motion."""
    bound = bind(log.channels, {}, required=(), optional=(OBSERVER.role, Role.LATERAL_TRUTH), where=log.name)
    observer, truth = bound.topic(OBSERVER.role), bound.topic(Role.LATERAL_TRUTH)
    if observer is None or truth is None or not with_truth:
        return
    columns = log.load({observer: None, truth: None})
    if not len(columns[observer]) or not len(columns[truth]):
        return
    for row in truth_errors(read_observed(columns[observer]).track, columns[truth]).records():
        name, scale = METRICS_OF.get(row["state"], ("", 1.0))
        if name and row["n"]:
            headline.add(name, (scale * row["rms"]) ** 2 * row["n"], row["n"])
