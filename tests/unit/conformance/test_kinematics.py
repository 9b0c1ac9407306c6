"""The trials that are made are those that were asked for: against closed forms, on the true motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.conformance.clause import clause_names, load_clause
from cwcli.conformance.encounter import Encounter, time_to_close_gap_s
from cwcli.conformance.lane_trials import simulate_lane_trial
from cwcli.conformance.online import build_trial_scenario, true_encounter
from cwcli.conformance.scenes import LANE_WIDTH_M, SCENES, build_standing_radar_target
from cwcli.errors import UsageError
from cwcli.simulation.drive import simulate_scenario

MPH = 0.44704
ATOL_M = 1e-6
APPROACH_S = 12.0
"""How long an approach takes that names no time, s: 5 s in which the filters settle, and 7 s."""
ATOL_S = 2e-3
"""The truth has a step of 10 ms and is linear between; times are as good as that."""


def drive(scene: str, **given: float) -> Encounter:
    build = SCENES[scene].build
    assert build is not None
    built = build(given)
    return true_encounter(build_trial_scenario(built, "nominal", name="trial"), built)


def at(encounter: Encounter, values: np.ndarray, time_s: float) -> float:
    return encounter.value_at(values, time_s)


def test_an_approach_starts_at_its_time_to_collision_and_ends_in_contact() -> None:
    encounter = drive("approach", host_speed=45 * MPH, other_speed=20 * MPH, approach_time=6.0)
    assert encounter.gap_m[0] == pytest.approx(25 * MPH * 6.0, abs=ATOL_M)
    assert encounter.ttc_s[0] == pytest.approx(6.0, abs=1e-9)
    assert at(encounter, encounter.ttc_s, 2.5) == pytest.approx(3.5, abs=1e-9)
    assert encounter.contact_s == pytest.approx(6.0, abs=ATOL_S)
    assert np.ptp(encounter.host[:, 2]) == 0.0


def test_a_lead_brakes_as_prescribed_and_is_hit_when_the_closed_form_says() -> None:
    speed, gap, decel, ramp = 45 * MPH, 30.0, 0.3 * 9.80665, 0.5
    encounter = drive("braking-lead", host_speed=speed, gap=gap, deceleration=decel, ramp_time=ramp)
    assert encounter.gap_m[0] == pytest.approx(gap, abs=ATOL_M)
    assert at(encounter, encounter.other_accel_mps2, 4.99) == 0.0
    assert at(encounter, encounter.other_accel_mps2, 5.25) == pytest.approx(-decel / 2, abs=1e-6)
    assert at(encounter, encounter.other_accel_mps2, 5.5) == pytest.approx(-decel, abs=1e-6)
    assert at(encounter, encounter.other_accel_mps2, 9.0) == pytest.approx(-decel, abs=1e-6)
    # after a linear ramp of r the way lost t after its begin is a (t - r/2)^2 / 2 + a r^2 / 24
    lost = decel * (2.0 - ramp / 2) ** 2 / 2 + decel * ramp**2 / 24
    assert at(encounter, encounter.gap_m, 7.0) == pytest.approx(gap - lost, abs=1e-4)
    contact = 5.0 + ramp / 2 + math.sqrt(2 * (gap - decel * ramp**2 / 24) / decel)
    assert encounter.contact_s == pytest.approx(contact, abs=ATOL_S)
    # under a constant deceleration the time to collision with it counts down to the contact
    assert at(encounter, encounter.ttc_with_accelerations_s, 7.0) == pytest.approx(contact - 7.0, abs=ATOL_S)
    assert at(encounter, encounter.ttc_s, 7.0) > contact - 7.0 + 1.0


def test_a_lead_that_stops_before_the_contact_stays_where_it_is() -> None:
    encounter = drive("braking-lead", host_speed=50 / 3.6, gap=40.0, deceleration=6.0, ramp_time=0.1)
    stopped = encounter.other[-1, 2]
    way = (50 / 3.6) ** 2 / 12.0  # of the lead from its braking to standstill
    assert stopped == 0.0
    contact = 5.0 + 0.05 + (40.0 + way) / (50 / 3.6)
    assert encounter.contact_s == pytest.approx(contact, abs=0.02)
    assert at(encounter, encounter.ttc_with_accelerations_s, 6.0) == pytest.approx(contact - 6.0, abs=0.03)


def test_a_cut_in_has_its_time_to_collision_in_the_middle_of_the_lane_change() -> None:
    encounter = drive("cut-in", host_speed=20.0, other_speed=14.0, ttc_at_cut_in=3.0, lane_change_time=3.0)
    assert at(encounter, encounter.lateral_offset_m, 5.0) == pytest.approx(LANE_WIDTH_M, abs=1e-6)
    assert at(encounter, encounter.lateral_offset_m, 6.5) == pytest.approx(LANE_WIDTH_M / 2, abs=0.01)
    assert at(encounter, encounter.lateral_offset_m, 8.0) == pytest.approx(0.0, abs=0.02)
    assert at(encounter, encounter.other[:, 3], 8.2) == pytest.approx(0.0, abs=1e-6)
    # the cutter is turned by psi = w D there: its outline reaches farther back, its speed along the road is smaller
    psi = encounter.value_at(encounter.other[:, 3], 6.5)
    reach = 0.5 * (4.5 * math.cos(psi) - 1.8 * math.sin(psi) - 4.5)  # psi is negative, to the right
    expected = (6.0 * 3.0 - reach) / (20.0 - 14.0 * math.cos(psi))
    assert at(encounter, encounter.ttc_s, 6.5) == pytest.approx(expected, abs=0.04)
    assert expected == pytest.approx(3.0, rel=0.05)


def test_a_cut_out_reveals_the_standing_vehicle_at_its_time_to_collision() -> None:
    encounter = drive("cut-out", host_speed=20.0, gap=20.0, reveal_ttc=4.3)
    assert at(encounter, encounter.ttc_s, 5.0) == pytest.approx(4.3, abs=1e-9)


def test_a_crossing_hits_the_middle_of_the_front() -> None:
    encounter = drive("crossing", host_speed=10.0, other_speed=1.39, other_length=0.5, other_width=0.5)
    assert at(encounter, encounter.lateral_offset_m, APPROACH_S) == pytest.approx(0.0, abs=ATOL_M)
    # its own depth is 0.5 m across the host's way: contact half of both extents before the centres meet
    assert encounter.contact_s == pytest.approx(APPROACH_S - (2.25 + 0.25) / 10.0, abs=ATOL_S)


def test_an_oncoming_vehicle_closes_with_both_speeds() -> None:
    encounter = drive("oncoming", host_speed=12.0, other_speed=13.0, approach_time=6.0)
    assert encounter.closing_mps[0] == pytest.approx(25.0)
    assert encounter.gap_m[0] == pytest.approx(150.0, abs=ATOL_M)


def test_a_turn_across_meets_the_oncoming_vehicle() -> None:
    encounter = drive("turn-across", host_speed=15 / 3.6, other_speed=45 / 3.6)
    distance = np.hypot(*(encounter.other[:, :2] - encounter.host[:, :2]).T)
    assert distance.min() < 0.1
    assert math.isfinite(encounter.contact_s)


@pytest.mark.parametrize(
    ("scene", "given"),
    [
        ("parked-on-both-sides", {"host_speed": 50 / 3.6, "clearance": 4.5}),
        ("parked-in-curve", {"host_speed": 50 / 3.6, "radius": 100.0}),
        ("following", {"host_speed": 25.0, "gap": 30.0, "deceleration": 2.0, "lower_speed": 20.0}),
        ("oncoming", {"host_speed": 25.0, "other_speed": 25.0, "lateral_offset": LANE_WIDTH_M}),
    ],
)
def test_a_scene_for_false_warnings_has_no_contact(scene: str, given: dict[str, float]) -> None:
    encounter = drive(scene, **given)
    assert math.isnan(encounter.contact_s)
    assert encounter.separation_m.min() > 0.2


def test_the_curves_with_a_parked_car_begin_before_every_warning_of_a_standing_car_is_due() -> None:
    """Up to the curve the drive is an approach to a standing car, so nobody could pass if its warning were due before.

    A curve of R is b beside the straight line after sqrt(2 R b), where the parked car's rear is; the host's front is
    half a length nearer. UN R131 asks for a warning 0.8 s before braking with 4 m/s^2 has to begin.
    """
    trials = [trial for trial in load_clause("un-r152").trials if trial.scene == "parked-in-curve"]
    assert [trial.given["radius"] for trial in trials] == [100.0, 250.0]
    for trial in trials:
        speed, beside_m = trial.given["host_speed"], LANE_WIDTH_M / 2 + 1.8
        encounter = drive("parked-in-curve", **trial.given)
        ttc_s = (math.sqrt(2.0 * trial.given["radius"] * beside_m) - 0.5 * 4.5) / speed
        # the curvature is built up in half a second, which delays the curve by a quarter
        assert at(encounter, encounter.ttc_s, APPROACH_S + 0.25) == pytest.approx(ttc_s, abs=ATOL_S)
        assert ttc_s > 0.8 + speed / (2.0 * 4.0)


@pytest.mark.parametrize(
    ("name", "places"), [("un-r130", (0, 3, 4, 7)), ("iso-17361", (4, 7, 8, 9, 10, 11))], ids=["un-r130", "iso-17361"]
)
def test_a_drift_crosses_the_line_at_the_rate_that_the_clause_asks_for(name: str, places: tuple[int, ...]) -> None:
    """The rate is the slope of the distance between tyre and line over 0.1 s, not the simulation's own speed."""
    for k in places:
        trial = load_clause(name).trials[k]
        for seed in (1, 7):
            drift = simulate_lane_trial(trial.given, seed).drift
            rate, slope = trial.given["drift_rate"], -np.gradient(drift.tyre_gap_m, drift.time_s)
            assert drift.other_id == ("left boundary" if rate > 0.0 else "right boundary")
            gap_m = np.interp(drift.contact_s + np.array([-0.05, 0.05]), drift.time_s, drift.tyre_gap_m)
            assert -np.diff(gap_m)[0] / 0.1 == pytest.approx(abs(rate), abs=0.025), trial.name
            near = (np.abs(drift.tyre_gap_m) < 0.3) & (drift.time_s > 3.0)
            assert slope[near] == pytest.approx(abs(rate), abs=0.11), trial.name
            assert drift.tyre_gap_m.min() < -0.3


@pytest.mark.parametrize(("rate", "words"), [(3.0, "no driver leaves the lane steadily"), (0.01, "takes too long")])
def test_a_drift_that_nobody_drives_is_refused(rate: float, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        simulate_lane_trial({"host_speed": 30.0, "drift_rate": rate}, 0)


def test_a_radar_return_is_an_approach_to_what_sends_no_messages() -> None:
    encounter = drive("radar-return", host_speed=80 / 3.6)
    assert encounter.ttc_s == pytest.approx(drive("approach", host_speed=80 / 3.6).ttc_s)
    built = build_standing_radar_target({"host_speed": 80 / 3.6, "other_length": 3.7, "other_width": 2.4})
    plate = simulate_scenario(build_trial_scenario(built, "nominal", name="trial"), 0)
    assert not plate.scenario.vehicles["other"].has_v2x
    returns = plate.detections["radar"].values
    far = returns[returns[:, 0] > 20.0]
    # it is first seen at 160 m, and 20 scans a second see it come near by 22.2 m/s
    assert len(far) == pytest.approx(140.0 / (80 / 3.6) * 20, abs=3)
    assert far[:, 2] == pytest.approx(-80 / 3.6, abs=6 * 0.12)
    assert np.abs(far[:, 1]).max() < 6 * math.radians(0.5)


def test_a_convoy_brakes_one_after_the_other() -> None:
    build = SCENES["convoy"].build
    assert build is not None
    built = build({"host_speed": 25.0, "gap": 25.0, "deceleration": 6.0, "reaction_time": 1.0})
    scenario = build_trial_scenario(built, "nominal", name="trial")
    accel = [scenario.vehicles[name].motion.states_at(np.array([5.9, 6.9]))[:, 4] for name in ("first", "other")]
    assert accel[0] == pytest.approx([-6.0, -6.0])
    assert accel[1] == pytest.approx([0.0, -6.0])


@pytest.mark.parametrize(
    ("gap", "own", "own_accel", "other", "other_accel", "expected"),
    [
        (30.0, 20.0, 0.0, 10.0, 0.0, 3.0),
        (30.0, 10.0, 0.0, 20.0, 0.0, math.inf),
        (12.0, 10.0, 0.0, 10.0, -6.0, 2.0),  # 12 = 6 t^2 / 2; the lead stops at 1.667 s: 12 + 25/3 = 10 t
        (30.0, 20.0, -5.0, 0.0, 0.0, 2.0),  # 30 = 20 t - 2.5 t^2
        (41.0, 20.0, -5.0, 0.0, 0.0, math.inf),  # it stops after 40 m
        (100.0, 15.0, 0.0, -10.0, 0.0, 4.0),
        (0.0, 5.0, 0.0, 5.0, 0.0, 0.0),
    ],
)
def test_the_time_to_close_a_gap(
    gap: float, own: float, own_accel: float, other: float, other_accel: float, expected: float
) -> None:
    if other_accel == -6.0:
        expected = (12.0 + 100.0 / 12.0) / 10.0
    assert time_to_close_gap_s(gap, own, own_accel, other, other_accel) == pytest.approx(expected)


def test_the_time_to_close_a_gap_agrees_with_steps_of_a_millisecond() -> None:
    rng = np.random.default_rng(7)
    for _ in range(60):
        gap, own, other = rng.uniform(1, 60), rng.uniform(0, 30), rng.uniform(0, 30)
        a_own, a_other = rng.uniform(-6, 3), rng.uniform(-8, 3)
        t = np.arange(0.0, 30.0, 0.001)

        def way(speed: float, accel: float, t: np.ndarray = t) -> np.ndarray:
            until = np.minimum(t, -speed / accel) if accel < 0 else t
            return speed * until + 0.5 * accel * until**2

        left = gap + way(other, a_other) - way(own, a_own)
        hit = np.flatnonzero(left <= 0.0)
        found = time_to_close_gap_s(gap, own, a_own, other, a_other)
        if len(hit):
            assert found == pytest.approx(t[hit[0]], abs=2e-3)
        else:
            assert found > 29.9


@pytest.mark.parametrize(
    ("scene", "given", "words"),
    [
        ("approach", {"host_speed": 10.0, "other_speed": 12.0}, "does not close in"),
        ("braking-lead", {"host_speed": 10.0, "gap": -1.0, "deceleration": 3.0}, "must be positive"),
        ("braking-lead", {"host_speed": 30.0, "gap": 20.0, "deceleration": 14.9}, "of the tyres"),
        ("cut-out", {"host_speed": 10.0, "gap": 60.0, "reveal_ttc": 4.0}, "beyond the standing vehicle"),
        ("parked-on-both-sides", {"host_speed": 10.0, "clearance": 1.5}, "does not fit"),
    ],
)
def test_an_impossible_trial_is_refused(scene: str, given: dict[str, float], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        drive(scene, **given)


@pytest.mark.parametrize("name", clause_names())
def test_every_approach_braking_lead_and_crossing_of_a_clause_has_its_closed_form(name: str) -> None:
    for trial in load_clause(name).trials:
        given = trial.given
        if trial.scene not in ("approach", "braking-lead", "crossing"):
            continue
        encounter, speed = drive(trial.scene, **given), given["host_speed"]
        if trial.scene == "approach":
            contact_s, offset_m = given.get("approach_time", APPROACH_S), given.get("lateral_offset", 0.0)
            assert encounter.gap_m[0] == pytest.approx((speed - given.get("other_speed", 0.0)) * contact_s, abs=1e-6)
            assert encounter.lateral_offset_m == pytest.approx(offset_m, abs=1e-6)
            if abs(offset_m) > (1.8 + given.get("other_width", 1.8)) / 2:  # it is passed
                contact_s = math.nan
        elif trial.scene == "braking-lead":
            decel, ramp, gap = given["deceleration"], given.get("ramp_time", 0.5), given["gap"]
            ramp_m = decel * ramp**2 / 24
            since_s = ramp / 2 + math.sqrt(2.0 * (gap - ramp_m) / decel)
            if since_s > speed / decel + ramp / 2:  # the lead has stopped by then
                since_s = (gap + speed**2 / (2.0 * decel) + speed * ramp / 2 - ramp_m) / speed
            contact_s = 5.0 + since_s
            assert encounter.gap_m[0] == pytest.approx(gap, abs=1e-6)
        else:  # both outlines are over the crossing until the centres meet
            length_m, width_m = given.get("other_length", 4.5), given.get("other_width", 1.8)
            contact_s = APPROACH_S - min((2.25 + width_m / 2) / speed, (0.9 + length_m / 2) / given["other_speed"])
        assert encounter.contact_s == pytest.approx(contact_s, abs=0.02, nan_ok=True), trial.name
