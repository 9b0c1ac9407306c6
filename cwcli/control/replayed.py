"""Results of replayed warnings: the host's states under each policy, and the tables of `cwcli control`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cwcli.control.controller import speed_difference_along_heading_mps
from cwcli.control.encounter import BRAKING_POLICY_NAMES, ReplayedWarning
from cwcli.lazy_dataclass import dataclass
from cwcli.measures.outlines import signed_outline_distance_m
from cwcli.metrics.table import ColumnSpec, Table, docs_of_columns, table_from_records
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

STAMP_OF_EVENT_THAT_NEVER_HAPPENED_NS = -1
"""Stamp that stands for an event that did not happen."""
PUBLISHED_REPLAY_STEP_S = 0.05
"""Time between the steps of a replay that are published, s (20 Hz, as the estimated states)."""
TIME_ROUNDING_TOLERANCE_S = 1e-9
"""Tolerance of comparisons of times, s, against rounding."""


@dataclass(frozen=True)
class PublishedReplay:
    """One warning and its replays.

    Attributes:
        event_id: Number of the warning, from 1.
        warning_ns: Stamp at which it was raised.
        other_id: The vehicle of which the host was warned.
        host_size_m, other_size_m: Length and width of the two.
        encounter: The replays under all policies.
    """

    event_id: int
    warning_ns: int
    other_id: str
    host_size_m: tuple[float, float]
    other_size_m: tuple[float, float]
    encounter: ReplayedWarning

    def stamp_ns(self, time_after_warning_s: float) -> int:
        """The stamp of a time of the replay, which counts from the warning, ns; -1 for NaN."""
        if math.isnan(time_after_warning_s):
            return STAMP_OF_EVENT_THAT_NEVER_HAPPENED_NS
        return self.warning_ns + round(time_after_warning_s * NS_PER_S)

    @property
    def step_stamps_ns(self) -> Int64Array:
        """The stamps of the replay's steps, shape (k,), ns."""
        return self.warning_ns + np.round(self.encounter.outcome.time_s * NS_PER_S).astype(np.int64)

    @property
    def published_step_indices(self) -> Int64Array:
        """Indices of the steps that are published: one every 0.05 s, the warning's among them."""
        time_s = self.encounter.outcome.time_s
        steps = np.round(time_s / (time_s[1] - time_s[0])).astype(np.int64)
        return np.flatnonzero(steps % round(PUBLISHED_REPLAY_STEP_S / (time_s[1] - time_s[0])) == 0)

    @property
    def extrapolated_s(self) -> float:
        """How long the replay goes on after the end of the shorter recorded track, s."""
        return max(float(self.encounter.outcome.time_s[-1]) - self.encounter.recorded_until_s, 0.0)

    def host_states(self, policy: int) -> FloatArray:
        """The host's states under a policy, shape (k, 8); jerk and yaw acceleration by differences."""
        outcome = self.encounter.outcome
        time_s = outcome.time_s
        accel, heading = outcome.accel_mps2[policy], outcome.heading_rad[policy]
        yaw_rate = np.gradient(heading, time_s)
        place = outcome.x_m[policy], outcome.y_m[policy]
        derivatives = accel, yaw_rate, np.gradient(accel, time_s), np.full(len(time_s), np.nan)
        return np.column_stack([*place, outcome.speed_mps[policy], heading, *derivatives])

    def gap_m(self, policy: int) -> FloatArray:
        """The gap between the outlines, shape (k,), m; negative where they overlap."""
        outcome, other = self.encounter.outcome, self.encounter.other
        return signed_outline_distance_m(
            other.x_m - outcome.x_m[policy],
            other.y_m - outcome.y_m[policy],
            outcome.heading_rad[policy],
            other.heading_rad,
            self.host_size_m,
            self.other_size_m,
        )

    def time_series_columns(self, policy: int, rows: Int64Array) -> dict[str, Any]:
        """The columns of the table `control_series` for the given steps."""
        outcome, other = self.encounter.outcome, self.encounter.other
        heading_difference = outcome.heading_rad[policy] - other.heading_rad
        return {
            "since_warning_s": outcome.time_s[rows],
            "distance_m": outcome.distance_m[policy, rows],
            "gap_m": self.gap_m(policy)[rows],
            "host_speed_mps": outcome.speed_mps[policy, rows],
            "other_speed_mps": other.speed_mps[rows],
            "speed_difference_mps": speed_difference_along_heading_mps(
                outcome.speed_mps[policy], other.speed_mps, heading_difference
            )[rows],
            "accel_mps2": outcome.accel_mps2[policy, rows],
            "throttle": outcome.throttle[policy, rows],
            "brake_pressure_mpa": outcome.pressure_mpa[policy, rows],
            "is_extrapolated": outcome.time_s[rows] > self.encounter.recorded_until_s + TIME_ROUNDING_TOLERANCE_S,
        }


def control_table_by_warning_and_policy(replayed: Sequence[PublishedReplay], predictor: str, rule: str) -> Table:
    """The table `control`: one row per warning and policy."""
    records = [
        control_table_row(one, policy, predictor, rule)
        for one in replayed
        for policy in range(len(BRAKING_POLICY_NAMES))
    ]
    return table_from_records("control", _CONTROL_COLUMNS, records)


def control_table_row(replay: PublishedReplay, policy: int, predictor: str, rule: str) -> dict[str, Any]:
    """The row of the table `control` for one warning and policy."""
    encounter = replay.encounter
    outcome = encounter.outcome
    at_warning = int(encounter.after_warning_mask.argmax())
    return {
        "event_id": replay.event_id,
        "other_id": replay.other_id,
        "policy": BRAKING_POLICY_NAMES[policy],
        "predictor": predictor,
        "rule": rule,
        "warning_stamp_ns": replay.warning_ns,
        "warning_distance_m": float(outcome.distance_m[policy, at_warning]),
        "warning_speed_mps": float(outcome.speed_mps[policy, at_warning]),
        "is_behind": encounter.is_behind,
        "collided": bool(encounter.collided[policy]),
        "collision_stamp_ns": replay.stamp_ns(float(encounter.collision_time_s[policy])),
        "impact_speed_mps": float(encounter.impact_speed_mps[policy]),
        "min_distance_m": float(encounter.min_distance_m[policy]),
        "min_distance_stamp_ns": replay.stamp_ns(float(encounter.min_distance_time_s[policy])),
        "min_gap_m": float(replay.gap_m(policy)[encounter.after_warning_mask].min()),
        "peak_deceleration_mps2": float(encounter.peak_deceleration_mps2[policy]),
        "peak_jerk_mps3": float(encounter.peak_jerk_mps3[policy]),
        "stopped_stamp_ns": replay.stamp_ns(float(encounter.stopped_time_s[policy])),
        "end_stamp_ns": replay.stamp_ns(float(outcome.time_s[-1])),
        "end_speed_mps": float(outcome.speed_mps[policy, -1]),
        "end_distance_m": float(outcome.distance_m[policy, -1]),
        "extrapolated_s": replay.extrapolated_s,
    }


def control_series_table(replayed: Sequence[PublishedReplay]) -> Table:
    """The table `control_series`: one row per warning, policy and published step (0.05 s)."""
    parts: list[dict[str, Any]] = []
    for one in replayed:
        rows = one.published_step_indices
        for policy, name in enumerate(BRAKING_POLICY_NAMES):
            n = len(rows)
            labels: dict[str, Any] = {
                "event_id": np.full(n, one.event_id),
                "other_id": np.full(n, one.other_id, dtype=object),
                "policy": np.full(n, name, dtype=object),
                "stamp_ns": one.step_stamps_ns[rows],
            }
            parts.append(labels | one.time_series_columns(policy, rows))
    columns: dict[str, Any] = {}
    for name, spec in _SERIES_COLUMNS.items():
        series = np.concatenate([part[name] for part in parts]) if parts else np.zeros(0)
        columns[name] = [str(value) for value in series] if spec.kind is str else series.astype(spec.kind)
    return Table("control_series", columns, docs=docs_of_columns(_SERIES_COLUMNS))


_CONTROL_COLUMNS = {
    "event_id": ColumnSpec(int, "number of the warning in this replay, from 1"),
    "other_id": ColumnSpec(str),
    "policy": ColumnSpec(str),
    "predictor": ColumnSpec(str),
    "rule": ColumnSpec(str),
    "warning_stamp_ns": ColumnSpec(int),
    "warning_distance_m": ColumnSpec(float),
    "warning_speed_mps": ColumnSpec(float),
    "is_behind": ColumnSpec(bool, "the other vehicle is behind the host at the warning; it does not react"),
    "collided": ColumnSpec(bool, "the reference points came nearer than 2.5 m (song2016)"),
    "collision_stamp_ns": ColumnSpec(int, "-1: no collision"),
    "impact_speed_mps": ColumnSpec(float, "relative speed at the collision; NaN: none"),
    "min_distance_m": ColumnSpec(float, "least distance of the reference points from the warning on"),
    "min_distance_stamp_ns": ColumnSpec(int),
    "min_gap_m": ColumnSpec(float, "least gap between the outlines from the warning on; negative: overlap"),
    "peak_deceleration_mps2": ColumnSpec(float, "largest from the warning on; no-action: that of the estimated states"),
    "peak_jerk_mps3": ColumnSpec(
        float, "largest magnitude from the warning on; no-action: that of the estimated states"
    ),
    "stopped_stamp_ns": ColumnSpec(int, "-1: does not stop"),
    "end_stamp_ns": ColumnSpec(int),
    "end_speed_mps": ColumnSpec(float),
    "end_distance_m": ColumnSpec(float),
    "extrapolated_s": ColumnSpec(float, "how long the replay continues after the last recorded state"),
}
"""Columns of the table `control`."""
_SERIES_COLUMNS = {
    "event_id": ColumnSpec(int),
    "other_id": ColumnSpec(str),
    "policy": ColumnSpec(str),
    "stamp_ns": ColumnSpec(int),
    "since_warning_s": ColumnSpec(float),
    "distance_m": ColumnSpec(float, "distance of the reference points"),
    "gap_m": ColumnSpec(float, "gap between the outlines; negative: overlap"),
    "host_speed_mps": ColumnSpec(float),
    "other_speed_mps": ColumnSpec(float),
    "speed_difference_mps": ColumnSpec(float, "song2016 eq. 11"),
    "accel_mps2": ColumnSpec(float),
    "throttle": ColumnSpec(float, "commanded opening, 0 to 1"),
    "brake_pressure_mpa": ColumnSpec(float, "built-up pressure", unit="MPa"),
    "is_extrapolated": ColumnSpec(bool, "one of the two motions is extrapolated, not recorded"),
}
"""Columns of the table `control_series`."""
