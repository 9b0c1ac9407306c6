"""The scenes of trials: from a few numbers to a scenario document, with its principal other and its event.

All numbers are in SI units. The host drives east from the origin, on the right of the road. Gaps are between outlines.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass
from cwcli.simulation.scenario import EGO_VEHICLE_KEY

CAR_LENGTH_AND_WIDTH_M = (4.5, 1.8)
"""Length and width of the cars of the trials, m. Chosen: a mid-size passenger car."""
LANE_WIDTH_M = 3.5
"""Width of a lane, m. Chosen by hand: the usual one of European rural roads and of test tracks."""
PRINCIPAL_OTHER_VEHICLE_NAME = "other"
"""Name of the principal other vehicle in a scene."""
STEADY_TIME_BEFORE_EVENT_S = 5.0
"""Time of steady driving before the event, s, in which the filters settle. Chosen by hand: until then the heading of a
car that has just started is known to half a degree only, which is a metre at the place of a contact 3.5 s ahead."""
APPROACH_START_TTC_S = 7.0 + STEADY_TIME_BEFORE_EVENT_S
"""Time to collision at which an approach begins, s. Chosen by hand: the filters have settled 7 s before the contact,
which is longer than every published time to collision."""
SCENE_TIME_AFTER_CONTACT_S = 1.0
"""Time that a scene goes on after the contact, s. Chosen by hand."""
DEFAULT_DECELERATION_BUILD_UP_TIME_S = 0.5
"""Time in which a lead builds up its deceleration, s, where a clause gives none. Chosen by hand."""
DEFAULT_LANE_CHANGE_DURATION_S = 3.0
"""Duration of a lane change, s, where a clause gives none. Chosen by hand."""
YAW_RATE_BUILD_UP_TIME_S = 0.3
"""Time in which a vehicle builds up its yaw rate, s. Chosen by hand."""


@dataclass(frozen=True)
class Scene:
    """A kind of trial.

    Attributes:
        build: Numbers by name, SI -> the built scene; None: a drive in a lane (`lane_trials`).
        required, optional: Names of the numbers that it takes.
    """

    build: Callable[[Mapping[str, float]], BuiltScene] | None
    required: tuple[str, ...]
    optional: tuple[str, ...] = ()

    def check_keys(self, names: Collection[str], trial: str, where: str) -> None:
        """Refuse an unknown or a missing number.

        Raises:
            UsageError: There is one.
        """
        known = (*self.required, *self.optional)
        for name in names:
            if name not in known:
                raise UsageError(
                    f"{trial}: given.{name} is unknown",
                    where=where,
                    hint=hint_at_closest_or_all_known_names(name, known),
                )
        for name in self.required:
            if name not in names:
                raise UsageError(f"{trial}: given.{name} is missing", where=where)


@dataclass(frozen=True)
class BuiltScene:
    """A scene as a scenario document without sensors.

    Attributes:
        document: Duration and vehicles (docs/scenarios.md).
        has_radar: The host has a radar, and is warned of what it detects instead of what sends messages.
    """

    document: Mapping[str, Any]
    event_s: float
    other: str = PRINCIPAL_OTHER_VEHICLE_NAME
    has_radar: bool = False


def _document_of_vehicles(duration_s: float, **vehicles: Mapping[str, Any]) -> dict[str, Any]:
    """A document of vehicles, with friction that permits full braking."""
    return {"duration_s": duration_s, "friction": 1.2, "vehicles": dict(vehicles)}


def _centre_distance_m(gap_m: float, length_m: float = CAR_LENGTH_AND_WIDTH_M[0]) -> float:
    """Distance of the centres of two vehicles on one line with a gap between their outlines."""
    return gap_m + 0.5 * (CAR_LENGTH_AND_WIDTH_M[0] + length_m)


def _impossible_scene_error(text: str) -> UsageError:
    return UsageError(f"an impossible trial: {text}", hint="check the speeds, the gap and the decelerations")


def build_approach(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """The host closes in on a vehicle ahead that stands or drives at constant speed.

    The time to collision at the start is `approach_time`, so the gap is the closing speed times that.
    """
    host, other = trial_numbers["host_speed"], trial_numbers.get("other_speed", 0.0)
    if not host > other:
        raise _impossible_scene_error(f"the host ({host:.2f} m/s) does not close in on the other ({other:.2f} m/s)")
    approach_s = trial_numbers.get("approach_time", APPROACH_START_TTC_S)
    length_m = trial_numbers.get("other_length", CAR_LENGTH_AND_WIDTH_M[0])
    gap_m = (host - other) * approach_s
    vehicles: dict[str, dict[str, Any]] = {
        EGO_VEHICLE_KEY: {"speed_mps": host},
        PRINCIPAL_OTHER_VEHICLE_NAME: {
            "speed_mps": other,
            "x_m": _centre_distance_m(gap_m, length_m),
            "y_m": trial_numbers.get("lateral_offset", 0.0),
            "length_m": length_m,
            "width_m": trial_numbers.get("other_width", CAR_LENGTH_AND_WIDTH_M[1]),
        },
    }
    return BuiltScene(_document_of_vehicles(approach_s + SCENE_TIME_AFTER_CONTACT_S, **vehicles), 0.0)


def build_standing_radar_target(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """The host's radar detects what stands in its lane and sends no messages; a radar does not measure height.

    What it is, a car, a plate on the road or a bridge, is up to the judge: the returns are the same.
    """
    built = build_approach(trial_numbers)
    vehicles = {name: dict(table) for name, table in built.document["vehicles"].items()}
    vehicles[PRINCIPAL_OTHER_VEHICLE_NAME]["v2x"] = False
    return BuiltScene({**built.document, "vehicles": vehicles}, built.event_s, has_radar=True)


def build_braking_lead(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """The host follows at a constant gap and speed; the lead brakes, and the host does not react."""
    speed, gap_m, deceleration = trial_numbers["host_speed"], trial_numbers["gap"], trial_numbers["deceleration"]
    if deceleration <= 0.0 or gap_m <= 0.0:
        raise _impossible_scene_error(
            f"a gap of {gap_m:g} m and a deceleration of {deceleration:g} m/s^2 must be positive"
        )
    ramp_s = trial_numbers.get("ramp_time", DEFAULT_DECELERATION_BUILD_UP_TIME_S)
    # contact: the sum of the gap and the lead's way is the host's way; the ramp delays the braking by half of itself
    until_s = 0.5 * ramp_s + math.sqrt(2.0 * gap_m / deceleration)
    stop_s = 0.5 * ramp_s + speed / deceleration
    if until_s > stop_s:  # the lead stands before
        until_s = 0.5 * ramp_s + (gap_m + 0.5 * speed**2 / deceleration) / speed
    end_s = STEADY_TIME_BEFORE_EVENT_S + max(until_s, stop_s + ramp_s) + SCENE_TIME_AFTER_CONTACT_S
    braking = [
        {"from_s": 0, "accel_mps2": 0},
        {
            "from_s": STEADY_TIME_BEFORE_EVENT_S,
            "speed_mps": 0,
            "limit_mps2": deceleration,
            "jerk_mps3": deceleration / ramp_s,
        },
    ]
    vehicles: dict[str, dict[str, Any]] = {
        EGO_VEHICLE_KEY: {"speed_mps": speed},
        PRINCIPAL_OTHER_VEHICLE_NAME: {"speed_mps": speed, "x_m": _centre_distance_m(gap_m), "longitudinal": braking},
    }
    return BuiltScene(_document_of_vehicles(end_s, **vehicles), STEADY_TIME_BEFORE_EVENT_S)


def build_convoy(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """The host follows two vehicles; the first brakes hard, the second a reaction time later."""
    built = build_braking_lead(trial_numbers)
    speed, gap_m, deceleration = trial_numbers["host_speed"], trial_numbers["gap"], trial_numbers["deceleration"]
    reaction_s = trial_numbers.get("reaction_time", 1.0)
    jerk = deceleration / trial_numbers.get("ramp_time", DEFAULT_DECELERATION_BUILD_UP_TIME_S)
    vehicles = {name: dict(table) for name, table in built.document["vehicles"].items()}
    first = {**vehicles[PRINCIPAL_OTHER_VEHICLE_NAME], "x_m": 2.0 * vehicles[PRINCIPAL_OTHER_VEHICLE_NAME]["x_m"]}
    vehicles["first"] = first
    vehicles[PRINCIPAL_OTHER_VEHICLE_NAME]["longitudinal"] = [
        {"from_s": 0, "accel_mps2": 0},
        {
            "from_s": STEADY_TIME_BEFORE_EVENT_S + reaction_s,
            "speed_mps": 0,
            "limit_mps2": deceleration,
            "jerk_mps3": jerk,
        },
    ]
    if gap_m + 0.5 * speed * reaction_s <= 0.0:
        raise _impossible_scene_error("the convoy has no gap")
    document = _document_of_vehicles(float(built.document["duration_s"]) + reaction_s, **vehicles)
    return BuiltScene(document, STEADY_TIME_BEFORE_EVENT_S)


def lane_change_yaw_rate_dps(speed_mps: float, offset_m: float, duration_s: float) -> float:
    """Yaw rate (deg/s) of the two halves of a lane change.

    The yaw rate is a ramp to w, held, a ramp to -w, held, a ramp to 0, with D the time between the middles of
    neighbouring ramps. The middle ramp is twice as long as the outer ones (r), so the integral of the heading is
    w (D^2 - r^2 / 4), and the offset is v times that for small headings.
    """
    half_s = 0.5 * (duration_s - YAW_RATE_BUILD_UP_TIME_S)
    return math.degrees(offset_m / (speed_mps * (half_s**2 - 0.25 * YAW_RATE_BUILD_UP_TIME_S**2)))


def lane_change_segments(speed_mps: float, offset_m: float, start_s: float, duration_s: float) -> list[dict[str, Any]]:
    """Segments `lateral` of a lane change by `offset_m` to the left that begins at `start_s`."""
    rate = lane_change_yaw_rate_dps(speed_mps, offset_m, duration_s)
    half_s = 0.5 * (duration_s - YAW_RATE_BUILD_UP_TIME_S)
    limit = abs(rate) / YAW_RATE_BUILD_UP_TIME_S
    # the second ramp, from w to -w, takes two ramp times and has its middle half_s after that of the first
    turn_s = start_s + half_s - 0.5 * YAW_RATE_BUILD_UP_TIME_S
    back_s = start_s + 2.0 * half_s
    segments: list[dict[str, Any]] = [] if start_s <= 0.0 else [{"from_s": 0, "yaw_rate_dps": 0}]
    return [
        *segments,
        {"from_s": max(start_s, 0.0), "yaw_rate_dps": rate, "yaw_accel_dps2": limit},
        {"from_s": turn_s, "yaw_rate_dps": -rate, "yaw_accel_dps2": limit},
        {"from_s": back_s, "yaw_rate_dps": 0, "yaw_accel_dps2": limit},
    ]


def build_cut_in(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """A slower vehicle changes from the left lane into the host's.

    In the middle of the lane change, when its centre is half a lane beside the host's, the time to collision at
    constant velocities is `ttc_at_cut_in`.
    """
    host, other, ttc_s = trial_numbers["host_speed"], trial_numbers["other_speed"], trial_numbers["ttc_at_cut_in"]
    if not host > other > 0.0:
        raise _impossible_scene_error(
            f"the host ({host:.2f} m/s) must be faster than the one that cuts in ({other:.2f} m/s)"
        )
    duration_s = trial_numbers.get("lane_change_time", DEFAULT_LANE_CHANGE_DURATION_S)
    start_s = STEADY_TIME_BEFORE_EVENT_S
    middle_s = start_s + 0.5 * duration_s
    gap_m = (host - other) * (ttc_s + middle_s)
    cutter = {
        "speed_mps": other,
        "x_m": _centre_distance_m(gap_m),
        "y_m": LANE_WIDTH_M,
        "lateral": lane_change_segments(other, -LANE_WIDTH_M, start_s, duration_s),
    }
    end_s = max(middle_s + ttc_s, start_s + duration_s + YAW_RATE_BUILD_UP_TIME_S) + SCENE_TIME_AFTER_CONTACT_S
    vehicles: dict[str, dict[str, Any]] = {EGO_VEHICLE_KEY: {"speed_mps": host}, PRINCIPAL_OTHER_VEHICLE_NAME: cutter}
    return BuiltScene(_document_of_vehicles(end_s, **vehicles), start_s)


def build_cut_out(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """The lead leaves the lane late and reveals a vehicle that stands there.

    When the lane change begins the host is `reveal_ttc` from the standing vehicle; the lead drives `gap` ahead.
    """
    speed, gap_m, reveal_s = trial_numbers["host_speed"], trial_numbers["gap"], trial_numbers["reveal_ttc"]
    lead_m = _centre_distance_m(gap_m)
    if lead_m + CAR_LENGTH_AND_WIDTH_M[0] >= speed * reveal_s:
        raise _impossible_scene_error(
            f"the lead, {gap_m:g} m ahead, is beyond the standing vehicle when it leaves the lane"
        )
    duration_s = trial_numbers.get("lane_change_time", 1.5)
    lead = {
        "speed_mps": speed,
        "x_m": lead_m,
        "lateral": lane_change_segments(speed, LANE_WIDTH_M, STEADY_TIME_BEFORE_EVENT_S, duration_s),
    }
    standing = {"speed_mps": 0, "x_m": _centre_distance_m(speed * (STEADY_TIME_BEFORE_EVENT_S + reveal_s))}
    end_s = (
        STEADY_TIME_BEFORE_EVENT_S + max(reveal_s, duration_s + YAW_RATE_BUILD_UP_TIME_S) + SCENE_TIME_AFTER_CONTACT_S
    )
    vehicles: dict[str, dict[str, Any]] = {
        EGO_VEHICLE_KEY: {"speed_mps": speed},
        "lead": lead,
        PRINCIPAL_OTHER_VEHICLE_NAME: standing,
    }
    return BuiltScene(_document_of_vehicles(end_s, **vehicles), 0.0)


def build_crossing(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """A vehicle, a cyclist or a pedestrian crosses from the right at a right angle and is hit in the middle.

    The centres would meet `approach_time` after the start.
    """
    host, other = trial_numbers["host_speed"], trial_numbers["other_speed"]
    if not (host > 0.0 and other > 0.0):
        raise _impossible_scene_error("both must move")
    meet_s = trial_numbers.get("approach_time", APPROACH_START_TTC_S)
    crosser = {
        "speed_mps": other,
        "heading_deg": 90.0,
        "x_m": host * meet_s,
        "y_m": -other * meet_s,
        "length_m": trial_numbers.get("other_length", CAR_LENGTH_AND_WIDTH_M[0]),
        "width_m": trial_numbers.get("other_width", CAR_LENGTH_AND_WIDTH_M[1]),
        "turning_radius_m": 1.0,
    }
    document = _document_of_vehicles(
        meet_s + SCENE_TIME_AFTER_CONTACT_S,
        **{EGO_VEHICLE_KEY: {"speed_mps": host}, PRINCIPAL_OTHER_VEHICLE_NAME: crosser},
    )
    return BuiltScene(document, 0.0)


def build_oncoming(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """A vehicle comes towards the host; `lateral_offset` 0 is head on, a lane's width is a pass."""
    host, other = trial_numbers["host_speed"], trial_numbers["other_speed"]
    approach_s = trial_numbers.get("approach_time", APPROACH_START_TTC_S)
    oncoming = {
        "speed_mps": other,
        "heading_deg": 180.0,
        "x_m": _centre_distance_m((host + other) * approach_s),
        "y_m": trial_numbers.get("lateral_offset", 0.0),
    }
    document = _document_of_vehicles(
        approach_s + SCENE_TIME_AFTER_CONTACT_S,
        **{EGO_VEHICLE_KEY: {"speed_mps": host}, PRINCIPAL_OTHER_VEHICLE_NAME: oncoming},
    )
    return BuiltScene(document, 0.0)


def build_turn_across(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """The host turns left across the path of an oncoming vehicle, whose centre it would meet.

    The host turns on a circle of `radius` after a transition; the two centres meet where the host's path crosses the
    other's lane, found on the host's true path.
    """
    import numpy as np

    from cwcli.simulation.profile import read_motion_profile
    from cwcli.simulation.truth import TrueMotion

    host, other, radius_m = trial_numbers["host_speed"], trial_numbers["other_speed"], trial_numbers.get("radius", 14.0)
    lateral = [
        {"from_s": 0, "curvature_1pm": 0},
        {"from_s": STEADY_TIME_BEFORE_EVENT_S, "curvature_1pm": 1.0 / radius_m, "curvature_rate_1pmps": 1.0 / radius_m},
    ]
    end_s = STEADY_TIME_BEFORE_EVENT_S + 1.0 + math.pi / 2.0 * radius_m / host
    profile = read_motion_profile(None, lateral, speed_mps=host, end_s=end_s, path="host", source="turn-across")
    time_s = np.arange(0.0, end_s, 0.001)
    states = TrueMotion(profile, x_m=0.0, y_m=0.0, heading_rad=0.0).states_at(time_s)
    reached = np.flatnonzero(states[:, 1] >= LANE_WIDTH_M)
    if not len(reached):
        raise _impossible_scene_error(f"a turn of radius {radius_m:g} m does not reach the other lane")
    k = int(reached[0])
    meet_s, meet_x_m = float(time_s[k]), float(states[k, 0])
    oncoming = {"speed_mps": other, "heading_deg": 180.0, "x_m": meet_x_m + other * meet_s, "y_m": LANE_WIDTH_M}
    vehicles: dict[str, dict[str, Any]] = {
        EGO_VEHICLE_KEY: {"speed_mps": host, "lateral": lateral},
        PRINCIPAL_OTHER_VEHICLE_NAME: oncoming,
    }
    return BuiltScene(
        _document_of_vehicles(meet_s + SCENE_TIME_AFTER_CONTACT_S, **vehicles), STEADY_TIME_BEFORE_EVENT_S
    )


def build_parked_on_both_sides(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """The host drives straight between two parked vehicles, whose inner sides are `clearance` apart."""
    speed, clearance_m = trial_numbers["host_speed"], trial_numbers["clearance"]
    if clearance_m <= CAR_LENGTH_AND_WIDTH_M[1]:
        raise _impossible_scene_error(f"the host does not fit between vehicles {clearance_m:g} m apart")
    side_m = 0.5 * (clearance_m + CAR_LENGTH_AND_WIDTH_M[1])
    x_m = _centre_distance_m(speed * APPROACH_START_TTC_S)
    parked = {"speed_mps": 0, "x_m": x_m}
    vehicles: dict[str, dict[str, Any]] = {
        EGO_VEHICLE_KEY: {"speed_mps": speed},
        PRINCIPAL_OTHER_VEHICLE_NAME: {**parked, "y_m": side_m},
        "right": {**parked, "y_m": -side_m},
    }
    return BuiltScene(_document_of_vehicles(APPROACH_START_TTC_S + 2.0 * SCENE_TIME_AFTER_CONTACT_S, **vehicles), 0.0)


def build_parked_in_curve(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """The host drives into a left curve; a car is parked straight ahead of the curve's begin, outside the lane."""
    speed, radius_m = trial_numbers["host_speed"], trial_numbers["radius"]
    beside_m = 0.5 * LANE_WIDTH_M + CAR_LENGTH_AND_WIDTH_M[1]
    ahead_m = math.sqrt(2.0 * radius_m * beside_m)  # where the curve has left the straight line by that much
    begin_s = APPROACH_START_TTC_S
    lateral = [
        {"from_s": 0, "curvature_1pm": 0},
        {"from_s": begin_s, "curvature_1pm": 1.0 / radius_m, "curvature_rate_1pmps": 2.0 / radius_m},
    ]
    lag_m = 0.25 * speed  # the transition of 0.5 s delays the curve by half of itself
    parked = {"speed_mps": 0, "x_m": speed * begin_s + lag_m + ahead_m + 0.5 * CAR_LENGTH_AND_WIDTH_M[0], "y_m": 0.0}
    end_s = begin_s + 2.0 * ahead_m / speed + SCENE_TIME_AFTER_CONTACT_S
    vehicles: dict[str, dict[str, Any]] = {
        EGO_VEHICLE_KEY: {"speed_mps": speed, "lateral": lateral},
        PRINCIPAL_OTHER_VEHICLE_NAME: parked,
    }
    return BuiltScene(_document_of_vehicles(end_s, **vehicles), 0.0)


def build_following(trial_numbers: Mapping[str, float]) -> BuiltScene:
    """The host follows; the lead brakes gently to a lower speed, and the host with it after a reaction time."""
    speed, gap_m, deceleration, lower = (
        trial_numbers["host_speed"], trial_numbers["gap"], trial_numbers["deceleration"], trial_numbers["lower_speed"],
    )  # fmt: skip
    if not 0.0 <= lower < speed:
        raise _impossible_scene_error(f"the lower speed ({lower:.2f} m/s) must be below {speed:.2f} m/s")
    reaction_s = trial_numbers.get("reaction_time", 0.0)

    def braking_segments(begin_s: float) -> list[dict[str, Any]]:
        change = {
            "speed_mps": lower,
            "limit_mps2": deceleration,
            "jerk_mps3": deceleration / DEFAULT_DECELERATION_BUILD_UP_TIME_S,
        }
        return [{"from_s": 0, "accel_mps2": 0}, {"from_s": begin_s, **change}]

    if gap_m <= (speed - lower) * reaction_s:
        raise _impossible_scene_error(f"the host runs into the lead within its reaction time of {reaction_s:g} s")
    end_s = (
        STEADY_TIME_BEFORE_EVENT_S
        + reaction_s
        + (speed - lower) / deceleration
        + 2.0 * DEFAULT_DECELERATION_BUILD_UP_TIME_S
        + 3.0
    )
    vehicles: dict[str, dict[str, Any]] = {
        EGO_VEHICLE_KEY: {
            "speed_mps": speed,
            "longitudinal": braking_segments(STEADY_TIME_BEFORE_EVENT_S + reaction_s),
        },
        PRINCIPAL_OTHER_VEHICLE_NAME: {
            "speed_mps": speed,
            "x_m": _centre_distance_m(gap_m),
            "longitudinal": braking_segments(STEADY_TIME_BEFORE_EVENT_S),
        },
    }
    return BuiltScene(_document_of_vehicles(end_s, **vehicles), STEADY_TIME_BEFORE_EVENT_S)


_OTHER_SIZE_NUMBERS = ("other_length", "other_width")
SCENES: Mapping[str, Scene] = {
    "approach": Scene(
        build_approach, ("host_speed",), ("other_speed", "approach_time", "lateral_offset", *_OTHER_SIZE_NUMBERS)
    ),
    "radar-return": Scene(build_standing_radar_target, ("host_speed",), ("lateral_offset", *_OTHER_SIZE_NUMBERS)),
    "braking-lead": Scene(build_braking_lead, ("host_speed", "gap", "deceleration"), ("ramp_time",)),
    "convoy": Scene(build_convoy, ("host_speed", "gap", "deceleration"), ("ramp_time", "reaction_time")),
    "cut-in": Scene(build_cut_in, ("host_speed", "other_speed", "ttc_at_cut_in"), ("lane_change_time",)),
    "cut-out": Scene(build_cut_out, ("host_speed", "gap", "reveal_ttc"), ("lane_change_time",)),
    "crossing": Scene(build_crossing, ("host_speed", "other_speed"), ("approach_time", *_OTHER_SIZE_NUMBERS)),
    "oncoming": Scene(build_oncoming, ("host_speed", "other_speed"), ("approach_time", "lateral_offset")),
    "turn-across": Scene(build_turn_across, ("host_speed", "other_speed"), ("radius",)),
    "parked-on-both-sides": Scene(build_parked_on_both_sides, ("host_speed", "clearance")),
    "parked-in-curve": Scene(build_parked_in_curve, ("host_speed", "radius")),
    "lane-drift": Scene(None, ("host_speed", "drift_rate"), ("radius",)),
    "following": Scene(build_following, ("host_speed", "gap", "deceleration", "lower_speed"), ("reaction_time",)),
}  # fmt: skip
"""Scene -> how it is built, and which numbers it takes."""
