"""Each doubt is found where it must be, with its number, and not where there is none: cases by hand."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.result import SourceReport, Track
from cwcli.evaluation.doubts import (
    DOUBT_RULES,
    find_doubts_in_evidence,
    find_remarks_in_evidence,
)
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.evaluation.estimate import lost_quantity_spans_to_record_entry
from cwcli.evaluation.fix_offsets import fix_offsets_to_record_entry, least_value_in_window_from_each_row
from cwcli.evaluation.truth import build_nees_section
from cwcli.pipeline.assumed_camera import (
    ASSUMED_LENS_NOTE_BEGINNING,
    ASSUMED_MOUNTING_NOTE_BEGINNING,
    CONTRADICTED_LENS_NOTE_BEGINNING,
)
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import ACCEL, SPEED, YAW_RATE, StateFlag

S = NS_PER_S
Source = dict[str, Any]


def states(flags: int = 0, **motion: float) -> VehicleStates:
    """Ten states a second apart with constant values."""
    state = np.zeros((10, 8))
    for name, value in {"speed": 10.0, **motion}.items():
        state[:, {"speed": SPEED, "accel": ACCEL, "yaw_rate": YAW_RATE}[name]] = value
    return VehicleStates.from_ego_states(np.arange(10) * S, state, flags=np.full(10, flags, np.uint8))


def source(quantity: Any = "position", **more: Any) -> Source:
    """The diagnostics of a source without a fault."""
    counts = {"read": 100, "used": 100, "gated": 0, "resets": 0, "nis_per_dof": 1.0, "nis_inside": True}
    return {"vehicle": "ego", "source": "/gps/fix", "quantity": quantity, **counts, **more}


def table(key: str, columns: list[str], *rows: list[Any]) -> dict[str, Any]:
    return {"key": key, "title": key, "columns": columns, "rows": list(rows)}


def nees(*rows: list[Any]) -> dict[str, Any]:
    return table("nees", ["quantity", "NEES/dof", "NEES/dof within bounds"], *rows)


def evidence(
    *sources: Source,
    ego: VehicleStates | None = None,
    sections: tuple[dict[str, Any], ...] = (nees(["position", 1.0, "in"]),),
    faults: dict[str, int] | None = None,
    more: dict[str, Any] | None = None,
    end_ns: int = 9 * S,
    **entries: Any,
) -> DoubtEvidence:
    """What is known of a log with these sources; a moving car with a truth that it agrees with."""
    record = {"sources": list(sources or [source()]), "summary": {"sections": sections, **(more or {})}, **entries}
    records = {"estimate": {key: json.dumps(value) for key, value in record.items()}}
    return DoubtEvidence(records, states() if ego is None else ego, 0, end_ns, faults or {})


def assumed_camera_evidence(*more: str) -> DoubtEvidence:
    """What is known of lanes that were found with an assumed lens and mounting, without an estimate."""
    notes = [f"{text}: 60 degrees" for text in (ASSUMED_LENS_NOTE_BEGINNING, ASSUMED_MOUNTING_NOTE_BEGINNING, *more)]
    return DoubtEvidence({"lanes": {"summary": json.dumps({"sections": [], "notes": notes})}})


def names(found: DoubtEvidence) -> list[str]:
    return [each.name for each in find_doubts_in_evidence(found)]


def minute_of_states(flags: int = 0, speed: float = 10.0) -> VehicleStates:
    """States of a minute, a second apart, with a constant speed."""
    state = np.zeros((61, 8))
    state[:, SPEED] = speed
    return VehicleStates.from_ego_states(np.arange(61) * S, state, flags=np.full(61, flags, np.uint8))


def silence(begin_s: int = 36, end_s: int = 60, **more: Any) -> dict[str, Any]:
    """A silence of the wheel speed at the end of that minute, as it is recorded."""
    found = {"source": "/wheel", "quantities": ["speed"], "begin_ns": begin_s * S, "end_ns": end_s * S}
    others = {"/gps/fix": ["position"], "/imu": ["acceleration", "yaw rate"]}
    return {**found, "from_the_start": False, "to_the_end": end_s == 60, "others": others, **more}


DOUBTFUL = [
    (
        "contradiction",
        evidence(more={"contradictions": ["ego_speed (/wheel) contradicts ego_position (/fix): 3.6 times the way"]}),
        1.0,
        "The speed in /wheel contradicts the position in /fix: 3.6 times the way.",
    ),
    ("speed", evidence(ego=states(speed=-211.0 / 3.6)), 211.0, "The estimate has a speed of 211 km/h at 0 s."),
    ("acceleration", evidence(ego=states(accel=20.0)), 20.0, "The estimate has an acceleration of 20 m/s² at 0 s."),
    (
        "lateral-acceleration",
        evidence(ego=states(speed=30.0, yaw_rate=-0.5)),
        15.0,
        "The estimate has a lateral acceleration of 15 m/s² at 0 s.",
    ),
    (
        "fixes",
        evidence(
            fix_offsets=[{"source": "/fix", "quantity": "position", "offset_m": 9.0, "sigma_m": 1.5, "stamp_ns": 6 * S}]
        ),
        6.0,
        "The track is 9.0 m away from the measured positions of /fix at 6 s, 6 times its own uncertainty.",
    ),
    (
        "errors",
        evidence(sections=(nees(["position", 9.0, "OUT"], ["speed", 1.9, "OUT"], ["heading", 4.0, "in"]),)),
        9.0,
        "Compared with the true motion in the log, the position is off by 3.0 times its own uncertainty.",
    ),
    (
        "gated",
        evidence(source(used=90, gated=10)),
        0.1,
        "10 % of the measurements of /gps/fix position contradict the other sources.",
    ),
    (
        "heading",
        evidence(ego=states(speed=0.1)),
        9.0,
        "No sensor measures which way the car points while it stands (9.0 s, 100 % of the track).",
    ),
    (
        "noise",
        evidence(source(nis_per_dof=4.0, nis_inside=False)),
        4.0,
        "/gps/fix position scatters 2.0 times as much as its uncertainty says.",
    ),
    ("resets", evidence(source(resets=2)), 2.0, "/gps/fix position jumped 2 times, and the track with it."),
    (
        "camera",
        assumed_camera_evidence(),
        2.0,
        "The camera's lens and mounting are assumed, so every distance to the lane may be wrong.",
    ),
    (
        "times",
        evidence(end_ns=480 * 3600 * S),
        480.0 - 9 / 3600,
        "The log is 20.0 days long, and 20.0 days without interruption have no state of the car.",
    ),
    (
        "silence",
        evidence(silences=[silence()], ego=minute_of_states()),
        24.0,
        "/wheel reports no speed from 36 s on (24.0 s, to the end); there the states rest on /gps/fix (position) and "
        "/imu (acceleration, yaw rate).",
    ),
    (
        "gaps",
        evidence(ego=states(flags=int(StateFlag.BRIDGED))),
        1.0,
        "In 100 % of the track no position was measured, so it is estimated from the other sensors.",
    ),
    (
        "late",
        evidence(
            sections=(
                nees(["position", 1.0, "in"]),
                table("online", ["channel", "95 % of delays below [s]"], ["/cwcli/ego/online", 1.5]),
            )
        ),
        1.5,
        "A car could have known these states only 1.5 s late, so warnings come as late.",
    ),
    (
        "rejected",
        evidence(counts=[{"topic": "/gps/fix", "read": 50, "rejected": {"no fix": 20, "not finite": 5}}]),
        0.5,
        "50 % of the messages of /gps/fix could not be used (most: no fix).",
    ),
    ("damaged", evidence(faults={"chunks lost": 2}), 2.0, "The file is damaged (chunks lost: 2)."),
    (
        "correction",
        evidence(more={"corrections": ["ego_speed (/wheel) is in km/h, not m/s: converted"]}),
        1.0,
        "The speed in /wheel is in km/h, not m/s: converted.",
    ),
]


@pytest.mark.parametrize(("name", "found", "value", "sentence"), DOUBTFUL, ids=[case[0] for case in DOUBTFUL])
def test_doubt_is_found_alone_with_its_number(name: str, found: DoubtEvidence, value: float, sentence: str) -> None:
    (doubt,) = find_doubts_in_evidence(found)
    assert (doubt.name, doubt.sentence) == (name, sentence)
    assert doubt.value == pytest.approx(value)
    assert doubt.value >= doubt.threshold == DOUBT_RULES[name].threshold
    assert doubt.advice.endswith(".")


def test_every_doubt_has_a_case() -> None:
    assert [case[0] for case in DOUBTFUL] == [name for name, rule in DOUBT_RULES.items() if not rule.is_remark]


def test_a_contradicted_lens_is_told_instead_of_an_assumed_one() -> None:
    [doubt] = find_doubts_in_evidence(assumed_camera_evidence(CONTRADICTED_LENS_NOTE_BEGINNING))
    told = "As the car turns, the lane moves as another lens would show it: every distance may be wrong."
    assert (doubt.name, doubt.sentence) == ("camera", told)


def test_what_was_repaired_comes_behind_what_is_not() -> None:
    """A headline "a wrong sensor was corrected" before a speed of 211 km/h would hide the worse of both."""
    found = find_doubts_in_evidence(
        evidence(more={"corrections": ["ego_speed (/w) is in km/h: converted"]}, ego=states(speed=-211.0 / 3.6))
    )
    assert [(doubt.name, doubt.is_repaired) for doubt in found] == [("speed", False), ("correction", True)]


INNOCENT = {
    "nothing is doubtful": evidence(),
    "fast on a motorway": evidence(ego=states(speed=190.0 / 3.6)),
    "a bend at the limit": evidence(ego=states(speed=30.0, yaw_rate=0.3, accel=-9.0)),
    "noisy fixes within their sigma": evidence(fix_offsets=[{"offset_m": 9.0, "sigma_m": 3.0, "stamp_ns": 0}]),
    "an offset that matters to nobody": evidence(fix_offsets=[{"offset_m": 1.9, "sigma_m": 0.1, "stamp_ns": 0}]),
    "an hour without a fix": evidence(end_ns=3600 * S),
    "a few gated": evidence(source(used=96, gated=4)),
    "a standstill with a gyroscope": evidence(source(), source("yaw_rate"), ego=states(speed=0.0)),
    "a standstill with a compass": evidence(source(), source("heading"), ego=states(speed=0.0)),
    "noise within a factor": evidence(source(nis_per_dof=1.9, nis_inside=False)),
    "noise within its bounds": evidence(source(nis_per_dof=2.5, nis_inside=True)),
    "another vehicle's reset": evidence(source(), source(vehicle="7", resets=3, gated=50)),
    "a standing car without a course": evidence(
        source(), source("yaw_rate"), silences=[silence()], ego=minute_of_states(speed=0.1)
    ),
    "a short silence": evidence(silences=[silence(50, 60)], ego=minute_of_states()),
    "two rejected messages": evidence(counts=[{"topic": "/imu", "read": 50, "rejected": {"no fix": 2}}]),
}


@pytest.mark.parametrize("found", INNOCENT.values(), ids=INNOCENT.keys())
def test_no_doubt_without_reason(found: DoubtEvidence) -> None:
    assert names(found) == []


def test_worst_kind_comes_first_and_within_it_the_largest() -> None:
    found = evidence(
        source(nis_per_dof=4.0, nis_inside=False), source("speed", nis_per_dof=9.0, nis_inside=False, resets=1)
    )
    doubts = find_doubts_in_evidence(found)
    assert [(each.name, each.value) for each in doubts] == [("noise", 9.0), ("noise", 4.0), ("resets", 1.0)]


def test_missing_truth_is_a_remark_and_no_doubt() -> None:
    found = evidence(sections=())
    assert names(found) == []
    assert [each.name for each in find_remarks_in_evidence(found)] == ["no-truth"]
    assert find_remarks_in_evidence(evidence()) == ()


def test_without_a_truth_the_estimate_says_its_own_errors() -> None:
    columns = ["vehicle", "median position sigma per axis [m]"]
    found = evidence(sections=(table("vehicles", columns, ["17", 9.0], ["ego", 0.257]),))
    (remark,) = find_remarks_in_evidence(found)
    assert remark.sentence == (
        "The log has no true positions to compare with, so the size of the errors is not known. cwcli itself reckons "
        "with typical errors of 0.26 m (position on one axis)."
    )


def test_several_truths_are_named_to_choose_from() -> None:
    note = "two channels hold the truth: /a (T) and /b (T); none is used (choose one with --topic truth=/a or --topic"
    found = evidence(sections=(), more={"notes": [f"{note} truth=/b)"]})
    (remark,) = find_remarks_in_evidence(found)
    assert remark.sentence.endswith("; choose one with --topic truth=/a or --topic truth=/b.")


def test_error_against_the_truth_is_told_in_its_unit() -> None:
    errors = {"key": "errors", "title": "", "columns": ["quantity", "unit", "RMS error of estimates"]}
    rows = [["position on one axis", "m", 0.1], ["heading", "deg", 0.704]]
    found = evidence(sections=(nees(["heading", 16.0, "OUT"]), {**errors, "rows": rows}))
    (doubt,) = find_doubts_in_evidence(found)
    assert (
        doubt.sentence
        == "Compared with the true motion in the log, the heading is off by 0.70 deg, 4.0 times its own uncertainty."
    )


def test_truth_that_differs_by_a_rule_is_told_once_and_blames_no_sensor() -> None:
    rule = {"text": "is 0.2 s late, as by another clock", "advice": "Check its clock.", "nees_per_dof": 0.81}
    found = evidence(
        sections=(nees(["position", 91.0, "OUT"], ["speed", 392.0, "OUT"], ["heading", 4.0, "OUT"]),),
        truth_rules={"position": rule, "speed": rule, "course": 7},
    )
    first, second = find_doubts_in_evidence(found)
    assert first.sentence == (
        "The truth (position, speed) is 0.2 s late, as by another clock; without that difference the track is off by "
        "0.9 times its own uncertainty."
    )
    assert (first.name, first.value, first.advice) == ("errors", 392.0, "Check its clock.")
    assert second.sentence.startswith("Compared with the true motion in the log, the heading is off by 2.0 times")


def test_errors_are_read_from_the_table_that_the_estimate_writes() -> None:
    """The rule finds the columns by their headings, so a renamed heading would silence the doubt."""
    heading = SimpleNamespace(name="heading", per_dof=16.0, bounds=(0.8, 1.2), is_within_bounds=False)
    section = build_nees_section(SimpleNamespace(nees=[heading]))  # type: ignore[arg-type]
    recorded = {"key": section.key, "title": "", "columns": list(section.columns), "rows": [list(section.rows[0])]}
    assert names(evidence(sections=(recorded,))) == ["errors"]


@pytest.mark.parametrize(
    ("recorded", "sentence"),
    [
        (
            "ego_speed (/wheel) repeats one value: 400 rows set aside (at 9.5 s; --trust /wheel leaves it unchanged)",
            "The speed in /wheel repeats one value: 400 rows set aside (at 9.5 s).",
        ),
        (
            "imu (/wheel) has a gyroscope with the wrong sign: reversed (log-likelihood ratio 156 by /fix, /compass; "
            "--trust /wheel leaves it unchanged)",
            "The IMU in /wheel has a gyroscope with the wrong sign: reversed (shown by /fix, /compass).",
        ),
    ],
)
def test_correction_is_in_common_words_and_has_one_option(recorded: str, sentence: str) -> None:
    (doubt,) = find_doubts_in_evidence(evidence(more={"corrections": [recorded]}))
    assert doubt.sentence == sentence
    assert doubt.advice == "Check that sensor, or mend the recording; --trust /wheel leaves it unchanged."
    assert doubt.is_repaired


def test_fault_of_a_file_is_counted_if_there_are_several() -> None:
    (doubt,) = find_doubts_in_evidence(evidence(faults={"file cut short": 1, "chunks lost": 0}))
    assert doubt.sentence == "The file is damaged (file cut short)."


def test_sources_in_a_contradiction_are_in_common_words() -> None:
    recorded = "imu yaw rate (/imu) contradicts ego_heading (/compass): its sign; imu accel (/imu) agrees with gravity"
    (doubt,) = find_doubts_in_evidence(evidence(more={"contradictions": [recorded]}))
    assert doubt.sentence == (
        "The yaw rate in /imu contradicts the heading in /compass: its sign; the acceleration in /imu agrees with "
        "gravity."
    )


@pytest.mark.parametrize(
    "entries",
    [
        {},
        {"summary": "3", "sources": "{}", "fix_offsets": "7", "counts": "null"},
        {"summary": json.dumps({"contradictions": {"a": 1}, "sections": [{"key": "nees"}, 7]})},
        {"summary": json.dumps({"sections": [nees(["position", 10**400, "OUT"], [None, True, "OUT"])]})},
        {"sources": json.dumps([7, {"vehicle": "ego"}, source(nis_per_dof="x", gated=None, resets=[])])},
        {"sources": json.dumps([source([]), source({}), source(resets=math.inf), source(gated=math.inf)])},
        {"sources": json.dumps([source(source=["a"], resets=-math.inf, nis_per_dof=math.inf, nis_inside=False)])},
        {"counts": json.dumps([{"topic": [1], "read": 10, "rejected": {"y": math.inf}}])},
        {"silences": json.dumps([7, {"begin_ns": "x"}, silence(quantities=3), silence(others=None), silence(60, 36)])},
        {"fix_offsets": json.dumps([7, {"offset_m": "far"}, {"offset_m": 9.0, "sigma_m": 0.0}])},
        {"counts": json.dumps([{"topic": "/a", "read": "x", "rejected": {"y": 3}}, {"rejected": 3}])},
    ],
)
def test_record_of_anybody_raises_nothing_and_doubts_nothing(entries: dict[str, str]) -> None:
    assert names(DoubtEvidence({"estimate": entries}, states())) == []
    assert names(DoubtEvidence({"estimate": entries})) == []


def track(offset_m: np.ndarray, sigma_m: float) -> tuple[list[Measurements], Track]:
    """A car that stands at the origin for as many tenths of seconds as there are offsets (n, 2), and its fixes."""
    n = len(offset_m)
    stamp_ns = np.arange(n) * S // 10
    fixes = Measurements("/fix", Kind.POSITION, stamp_ns, offset_m)
    covariance = np.tile(np.eye(8) * sigma_m**2, (n, 1, 1))
    report = SourceReport("/fix", Kind.POSITION)
    return [fixes], Track(stamp_ns, np.zeros((n, 8)), covariance, np.zeros(n, np.uint8), (report,))


def entry_of(offset_m: np.ndarray, sigma_m: float = 0.5) -> dict[str, Any]:
    (entry,) = json.loads(fix_offsets_to_record_entry(*track(offset_m, sigma_m))["fix_offsets"])
    return dict(entry)


def test_offset_is_that_which_lasts() -> None:
    offset_m = np.zeros((100, 2))
    offset_m[20] = 50.0  # an outlier
    offset_m[50:80] = 3.6, 4.8
    found = entry_of(offset_m)
    assert (found["offset_m"], found["sigma_m"], found["stamp_ns"]) == (6.0, 0.5, 5 * S)
    doubts = find_doubts_in_evidence(evidence(fix_offsets=[found]))
    assert [(each.name, each.value) for each in doubts] == [("fixes", 12.0)]


def test_noise_of_the_fixes_is_no_offset() -> None:
    rng = np.random.default_rng(0)
    noise_m = 3.0 * rng.standard_normal((600, 2))
    assert entry_of(noise_m)["sigma_m"] == pytest.approx(math.hypot(3.0, 0.5), rel=0.1)
    assert names(evidence(fix_offsets=[entry_of(noise_m)])) == []


def test_offset_in_a_part_that_was_cut_out_is_no_doubt() -> None:
    """The record is of the whole log; states 0 to 9 s are left of it."""
    offset = {"offset_m": 9.0, "sigma_m": 1.0}
    assert names(evidence(fix_offsets=[{**offset, "stamp_ns": 5 * S}])) == ["fixes"]
    assert names(evidence(fix_offsets=[{**offset, "stamp_ns": 60 * S}])) == []
    assert names(evidence(fix_offsets=[offset])) == ["fixes"]


def test_doubts_of_the_whole_log_say_so_in_a_part() -> None:
    """Twenty states were estimated, ten are left: counts are of all, flags and states of the part."""

    def doubts(n_estimated: int, flags: int = 0) -> list[str]:
        vehicles = table("vehicles", ["vehicle", "states"], ["ego", n_estimated])
        bad = source(used=90, gated=10, resets=1, nis_per_dof=4.0, nis_inside=False)
        found = evidence(bad, ego=states(flags), sections=(nees(["position", 9.0, "OUT"]), vehicles))
        return [f"{each.name}: {each.sentence}" for each in find_doubts_in_evidence(found)]

    words = "In the whole drive, of which this log is a part, "
    whole, part = doubts(10), doubts(20)
    assert [each.split(":")[0] for each in whole] == ["errors", "gated", "noise", "resets"]
    assert not any(words in each for each in whole)
    assert [each.split(":")[0] for each in part] == [
        "errors",
        "gated",
        "noise",
    ]  # no state of the part is after a reset
    assert all(words in each for each in part)
    assert doubts(20, int(StateFlag.AFTER_RESET))[-1] == (
        f"resets: {words}/gps/fix position jumped 1 time, and the track with it."
    )


def test_each_doubt_from_a_record_alone_is_of_the_whole_log() -> None:
    """A rule that reads neither states nor times of the part can't tell of it: without states it finds the same."""
    for name, found, _, _ in DOUBTFUL:
        without = DoubtEvidence(found.records, None, found.start_ns, found.end_ns)
        if name in names(without) and name not in {"camera", "fixes"}:  # of every frame; restricted by its stamp
            assert DOUBT_RULES[name].is_of_whole_log, name


def test_least_over_window_by_hand() -> None:
    time_s = np.array([0.0, 1.0, 2.0, 3.0, 9.0])
    # windows of 2 s: rows 0-1, 1-2, 2-3, 3 alone (not whole), and none behind the last
    np.testing.assert_array_equal(
        least_value_in_window_from_each_row(time_s, np.array([5.0, 4.0, 7.0, 6.0, 1.0]), 2.0), [4, 4, 6, 0, 0]
    )


def test_silence_of_the_positions_is_told_once() -> None:
    """States flagged bridged in it are no further doubt; those elsewhere are."""
    bridged = minute_of_states(flags=int(StateFlag.BRIDGED))
    lost = silence(10, 60, source="/gps/fix", quantities=["position"], others={"/imu": ["yaw rate"]})
    (doubt,) = find_doubts_in_evidence(evidence(silences=[lost], ego=bridged))
    assert doubt.name == "silence"
    assert doubt.advice.startswith("Find out why that sensor was silent; leave that part out with --end 10")
    assert names(evidence(silences=[{**lost, "begin_ns": 30 * S}], ego=bridged)) == ["silence", "gaps"]


def test_silence_at_the_start_and_within_the_log_say_when() -> None:
    begin = evidence(silences=[silence(0, 20, from_the_start=True), silence(20, 35)], ego=minute_of_states())
    first, second = find_doubts_in_evidence(begin)
    assert "reports no speed before 20 s (20.0 s)" in first.sentence
    assert "reports no speed between 20 and 35 s (15.0 s)" in second.sentence


def sensor(source: str, kind: Kind, *spans_s: tuple[float, float], step_s: float = 0.1) -> Measurements:
    """Rows of a kind in some spans of time."""
    stamp_s = np.concatenate([np.arange(begin, end + 1e-9, step_s) for begin, end in spans_s])
    width = {Kind.POSITION: 2, Kind.VELOCITY: 2, Kind.IMU: 6}.get(kind, 1)
    return Measurements(source, kind, np.rint(stamp_s * 1e9).astype(np.int64), np.zeros((len(stamp_s), width)))


def silences_of(*measurements: Measurements) -> list[tuple[str, list[str], float, float]]:
    found = json.loads(lost_quantity_spans_to_record_entry(measurements)["silences"])
    return [(each["source"], each["quantities"], each["begin_ns"] / S, each["end_ns"] / S) for each in found]


FIX, IMU = sensor("/fix", Kind.POSITION, (5, 100)), sensor("/imu", Kind.IMU, (0, 100))


@pytest.mark.parametrize(
    ("measurements", "expected"),
    [
        ((FIX, IMU), []),
        ((FIX, IMU, sensor("/wheel", Kind.SPEED, (0, 60))), [("/wheel", ["speed"], 60.0, 100.0)]),
        ((FIX, IMU, sensor("/wheel", Kind.SPEED, (30, 95))), [("/wheel", ["speed"], 5.0, 30.0)]),
        ((FIX, sensor("/imu", Kind.IMU, (0, 40), (60, 100))), [("/imu", ["acceleration", "yaw rate"], 40.0, 60.0)]),
        ((sensor("/fix", Kind.POSITION, (5, 70)), IMU), [("/fix", ["position"], 70.0, 100.0)]),
        # the velocity tells the speed, too
        ((FIX, sensor("/wheel", Kind.SPEED, (0, 60)), sensor("/vel", Kind.VELOCITY, (0, 100))), []),
        ((FIX, sensor("/vel", Kind.VELOCITY, (0, 60)), sensor("/wheel", Kind.SPEED, (0, 100))),
         [("/vel", ["heading"], 60.0, 100.0)]),
        # one topic, two quantities
        ((FIX, IMU, sensor("/car", Kind.SPEED, (5, 60)), sensor("/car", Kind.HEADING, (5, 60))),
         [("/car", ["speed", "heading"], 60.0, 100.0)]),
        # a slow source, and a pause of the whole recording
        ((FIX, sensor("/compass", Kind.HEADING, (5, 98), step_s=3.0)), []),
        ((sensor("/fix", Kind.POSITION, (5, 30), (60, 90)), sensor("/imu", Kind.IMU, (0, 30), (60, 90))), []),
    ],
)  # fmt: skip
def test_silences_are_those_of_quantities_that_nothing_else_tells(
    measurements: tuple[Measurements, ...], expected: list[tuple[str, list[str], float, float]]
) -> None:
    found = silences_of(*measurements)
    assert [each[:2] for each in found] == [each[:2] for each in expected]
    assert [s for each in found for s in each[2:]] == pytest.approx([s for each in expected for s in each[2:]])


def test_rows_without_a_number_are_silence() -> None:
    wheel = sensor("/wheel", Kind.SPEED, (0, 100))
    wheel.values[601:] = np.nan
    ((source, lost, begin_s, end_s),) = silences_of(FIX, IMU, wheel)
    assert (source, lost) == ("/wheel", ["speed"])
    assert (begin_s, end_s) == pytest.approx((60.0, 100.0))
