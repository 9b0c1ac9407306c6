"""Where the other came from, and what is said of it: geometry by hand."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.digest.drive import Drive, OtherTrack
from cwcli.digest.encounters import find_encounters
from cwcli.digest.story import build_story
from cwcli.measures.pair import ActualTrack
from cwcli.report.tables import encounter_facts_table
from cwcli.signals.columns import Strings
from cwcli.warning.rows import HELD, RAISED, WarningRow, WarningRows, build_warning_rows
from cwcli.warning.types import WarningConfig

S = 1_000_000_000
NORTH = math.pi / 2.0


def straight(x_m: float, y_m: float, speed_mps: float, heading_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) and states (n, 4) of 10 s at constant velocity, 20 Hz."""
    time_s = np.arange(201) * 0.05
    state = np.column_stack(
        [
            x_m + speed_mps * time_s * math.cos(heading_rad),
            y_m + speed_mps * time_s * math.sin(heading_rad),
            np.full(201, speed_mps),
            np.full(201, heading_rad),
        ]
    )
    return np.round(time_s * S).astype(np.int64), state


def warning(at_s: float, other: str, rule: str = "cwcli") -> WarningRows:
    """One warning that stands for half a second."""
    first, second = (round(each * S) for each in (at_s, at_s + 0.5))
    compared = (math.nan, math.nan) if rule == "lane-departure" else (0.95, 0.97)
    rows = [
        WarningRow(first, first, first, 1, RAISED, other, "", 2.0, 0.4, math.nan, 0.48, compared[0]),
        WarningRow(second, second, second, 1, HELD, other, "", 1.5, 0.3, math.nan, 0.9, compared[1]),
    ]
    return build_warning_rows(rows, rule=rule, host_id="ego")


def drive(other: tuple[np.ndarray, np.ndarray] | None, warnings: WarningRows | None, *, moves: bool = True) -> Drive:
    """The ego drives north at 10 m/s from the origin (or stands there)."""
    stamp_ns, state = straight(0.0, 0.0, 10.0 if moves else 0.0, NORTH)
    full = np.zeros((201, 8))
    full[:, :4] = state
    unknown = np.full(201, np.nan)
    ids = Strings(np.zeros(201, np.int32), ("ego",))
    covariance = np.tile(np.eye(8) * 0.01, (201, 1, 1))
    ego = VehicleStates(ids, stamp_ns, stamp_ns, full, covariance, unknown, unknown, np.zeros(len(stamp_ns), np.uint8))
    others = (OtherTrack("7", "vehicle", ActualTrack(*other), (4.5, 1.8)),) if other else ()
    return Drive("x.mcap", 0, 10 * S, ego, others, (), warnings, None, WarningConfig(), {}, "")


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (straight(50.0, 50.0, 10.0, math.pi), "coming from the right"),
        (straight(-50.0, 50.0, 10.0, 0.0), "coming from the left"),
        (straight(0.0, 20.0, 6.0, NORTH), "ahead in the same direction"),
        (straight(0.0, -20.0, 14.0, NORTH), "coming from behind"),
        (straight(0.0, 100.0, 10.0, -NORTH), "coming towards it"),
        (straight(-4.0, 0.0, 10.0, NORTH), "beside it on the left"),
        (straight(4.0, 0.0, 10.0, NORTH), "beside it on the right"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_direction_is_told_from_the_drivers_seat(other: tuple[np.ndarray, np.ndarray], words: str) -> None:
    (encounter,) = find_encounters(drive(other, warning(2.0, "7"))).encounters
    assert encounter.direction == words


def test_collision_in_words() -> None:
    # both reach (0, 50) at 5.0 s: centres 2.5 m apart at 5 s - 2.5 / (10 * sqrt 2) s = 4.82 s, so 2.8 s after 2.0 s
    scene = drive(straight(50.0, 50.0, 10.0, math.pi), warning(2.0, "7"))
    story = build_story(scene, find_encounters(scene))
    assert story.headline == (
        "At 2.0 s cwcli warned that the car would collide with vehicle 7, coming from the right; "
        "they did: at 5.0 s their outlines overlap, with 0.0 m between their centres."
    )
    assert (
        story.more[0] == "The warning was right: it came 2.8 s before the two were closer than 2.5 m, centre to centre."
    )
    assert [badge.tone for badge in story.badges] == ["alert"]


def test_false_alarm_in_words() -> None:
    # it passes 10 m ahead of the car's place at 5 s: nearest sqrt(2) / 2 * 10 = 7.07 m
    scene = drive(straight(60.0, 50.0, 10.0, math.pi), warning(2.0, "7"))
    story = build_story(scene, find_encounters(scene))
    assert "they came nearest at 5.5 s, with 7.1 m between their centres" in story.headline
    assert story.more[0].startswith("By what followed it was a false alarm")
    assert [badge.tone for badge in story.badges] == ["bad"]


def no_warnings() -> WarningRows:
    return build_warning_rows([], rule="cwcli", host_id="ego")


def test_conflict_without_a_warning_is_told() -> None:
    scene = drive(straight(50.0, 50.0, 10.0, math.pi), no_warnings())
    story = build_story(scene, find_encounters(scene))
    assert "gave no warning" in story.headline
    assert any(sentence.startswith("No warning came before 4.8 s") for sentence in story.more)
    assert any(badge.tone == "bad" for badge in story.badges)


def test_no_warning_that_was_right_tells_the_gap_of_the_outlines() -> None:
    # it stands 120 m ahead, of which the car drives 100 m in 10 s; their outlines are 4.5 m long
    scene = drive(straight(0.0, 120.0, 0.0, NORTH), no_warnings())
    story = build_story(scene, find_encounters(scene))
    assert story.headline == (
        "In this drive cwcli gave no warning; the nearest other, vehicle 7, was 15.5 m away, outline to outline, at "
        "10.0 s."
    )
    assert story.more[0].startswith("By the later tracks that was right: there was no moment when the two were closer")


def test_near_miss_is_not_called_right() -> None:
    # it stands crosswise beside the way, 4.5 m long and 3.55 m off it: 3.55 - 2.25 - 0.9 m are between the outlines
    scene = drive(straight(3.55, 50.0, 0.0, 0.0), no_warnings())
    story = build_story(scene, find_encounters(scene))
    assert "was 0.4 m away, outline to outline" in story.headline
    assert story.more[0].startswith("By the later tracks it was near, but no conflict")


def test_nearest_is_that_of_the_outlines() -> None:
    # a bus 12 m long and 2.5 m wide at 7 m: 7 - 0.9 - 1.25 m; a car at 6 m: 6 - 1.8 m
    scene = drive(straight(6.0, 20.0, 0.0, NORTH), no_warnings())
    bus = OtherTrack("bus", "vehicle", ActualTrack(*straight(-7.0, 20.0, 0.0, 0.0)), (12.0, 2.5))
    nearest = find_encounters(replace(scene, others=(*scene.others, bus))).nearest
    # across the way: half of its length reaches towards the car
    assert nearest is not None and nearest.other is bus
    assert math.isclose(nearest.distance_m, 7.0 - 6.0 - 0.9)


def test_no_warning_where_the_lane_alone_was_watched() -> None:
    scene = replace(drive(None, no_warnings()), ego=None)
    story = build_story(scene, find_encounters(scene))
    assert "gave no warning of leaving the lane; the car's place was not estimated" in story.headline
    assert "vehicle" not in story.headline


def test_warning_of_a_vehicle_without_a_track() -> None:
    scene = drive(None, warning(2.0, "9"))
    story = build_story(scene, find_encounters(scene))
    assert story.headline.endswith("vehicle 9. How near they came is not known.")


def test_lane_departure_is_not_about_a_vehicle() -> None:
    scene = drive(None, warning(2.0, "left boundary", "lane-departure"))
    story = build_story(scene, find_encounters(scene))
    assert story.headline == "At 2.0 s cwcli warned that the car would leave its lane over its left boundary."


def facts(scene: Drive) -> dict[str, str]:
    """The rows of the first warning's table that begin with what was predicted, by what is said of them."""
    (encounter,) = find_encounters(scene).encounters
    rows = encounter_facts_table(scene, encounter).rows
    said = (row for row in rows if row[0].startswith("predicted "))
    return {row[0].removeprefix("predicted when it was given: "): row[1] for row in said}


def test_probabilities_are_those_of_the_alert_and_say_what_they_are() -> None:
    assert facts(drive(straight(50.0, 50.0, 10.0, math.pi), warning(2.0, "7"))) == {
        "the collision comes in": "2.00 s",
        "centres apart by": "0.40 m",
        "probability, which the rule compares with 0.65": "0.95",
        "probability within 2.5 s": "0.48",
    }


def test_what_a_lane_departure_predicts_is_about_the_line() -> None:
    assert facts(drive(None, warning(2.0, "left boundary", "lane-departure"))) == {
        "the line is crossed in": "2.00 s",
        "the tyre stays inside by": "0.40 m",
        "probability of the crossing": "0.48",
    }


def test_no_warnings_computed_says_why() -> None:
    scene = drive(None, None)
    story = build_story(scene, find_encounters(scene))
    assert story.headline == (
        "The car's motion was estimated, but no warnings were computed: no other vehicle is in the log."
    )


def test_standing_car_has_a_way_of_nothing() -> None:
    scene = drive(None, None, moves=False)
    assert "the car drove 0 m, at most 0 km/h" in build_story(scene, find_encounters(scene)).length


@pytest.mark.parametrize(
    ("states", "parameters", "words"),
    [
        ("online", "calibration car.toml", "are given when the car could have known; what happened"),
        (
            "online",
            "this log",
            "could have known, but with noise and latencies from the whole log; what happened",
        ),
        ("hindsight", "this log", "from states in hindsight, which know what came, at their stamps"),
    ],
)
def test_the_first_sentence_below_the_headline_says_what_was_known(states: str, parameters: str, words: str) -> None:
    scene = drive(straight(30.0, 30.0, 10.0, math.pi), warning(1.0, "7"))
    records = {
        "warn": {"configuration": json.dumps({"states": states})},
        "estimate": {"online_parameters": parameters},
    }
    scene = replace(scene, records=records)
    assert words in build_story(scene, find_encounters(scene)).sentences[0]
