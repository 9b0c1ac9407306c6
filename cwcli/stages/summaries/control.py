"""What `control` says: the warnings, what each policy makes of them, and the steps that are published."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cwcli.channels.control_step import ReplayedSteps
from cwcli.control.encounter import POLICIES
from cwcli.control.replayed import Replayed, record_of
from cwcli.pipeline.result import Cell, Section
from cwcli.signals.units import NS_PER_S


def published_steps(replayed: Sequence[Replayed]) -> list[ReplayedSteps]:
    """Of each replay the published steps that are later than all of the one before.

    The replays do not overlap in time but for the seconds before a warning, which only the first one tells.
    """
    last_ns, steps = -1, []
    for one in replayed:
        rows = one.published_rows
        rows = rows[one.stamps_ns[rows] > last_ns]
        last_ns = int(one.stamps_ns[rows[-1]])
        policies = range(len(POLICIES))
        steps.append(
            ReplayedSteps(
                one.event_id,
                one.other_id,
                one.stamps_ns[rows],
                tuple(one.states(policy)[rows] for policy in policies),
                tuple(one.series(policy, rows) for policy in policies),
            )
        )
    return steps


def sections(replayed: Sequence[Replayed], start_ns: int, predictor: str, rule: str) -> tuple[Section, ...]:
    """The warnings, and what each policy makes of them."""
    warnings: list[tuple[Cell, ...]] = []
    outcomes: list[tuple[Cell, ...]] = []
    for one in replayed:
        encounter = one.encounter
        for policy, name in enumerate(POLICIES):
            record = record_of(one, policy, predictor, rule)
            if policy == 0:
                at_s = (one.warning_ns - start_ns) / NS_PER_S
                warnings.append(
                    (one.event_id, one.other_id, at_s, record["warning_distance_m"], record["warning_speed_mps"])
                )
            stopped_s = float(encounter.stopped_time_s[policy])
            outcomes.append(
                (
                    one.event_id,
                    name,
                    "yes" if record["collided"] else "no",
                    record["impact_speed_mps"] if record["collided"] else None,
                    record["min_distance_m"],
                    record["min_gap_m"],
                    record["peak_deceleration_mps2"],
                    record["peak_jerk_mps3"],
                    None if math.isnan(stopped_s) else stopped_s,
                )
            )
    columns = (
        "event",
        "policy",
        "hit",
        "at [m/s]",
        "least [m]",
        "gap [m]",
        "decel [m/s^2]",
        "jerk [m/s^3]",
        "stop [s]",
    )
    return (
        Section(
            "warnings",
            f"Warnings (predictor {predictor}, rule {rule}; times from the log's start)",
            ("event", "vehicle", "at [s]", "distance [m]", "speed [m/s]"),
            tuple(warnings),
        ),
        Section("control", "What would have come of them", columns, tuple(outcomes)),
    )
