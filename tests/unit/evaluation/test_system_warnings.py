"""Another system's warnings, scored: expected values by construction (`system_logs`)."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cwcli.errors import DataError, MissingSignalError, UsageError
from cwcli.evaluation.actual_outcomes import find_actual_outcomes
from cwcli.evaluation.conflicts import VERDICT_FALSE, VERDICT_TRUE, VERDICT_UNDECIDED, judge_warning
from cwcli.evaluation.evaluate_log import evaluate_log
from cwcli.evaluation.scored_warnings import score_warning_verdicts
from cwcli.evaluation.system.flag import read_flag_from_topic
from cwcli.evaluation.system.warnings import judge_flag_warnings
from cwcli.evaluation.system_topics import parse_other_system_options
from cwcli.logs.read.reader import Log
from cwcli.metrics.pooling import metric_rows_by_name, notes_from_metadata
from cwcli.signals.field_condition import parse_condition
from tests.unit.evaluation.small_logs import log_of
from tests.unit.evaluation.system_logs import (
    CONFLICT_S,
    EVERY_S,
    at_ns,
    bool_log,
    is_up,
    json_log,
    meetings_s,
    ros_log,
    states_of_meetings,
    ticks,
    with_meetings,
)

N = 20
TTC_S, DELAY_S, RATE_HZ = 2.0, 0.1, 50.0
MISSED = (4, 12)
"""10 % of the conflicts."""
FALSE_AT_S = (15.5, 45.5, 85.5, 125.5, 165.5)
"""Half a second after a vehicle has gone from 55 m to where the next one is 45 m away: no conflict within 2.5 s of it,
and the nearest vehicle is known for as long. The next conflict is 4.3 s later, so the most that a warning may be ahead
of its conflict is set to 3 s."""
END_S = EVERY_S * (N + 1)
RECORDS = {"cwcli.run.warn": {"configuration": '{"rule": {"max_lead_s": 3.0}}'}}


def made_up_spans() -> list[tuple[float, float]]:
    """A TTC flag with 100 ms delay: up from a TTC of 2 s (+ 0.1 s) until a second after the meeting."""
    right = [(at - TTC_S + DELAY_S, at + 1.0 + DELAY_S) for k, at in enumerate(meetings_s(N)) if k not in MISSED]
    return sorted([*right, *((at, at + 0.4) for at in FALSE_AT_S)])


def metrics(log: Log, warning: str = "/adas/fcw:data==true") -> dict[str, float]:
    table = evaluate_log(log, system=parse_other_system_options([f"warning={warning}"]))
    return {name: row.value for name, row in metric_rows_by_name(table).items() if name.startswith("system.")}


def test_a_made_up_second_system_is_scored_exactly(tmp_path: Path) -> None:
    path = bool_log(tmp_path / "a.mcap", made_up_spans(), END_S)
    log = Log.open(path).with_channels(states_of_meetings(N), RECORDS)
    found = metrics(log)
    hours = END_S / 3600.0
    lead_s = TTC_S - DELAY_S - CONFLICT_S
    expected = {
        "system.warnings.count": 23,  # 18 right, 5 false
        "system.warnings.conflicts_count": 20,
        "system.warnings.missed_count": 2,
        "system.warnings.false_count": 5,
        "system.warnings.undecided_count": 0,
        "system.warnings.precision": 18 / 23,
        "system.warnings.recall": 18 / 20,
        "system.warnings.timeliness": 1.0,
        "system.warnings.lead_time_mean_s": lead_s,
        "system.warnings.lead_time_min_s": lead_s,
        "system.warnings.false_alarms_per_hour": 5 / hours,
        "system.warnings.raised_per_hour": 23 / hours,
    }
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("delay_s", [1.0, 1.9, 2.0])
def test_a_later_flag_has_less_lead_and_then_is_late(tmp_path: Path, delay_s: float) -> None:
    spans = [(at - TTC_S + delay_s, at + 1.0) for at in meetings_s(3)]
    found = metrics(with_meetings(bool_log(tmp_path / "a.mcap", spans, 40.0), 3))
    lead_s = TTC_S - delay_s - CONFLICT_S
    assert found["system.warnings.lead_time_mean_s"] == pytest.approx(lead_s, abs=1e-6)
    assert found["system.warnings.timeliness"] == (1.0 if lead_s > 0 else 0.0)
    assert found["system.warnings.recall"] == 1.0


def test_with_one_vehicle_a_flag_is_judged_like_cwclis_own_warnings(tmp_path: Path) -> None:
    """`judge_flag_warnings` holds all warnings against all conflicts at once; `judge` one after the other, pair by
    pair."""
    log = log_of(tmp_path / "a.mcap", states_of_meetings(1))
    real = find_actual_outcomes(log)
    assert real is not None
    ((vehicle, pair),) = real.pairs.items()
    rng = np.random.default_rng(3)
    begins = np.sort(rng.uniform(-2.0, 22.0, 300))
    spans = [(at_ns(begin), at_ns(begin + rng.uniform(0.0, 9.0))) for begin in begins]
    verdicts = [judge_warning(*span, real.conflicts[vehicle], pair, real.config) for span in spans]
    found = judge_flag_warnings(spans, real)
    assert [(each.kind, each.conflict is not None) for each in found.judged] == [
        (each.kind, each.conflict_index >= 0) for each in verdicts
    ]
    expected = score_warning_verdicts([verdicts], n_conflicts=1, host_hours=real.host_hours)
    assert found.scores == expected
    assert {VERDICT_FALSE, VERDICT_TRUE, VERDICT_UNDECIDED} <= {each.kind for each in found.judged}


STATUS = """std_msgs/Header header
diagnostic_msgs/DiagnosticStatus[] status
================================================================================
MSG: diagnostic_msgs/DiagnosticStatus
byte OK=0
byte WARN=1
byte level
string name
string message
string hardware_id
diagnostic_msgs/KeyValue[] values
================================================================================
MSG: diagnostic_msgs/KeyValue
string key
string value
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""
SPANS = [(8.5, 11.0), (18.5, 21.0)]


def diagnostics(at: float, up: bool) -> dict[str, Any]:
    """The FCW beside another component, in an order that changes."""
    values = [{"key": "speed", "value": "10.0"}, {"key": "ttc", "value": "1.2" if up else "inf"}]
    # No dictionaries: mcap-ros2-support 0.5 takes their method `values` for the field.
    fcw = SimpleNamespace(level=2 if up else 0, name="adas: fcw", message="", hardware_id="", values=values)
    other = SimpleNamespace(level=2, name="disk", message="full", hardware_id="", values=[])
    second = at_ns(at)
    stamp = {"sec": second // 10**9, "nanosec": second % 10**9}
    return {
        "header": {"stamp": stamp, "frame_id": ""},
        "status": [fcw, other] if round(at * 50) % 2 else [other, fcw],
    }


@pytest.mark.parametrize(
    "condition",
    ["status[name=='adas: fcw'].level>=2", "status[name=='adas: fcw'].values[key==ttc].value<1.5"],
)
def test_a_flag_in_diagnostics(tmp_path: Path, condition: str) -> None:
    messages = [(at, diagnostics(at, is_up(SPANS, at))) for at in ticks(30.0)]
    path = ros_log(tmp_path / "a.mcap", "diagnostic_msgs/msg/DiagnosticArray", STATUS, messages)
    found = metrics(with_meetings(path, 2), f"/adas/fcw:{condition}")
    assert found["system.warnings.count"] == found["system.warnings.conflicts_count"] == 2
    assert found["system.warnings.lead_time_mean_s"] == pytest.approx(1.5 - CONFLICT_S, abs=1e-6)


def test_messages_of_other_components_change_nothing(tmp_path: Path) -> None:
    """Several nodes publish on /diagnostics: a message without the element says nothing, the flag stays as it is."""

    def message(k: int, at: float) -> dict[str, Any]:
        whole = diagnostics(at, is_up(SPANS, at))
        whole["status"] = [each for each in whole["status"] if (each.name == "disk") == bool(k % 3)]
        return whole

    messages = [(at, message(k, at)) for k, at in enumerate(ticks(30.0))]
    path = ros_log(tmp_path / "a.mcap", "diagnostic_msgs/msg/DiagnosticArray", STATUS, messages)
    log = with_meetings(path, 2)
    system = parse_other_system_options(["warning=/adas/fcw:status[name=='adas: fcw'].level>=2"])
    table = evaluate_log(log, system=system)
    assert metric_rows_by_name(table)["system.warnings.count"].value == 2
    assert "/adas/fcw: 1000 of 1500 messages lack the field: the flag counts as unchanged" in notes_from_metadata(table)


@pytest.mark.parametrize(
    ("make", "condition"),
    [
        (lambda up: {"fcw": {"active": up}}, "fcw.active==true"),
        (lambda up: {"fcw": {"active": int(up)}}, "fcw.active==true"),
        (lambda up: {"state": "WARN" if up else "OK"}, "state==WARN"),
        (lambda up: {"state": "WARN" if up else "OK"}, "state!='OK'"),
        (lambda up: {"ttc": 1.2 if up else None}, "ttc<1.5"),
        (lambda up: {"ttc": 1.2} if up else {}, "ttc<1.5"),
        (lambda up: {"ttc": 1.2 if up else float("nan")}, "ttc<1.5"),
        (lambda up: {"ttc": "1.2" if up else "9"}, "ttc<1.5"),
        (lambda up: {"levels": [0, 3 if up else 1]}, "levels[1]>=2"),
        (lambda up: {"levels": [0, 3 if up else 1]}, "levels[-1]>=2"),
        (lambda up: {"all": [{"id": 7, "on": up}, {"id": 8, "on": True}]}, "all[id==7].on==true"),
        (lambda up: {"all": [{"id": 7, "on": up}, {"id": 8, "on": True}]}, "all[0].on==true"),
    ],
)
def test_conditions_on_json(tmp_path: Path, make: Any, condition: str) -> None:
    path = json_log(tmp_path / "a.mcap", [(at, make(is_up(SPANS, at))) for at in ticks(30.0)])
    found = metrics(with_meetings(path, 2), f"/adas/fcw:{condition}")
    assert found["system.warnings.count"] == 2
    assert found["system.warnings.lead_time_mean_s"] == pytest.approx(1.5 - CONFLICT_S, abs=1e-6)


@pytest.mark.parametrize(
    ("definition", "make", "condition"),
    [
        ("bool data", lambda up: {"data": up}, "data==true"),
        ("bool data", lambda up: {"data": up}, "data!=false"),
        ("int8 data", lambda up: {"data": 2 if up else -1}, "data>=2"),
        ("uint64 data", lambda up: {"data": 2 if up else 0}, "data==true"),
        ("float32 data", lambda up: {"data": 1.0 if up else float("nan")}, "data<1.5"),
        ("string data", lambda up: {"data": "forward collision" if up else ""}, "data=='forward collision'"),
        ("string[] data", lambda up: {"data": ["ok", "fcw"] if up else ["ok", "ok"]}, "data[1]==fcw"),
        ("int16[3] data", lambda up: {"data": [0, 0, int(up)]}, "data[2]==1"),
    ],
)
def test_conditions_on_ros_messages(tmp_path: Path, definition: str, make: Any, condition: str) -> None:
    messages = [(at, make(is_up(SPANS, at))) for at in ticks(30.0)]
    path = ros_log(tmp_path / "a.mcap", "std_msgs/msg/Made", definition, messages)
    found = metrics(with_meetings(path, 2), f"/adas/fcw:{condition}")
    assert found["system.warnings.count"] == 2
    assert found["system.warnings.lead_time_mean_s"] == pytest.approx(1.5 - CONFLICT_S, abs=1e-6)


def test_a_flag_of_a_kilohertz(tmp_path: Path) -> None:
    spans = [(at - TTC_S + DELAY_S, at + 1.0) for at in meetings_s(3)]
    path = bool_log(tmp_path / "a.mcap", spans, 40.0, rate_hz=1000.0)
    found = metrics(with_meetings(path, 3))
    assert found["system.warnings.count"] == 3
    assert found["system.warnings.lead_time_mean_s"] == pytest.approx(TTC_S - DELAY_S - CONFLICT_S, abs=1e-6)


def flag_notes(path: Path, condition: str = "data==true") -> tuple[list[tuple[int, int]], str]:
    with Log.open(path) as log:
        flag = read_flag_from_topic(log, "/adas/fcw", parse_condition(condition))
    return flag.warning_spans_ns(), " ".join(flag.notes)


@pytest.mark.parametrize(
    ("spans", "n_warnings", "said"),
    [
        ([], 0, "holds in none of 500 messages: it never warned"),
        ([(0.0, 99.0)], 0, "holds in all of 500 messages: a stuck flag is no warning"),
        ([(0.0, 2.0), (5.0, 6.0)], 1, "set in its first message"),
        ([(2.0, 99.0)], 1, "holds in 80 % of 500 messages: is it a warning?"),
        ([(2.0, 3.0)], 1, ""),
    ],
)
def test_flags_that_hardly_change(tmp_path: Path, spans: list[tuple[float, float]], n_warnings: int, said: str) -> None:
    found, notes = flag_notes(bool_log(tmp_path / "a.mcap", spans, 10.0))
    assert len(found) == n_warnings
    assert said in notes if said else not notes


def test_a_flag_is_up_from_its_first_true_message_to_its_last(tmp_path: Path) -> None:
    found, _ = flag_notes(json_log(tmp_path / "a.mcap", [(at, {"data": 2.0 < at < 5.0}) for at in range(10)]))
    assert found == [(at_ns(3.0), at_ns(4.0))]


def test_stamps_of_another_clock(tmp_path: Path) -> None:
    """The logger is 18 s ahead of the stamps, by which the states are: the warnings are where the states are."""

    def message(at: float) -> dict[str, Any]:
        sec, nanosec = divmod(at_ns(at) - 18 * 10**9, 10**9)
        return {"header": {"stamp": {"sec": sec, "nanosec": nanosec}}, "data": 2.0 < at < 5.0}

    found, notes = flag_notes(json_log(tmp_path / "a.mcap", [(at, message(at)) for at in range(10)]))
    assert found == [(at_ns(3.0 - 18.0), at_ns(4.0 - 18.0))]
    assert "its stamps are -18.000 s from its log times: two clocks" in notes


def test_a_wrong_field_lists_those_that_there_are(tmp_path: Path) -> None:
    messages = [(at, diagnostics(at, False)) for at in ticks(1.0)]
    path = ros_log(tmp_path / "a.mcap", "diagnostic_msgs/msg/DiagnosticArray", STATUS, messages)
    with Log.open(path) as log, pytest.raises(UsageError, match="its messages have no such field") as caught:
        read_flag_from_topic(log, "/adas/fcw", parse_condition("state[0].level>=2"))
    assert "status[].level (a whole number)" in caught.value.found
    assert "status[].name (a text such as 'disk')" in caught.value.found
    assert "status[].values[].key (a text such as 'speed')" in caught.value.found


@pytest.mark.parametrize("condition", ["status[name==aeb].level>=2", "status[5].level>=2", "header.seq==1"])
def test_an_element_that_no_message_has(tmp_path: Path, condition: str) -> None:
    messages = [(at, diagnostics(at, False)) for at in ticks(1.0)]
    path = ros_log(tmp_path / "a.mcap", "diagnostic_msgs/msg/DiagnosticArray", STATUS, messages)
    with Log.open(path) as log, pytest.raises(UsageError) as caught:
        read_flag_from_topic(log, "/adas/fcw", parse_condition(condition))
    assert any(each.startswith("status[].name") for each in caught.value.found)


def test_text_that_is_asked_for_a_number(tmp_path: Path) -> None:
    path = ros_log(tmp_path / "a.mcap", "std_msgs/msg/String", "string data", [(0.0, {"data": "ALARM"})] * 3)
    with Log.open(path) as log, pytest.raises(UsageError, match="can't be compared so") as caught:
        read_flag_from_topic(log, "/adas/fcw", parse_condition("data>=2"))
    assert caught.value.found == ("data (a text such as 'ALARM')",)
    mixed = [(float(k), {"data": "2" if k == 3 else "n/a"}) for k in range(6)]
    path = ros_log(tmp_path / "b.mcap", "std_msgs/msg/String", "string data", mixed)
    found, notes = flag_notes(path, "data>=2")
    assert found == [(at_ns(3.0), at_ns(3.0))]
    assert "in 5 of 6 messages `data>=2` can't be compared: it counts as not set" in notes


def test_messages_that_cannot_be_decoded(tmp_path: Path) -> None:
    good = [(float(k), {"data": k == 3}) for k in range(6)]
    found, notes = flag_notes(json_log(tmp_path / "a.mcap", [*good, (7.0, b"{broken")]))
    assert found == [(at_ns(3.0), at_ns(3.0))]
    assert "1 message could not be decoded" in notes
    path = json_log(tmp_path / "b.mcap", [(7.0, b"{broken")])
    with Log.open(path) as log, pytest.raises(DataError, match="none of its 1 messages can be decoded"):
        read_flag_from_topic(log, "/adas/fcw", parse_condition("data==true"))
    path = json_log(tmp_path / "c.mcap", [])
    with Log.open(path) as log, pytest.raises(MissingSignalError, match="holds no message"):
        read_flag_from_topic(log, "/adas/fcw", parse_condition("data==true"))


def test_without_states_there_is_nothing_to_judge_by(tmp_path: Path) -> None:
    path = bool_log(tmp_path / "a.mcap", [(1.0, 2.0)], 3.0)
    with Log.open(path) as log, pytest.raises(MissingSignalError, match="holds no states of the ego and the others"):
        evaluate_log(log, system=parse_other_system_options(["warning=/adas/fcw:data==true"]))
    with Log.open(path) as log, pytest.raises(UsageError, match="the log has no such topic") as caught:
        evaluate_log(log, system=parse_other_system_options(["warning=/adas/fcx:data==true"]))
    assert caught.value.found == ("/adas/fcw (std_msgs/msg/Bool)",)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["warning=/adas/fcw"], "expected warning=/topic:field==value"),
        (["warning=/adas/fcw:"], "expected warning=/topic:field==value"),
        (["warning=:data==1"], "expected warning=/topic:field==value"),
        (["alarm=/adas/fcw:data==1"], "there is no role alarm of another system"),
        (["warning=/a:x==1", "warning=/b:x==1"], "is given twice"),
        (["/adas/fcw"], "expected ROLE=/topic"),
        (["warning=/a:x"], "expected `.`, `[` or one of <= >= == != < >"),
    ],
)
def test_options_that_name_no_system(options: list[str], said: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_other_system_options(options)
    assert said in str(caught.value)
