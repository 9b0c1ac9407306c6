"""Generated drives with planted events: states of cars whose events are known from the formulas of their motion.

Cars move in road coordinates, s along and l to the left of the ego's lane; the road has a constant curvature. The truth
of an event comes from these formulas, the states from the positions by differences, with noise as estimates have.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cwcli.channels.output import make_output_channel
from cwcli.channels.published import EGO_STATE, LANES, REMOTE_STATE, WARNINGS
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import Strings
from cwcli.signals.vehicle_state import StateFlag

T0_NS = 1_700_000_000_000_000_000
RATE_HZ = 20.0
LENGTH_M, WIDTH_M = 4.5, 1.8
LANE_M = 3.5
Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass
class Planted:
    """A drive before it is written.

    Attributes:
        time_s: Shape (n,).
        curvature_1pm: Of the road.
        ego, others: Name -> (s, l, direction): shape (n,) each; direction 1 or -1 (oncoming).
        truth: Event -> (start, end) in s.
        implied: Events that may be found too, because the planted one brings them about.
    """

    time_s: Array
    curvature_1pm: float
    ego: tuple[Array, Array]
    others: dict[str, tuple[Array, Array]]
    truth: dict[str, tuple[float, float]] = field(default_factory=dict)
    implied: set[str] = field(default_factory=set)
    lane_offset_m: Array | None = None
    gps_gap_s: tuple[float, float] | None = None
    imu_gap_s: tuple[float, float] | None = None
    warnings_s: list[tuple[float, float, str]] = field(default_factory=list)
    other_system_s: list[tuple[float, float]] = field(default_factory=list)
    bridged: bool = False
    free_path: dict[str, Array] = field(default_factory=dict)


def smooth_step(share: Array) -> Array:
    """0 to 1 without a jerk at the ends: 6 u^5 - 15 u^4 + 10 u^3."""
    u = np.clip(share, 0.0, 1.0)
    return np.asarray(u**3 * (6.0 * u**2 - 15.0 * u + 10.0))


def first_and_last(time_s: Array, holds: Any) -> tuple[float, float]:
    rows = np.flatnonzero(holds)
    return float(time_s[rows[0]]), float(time_s[rows[-1]])


def quiet_drive(rng: np.random.Generator, duration_s: float = 60.0) -> Planted:
    """The ego at a constant speed, a leader 3 s ahead, one in the lane to the left and one that comes towards it."""
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    speed_mps = rng.uniform(12.0, 25.0)
    wave = 0.8 * np.sin(2 * np.pi * time_s / rng.uniform(25.0, 60.0) + rng.uniform(0, 6))
    way_m = np.cumsum(speed_mps + wave) / RATE_HZ
    wander_m = 0.12 * np.sin(2 * np.pi * time_s / rng.uniform(12.0, 30.0))
    leader = way_m + 3.0 * speed_mps + LENGTH_M
    beside = way_m[0] + rng.uniform(20.0, 60.0) + np.cumsum(speed_mps + wave) / RATE_HZ
    oncoming = rng.uniform(0.3, 0.9) * way_m[-1] - np.cumsum(np.full(len(time_s), speed_mps)) / RATE_HZ
    return Planted(
        time_s,
        float(rng.choice([0.0, 1.0, -1.0]) / rng.uniform(600.0, 2000.0)),
        (way_m, wander_m),
        {
            "leader": (leader, np.zeros(len(time_s))),
            "beside": (beside, np.full(len(time_s), LANE_M)),
            "oncoming": (oncoming, np.full(len(time_s), 2.3 * LANE_M)),
        },
    )


def _speed(drive: Planted) -> Array:
    return np.gradient(drive.ego[0], drive.time_s)


def _with_speed(drive: Planted, speed_mps: Array) -> None:
    drive.ego = (drive.ego[0][0] + np.cumsum(speed_mps) / RATE_HZ, drive.ego[1])


def _braking(drive: Planted, at_s: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Speed and acceleration with a braking of 5 to 8 m/s^2, and a slow return to the old speed."""
    t = drive.time_s
    peak, hold = rng.uniform(5.0, 8.0), rng.uniform(0.6, 1.2)
    accel = -peak * (smooth_step((t - at_s) / 0.4) - smooth_step((t - at_s - 0.4 - hold) / 0.4))
    lost = -accel.sum() / RATE_HZ
    accel += lost / 15.0 * (smooth_step((t - at_s - 4.0) / 1.0) - smooth_step((t - at_s - 19.0) / 1.0))
    return accel, t


def plant_hard_brake(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    accel, t = _braking(drive, at_s, rng)
    _with_speed(drive, _speed(drive) + np.cumsum(accel) / RATE_HZ)
    drive.others = {"beside": (drive.others["beside"][0] + 200.0, drive.others["beside"][1])}
    total = np.gradient(_speed(drive), t)
    drive.truth["hard-brake"] = first_and_last(t, total <= -3.92)


def plant_hard_brake_other(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    accel, t = _braking(drive, at_s, rng)
    s, _ = drive.others["leader"]
    own = s + 25.0 + np.cumsum(np.cumsum(accel)) / RATE_HZ**2
    drive.others = {"leader": (own, np.full(len(t), LANE_M))}
    drive.truth["hard-brake-other"] = first_and_last(t, np.gradient(np.gradient(own, t), t) <= -3.92)
    drive.implied |= {"overtaking"}


def _plant_closing_leader(drive: Planted, rng: np.random.Generator, at_s: float) -> Array:
    """The gap to the leader closes and opens as a cosine; returns the time to contact, known from gap and closing."""
    t = drive.time_s
    width_s, least_m = rng.uniform(2.0, 2.4), rng.uniform(1.0, 2.0)
    far_m = rng.uniform(45.0, 60.0)
    gap_m = least_m + (far_m - least_m) * 0.5 * (1.0 - np.cos(np.clip((t - at_s) / width_s, -np.pi, np.pi)))
    ego_s, ego_l = drive.ego
    drive.others = {"leader": (ego_s + gap_m + LENGTH_M, ego_l)}
    closing = -np.gradient(gap_m, t)
    ttc_s = np.where(closing > 0.01, gap_m / np.maximum(closing, 0.01), np.inf)
    drive.truth["near-miss"] = first_and_last(t, ttc_s < 1.5)
    drive.implied |= {"tailgating", "hard-brake-other", "hard-brake"}
    return ttc_s


def plant_near_miss(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    _plant_closing_leader(drive, rng, at_s)


def plant_tailgating(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    t = drive.time_s
    lasts_s = rng.uniform(4.0, 8.0)
    share = smooth_step((t - at_s) / 6.0) - smooth_step((t - at_s - 6.0 - lasts_s) / 6.0)
    speed = _speed(drive)
    headway_s = 3.0 - share * (3.0 - rng.uniform(0.5, 0.7))
    drive.others = {"leader": (drive.ego[0] + headway_s * speed + LENGTH_M, drive.ego[1])}
    drive.truth["tailgating"] = first_and_last(t, headway_s < 0.9)
    drive.implied |= {"hard-brake-other"}  # the leader lets the gap shrink


def _cut(drive: Planted, rng: np.random.Generator, at_s: float, *, is_in: bool) -> None:
    t = drive.time_s
    takes_s, side = rng.uniform(3.0, 6.0), float(rng.choice([-1.0, 1.0]))
    share = smooth_step((t - at_s) / takes_s)
    aside_m = side * LANE_M * ((1.0 - share) if is_in else share)
    headway_s = rng.uniform(1.3, 2.2)
    drive.others = {"cutter": (drive.ego[0] + headway_s * _speed(drive).mean() + LENGTH_M, aside_m)}
    off_m = np.abs(aside_m - np.interp(drive.others["cutter"][0], *drive.ego))
    drive.truth["cut-in" if is_in else "cut-out"] = first_and_last(
        t, (off_m < LANE_M / 2 + WIDTH_M / 2) & (off_m > LANE_M / 2 - WIDTH_M / 2)
    )


def plant_cut_in(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    _cut(drive, rng, at_s, is_in=True)


def plant_cut_out(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    _cut(drive, rng, at_s, is_in=False)


def plant_turn_across(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    """An oncoming car, one lane to the left, turns left on an arc of 9 m across the way, 4 s before the ego."""
    drive.curvature_1pm = 0.0
    t = drive.time_s
    turn_mps, radius_m = rng.uniform(6.0, 8.0), 9.0
    gap_s = rng.uniform(3.6, 4.6)
    place_m = float(np.interp(at_s + gap_s, t, drive.ego[0]))
    driven = (t - at_s) * turn_mps
    straight = np.minimum(driven, 0.0)
    angle = np.clip(driven / radius_m, 0.0, np.pi / 2)
    beyond = np.maximum(driven - radius_m * np.pi / 2, 0.0)
    x = place_m + radius_m - straight - radius_m * np.sin(angle)
    y = LANE_M - radius_m * (1.0 - np.cos(angle)) - beyond
    drive.others = {"turner": (x, y)}
    drive.free_path["turner"] = np.column_stack([x, y])
    off_m = np.abs(y - drive.ego[1])
    drive.truth["turn-across"] = first_and_last(t, off_m < LANE_M / 2 + WIDTH_M / 2)


def plant_overtaking(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    t = drive.time_s
    slower = rng.uniform(3.0, 6.0)
    s = drive.ego[0] - slower * (t - at_s)
    drive.others = {"slow": (s, np.full(len(t), -LANE_M))}
    drive.truth["overtaking"] = first_and_last(t, np.abs(s - drive.ego[0]) < LENGTH_M)


def plant_lane_change(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    t = drive.time_s
    takes_s, side = rng.uniform(3.5, 7.0), float(rng.choice([-1.0, 1.0]))
    share = smooth_step((t - at_s) / takes_s)
    drive.ego = (drive.ego[0], drive.ego[1] + side * LANE_M * share)
    drive.others = {"leader": (drive.others["leader"][0] + 120.0, drive.others["leader"][1])}
    drive.truth["lane-change"] = first_and_last(t, (share >= 0.05) & (share <= 0.95))


def plant_lane_departure(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    t = drive.time_s
    side, out_m = float(rng.choice([-1.0, 1.0])), rng.uniform(1.1, 1.4)
    drift_m = side * out_m * (smooth_step((t - at_s) / 4.0) - smooth_step((t - at_s - 6.0) / 4.0))
    drive.ego = (drive.ego[0], drive.ego[1] + drift_m)
    drive.others = {}
    drive.lane_offset_m = drive.ego[1]
    drive.truth["lane-departure"] = first_and_last(t, LANE_M / 2 - np.abs(drive.ego[1]) < 0.9)


def plant_stop_and_go(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    t = drive.time_s
    usual = 7.0
    go_s, stop_s = rng.uniform(6.0, 8.0), rng.uniform(2.5, 4.0)
    speed = np.full(len(t), usual)
    for k in range(3):
        begin = at_s + k * (go_s + stop_s)
        speed -= usual * (smooth_step((t - begin) / 4.0) - smooth_step((t - begin - 4.0 - stop_s) / 4.0))
    _with_speed(drive, np.maximum(speed, 0.0))
    drive.others = {}
    drive.truth["stop-and-go"] = first_and_last(t, speed < 0.5)


def plant_gnss_outage(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    drive.gps_gap_s = (at_s, at_s + rng.uniform(3.0, 10.0))
    drive.truth["gnss-outage"] = drive.gps_gap_s


def plant_sensor_gap(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    drive.imu_gap_s = (at_s, at_s + rng.uniform(0.8, 3.0))
    drive.truth["sensor-gap"] = drive.imu_gap_s


def _plant_warning(drive: Planted, rng: np.random.Generator, at_s: float, verdict: str) -> None:
    span = (at_s, at_s + rng.uniform(0.6, 2.0))
    drive.warnings_s = [(*span, "leader")]
    drive.truth["warning"] = drive.truth[verdict] = span
    drive.implied |= {"disagreement"}


def plant_false_warning(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    _plant_warning(drive, rng, at_s, "warning-false")


def plant_true_warning(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    """A conflict begins a second before the contact."""
    begin_s, _ = first_and_last(drive.time_s, _plant_closing_leader(drive, rng, at_s) < 1.0)
    _plant_warning(drive, rng, begin_s - rng.uniform(0.3, 2.0), "warning-true")


def plant_late_warning(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    begin_s, end_s = first_and_last(drive.time_s, _plant_closing_leader(drive, rng, at_s) < 1.0)
    _plant_warning(drive, rng, begin_s + rng.uniform(0.3, 0.7) * (end_s - begin_s), "warning-late")


def plant_undecided_warning(drive: Planted, rng: np.random.Generator, _: float) -> None:
    """The drive ends before a conflict could have followed."""
    _plant_warning(drive, rng, float(drive.time_s[-1]) - rng.uniform(1.0, 1.8), "warning-undecided")


def plant_disagreement(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    span = (at_s, at_s + rng.uniform(0.6, 2.0))
    drive.other_system_s = [span]
    drive.truth["disagreement"] = span


def plant_doubt(drive: Planted, rng: np.random.Generator, at_s: float) -> None:
    drive.bridged = True
    drive.truth["doubt"] = (0.0, float(drive.time_s[-1]))


PLANTS: dict[str, Callable[[Planted, np.random.Generator, float], None]] = {
    "hard-brake": plant_hard_brake,
    "hard-brake-other": plant_hard_brake_other,
    "near-miss": plant_near_miss,
    "tailgating": plant_tailgating,
    "cut-in": plant_cut_in,
    "cut-out": plant_cut_out,
    "turn-across": plant_turn_across,
    "overtaking": plant_overtaking,
    "lane-change": plant_lane_change,
    "lane-departure": plant_lane_departure,
    "stop-and-go": plant_stop_and_go,
    "gnss-outage": plant_gnss_outage,
    "sensor-gap": plant_sensor_gap,
    "warning-false": plant_false_warning,
    "warning-true": plant_true_warning,
    "warning-late": plant_late_warning,
    "warning-undecided": plant_undecided_warning,
    "disagreement": plant_disagreement,
    "doubt": plant_doubt,
}
"""Event -> what plants it in a quiet drive at a time."""


def planted_drive(kind: str, seed: int) -> Planted:
    """A quiet drive of 60 s with one planted event from 20 s to 30 s, or at its end; the same for the same seed."""
    rng = np.random.default_rng(seed)
    drive = quiet_drive(rng)
    at_s = float(rng.uniform(20.0, 30.0))
    PLANTS[kind](drive, rng, at_s)
    return drive


def _states(drive: Planted, s: Array, l: Array, rng: np.random.Generator, path: Array | None = None) -> Array:  # noqa: E741
    """States (n, 8) by differences of the positions, with noise."""
    k = drive.curvature_1pm
    if path is not None:
        x, y = path.T
    elif k:
        x, y = np.sin(k * s) * (1.0 / k - l), 1.0 / k - np.cos(k * s) * (1.0 / k - l)
    else:
        x, y = s, l
    vx, vy = np.gradient(x, drive.time_s), np.gradient(y, drive.time_s)
    speed = np.hypot(vx, vy)
    moving = speed > 0.3
    heading = np.unwrap(np.interp(drive.time_s, drive.time_s[moving], np.unwrap(np.arctan2(vy, vx)[moving])))
    accel = np.gradient(speed, drive.time_s)
    yaw_rate = np.gradient(heading, drive.time_s)

    def noise(sigma: float) -> Array:
        return np.convolve(rng.normal(0.0, sigma * 4.0, len(speed)), np.full(16, 1 / 16), "same")

    zeros = np.zeros(len(speed))
    return np.column_stack(
        [
            x + noise(0.05),
            y + noise(0.05),
            speed + noise(0.03),
            heading + noise(0.001),
            accel + noise(0.05),
            yaw_rate + noise(0.001),
            zeros,
            zeros,
        ]
    )


def write_drive(drive: Planted, path: Path, seed: int = 0) -> Path:
    """Write a drive as an annotated log with raw messages of a GNSS receiver and an IMU."""
    rng = np.random.default_rng([seed, 7])
    stamp_ns = T0_NS + np.round(drive.time_s * 1e9).astype(np.int64)
    n = len(stamp_ns)
    covariance = np.broadcast_to(np.eye(8) * 0.01, (n, 8, 8))
    flags = np.zeros(n, np.uint8)
    if drive.bridged:
        flags[drive.time_s % 2.0 < 1.2] = StateFlag.BRIDGED
    ego = VehicleStates.from_ego_states(
        stamp_ns, _states(drive, *drive.ego, rng), covariance, size_m=(LENGTH_M, WIDTH_M), flags=flags
    )
    with LogWriter(path) as log:
        log.write_columns(make_vehicle_state_channel(EGO_STATE, ego, None))
        if drive.others:
            log.write_columns(make_vehicle_state_channel(REMOTE_STATE, _others(drive, stamp_ns, rng), None))
        if drive.lane_offset_m is not None:
            log.write_columns(_lanes(drive, stamp_ns))
        for topic, schema, rate_hz, gap in (
            ("/gps/fix", "sensor_msgs/msg/NavSatFix", 10.0, drive.gps_gap_s),
            ("/imu/data", "sensor_msgs/msg/Imu", 50.0, drive.imu_gap_s),
        ):
            at_s = np.arange(0.0, drive.time_s[-1], 1.0 / rate_hz)
            if gap is not None:
                at_s = np.unique([*at_s[(at_s <= gap[0]) | (at_s >= gap[1])], *gap])
            channel = log.add_channel(topic, "cdr", log.add_schema(schema, "ros2msg", b"uint8 x"))
            times = T0_NS + np.round(at_s * 1e9).astype(np.int64)
            log.write_messages(channel, times, [b"\0\1\0\0\0"] * len(times))
        log.write_columns(_warnings(drive))
        at_s = np.arange(0.0, drive.time_s[-1], 0.05)
        is_set = [any(a <= t <= b for a, b in drive.other_system_s) for t in at_s]
        flag = log.add_channel("/adas/fcw", "json", log.add_schema("Fcw", "jsonschema", b"{}"))
        log.write_messages(
            flag,
            T0_NS + np.round(at_s * 1e9).astype(np.int64),
            [b'{"data": true}' if each else b'{"data": false}' for each in is_set],
        )
    return path


def _others(drive: Planted, stamp_ns: Any, rng: np.random.Generator) -> VehicleStates:
    """The states of all others, in order of time."""
    n, names = len(stamp_ns), tuple(drive.others)
    state = np.concatenate(
        [_states(drive, *drive.others[name], rng, drive.free_path.get(name)) for name in names], axis=0
    )
    codes = np.repeat(np.arange(len(names), dtype=np.int32), n)
    stamps = np.tile(stamp_ns, len(names))
    order = np.argsort(stamps, kind="stable")
    return VehicleStates(
        Strings(codes[order], names),
        stamps[order],
        stamps[order],
        state[order],
        np.broadcast_to(np.eye(8) * 0.01, (len(order), 8, 8)),
        np.full(len(order), LENGTH_M),
        np.full(len(order), WIDTH_M),
        np.zeros(len(order), np.uint8),
    )


def _lanes(drive: Planted, stamp_ns: Any) -> Any:
    assert drive.lane_offset_m is not None
    found = np.ones(len(stamp_ns), np.bool_)
    fields = {
        "stamp_ns": stamp_ns,
        "left.found": found,
        "left.lateral_m": LANE_M / 2 - drive.lane_offset_m,
        "right.found": found,
        "right.lateral_m": -LANE_M / 2 - drive.lane_offset_m,
    }
    return make_output_channel(LANES, stamp_ns, fields)


def _warnings(drive: Planted) -> Any:
    """The channel of warnings: each raised, held every 0.1 s, and cleared 1 s later."""
    at_s: list[float] = []
    state: list[int] = []
    number: list[int] = []
    for k, (start, end, _) in enumerate(drive.warnings_s):
        held = [*np.arange(start + 0.1, end, 0.1).tolist(), end]
        at_s += [start, *held, end + 1.0]
        state += [1, *[2] * len(held), 3]
        number += [k + 1] * (len(held) + 2)
    n = len(at_s)
    stamp_ns = T0_NS + np.round(np.array(at_s) * 1e9).astype(np.int64)
    fields: dict[str, Any] = {
        "stamp_ns": stamp_ns,
        "known_ns": stamp_ns,
        "rule": Strings(np.zeros(n, np.int32), ("cwcli",)),
        "event_id": np.array(number, np.int64),
        "state": np.array(state, np.int32),
        "host_id": Strings(np.zeros(n, np.int32), ("ego",)),
        "other_id": Strings(np.zeros(n, np.int32), ("leader",)),
    }
    return make_output_channel(WARNINGS, stamp_ns, fields)
