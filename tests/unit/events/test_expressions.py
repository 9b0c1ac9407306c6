"""Expressions: what they mean at each moment, by hand; names, units and windows that make no sense are refused."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

from cwcli.channels.published import EGO_STATE
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.errors import MissingSignalError, UsageError
from cwcli.events import EVENTS, search
from cwcli.events.base import Moment, severity_as_ratio_to_threshold
from cwcli.events.quantities import trailing_window_values
from cwcli.events.search import FoundEvent, find_events_in_log, parse_query
from cwcli.logs.read.reader import Log
from cwcli.logs.write.writer import LogWriter

T0_NS = 1_700_000_000_000_000_000
STEP_S = 0.1
SAMPLE = Path(__file__).parents[3] / "sample_logs" / "intersection.mcap"


@pytest.fixture(scope="module")
def ramp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten seconds at 10 Hz: the ego's speed is 0 to 9.9 m/s, a topic counts from 100 down."""
    path = tmp_path_factory.mktemp("ramp") / "ramp.mcap"
    stamp_ns = T0_NS + (np.arange(100) * STEP_S * 1e9).astype(np.int64)
    state = np.zeros((100, 8))
    state[:, 2] = np.arange(100) * STEP_S
    state[:, 0] = np.cumsum(state[:, 2]) * STEP_S
    covariance = np.broadcast_to(np.eye(8), (100, 8, 8))
    with LogWriter(path) as log:
        log.write_columns(
            make_vehicle_state_channel(EGO_STATE, VehicleStates.from_ego_states(stamp_ns, state, covariance), None)
        )
        channel = log.add_channel("/status", "json", log.add_schema("Status", "jsonschema", b"{}"))
        log.write_messages(
            channel, stamp_ns, [json.dumps({"left": 100 - k, "mode": "auto"}).encode() for k in range(100)]
        )
    return path


@pytest.mark.parametrize(
    ("text", "spans"),
    [
        ("ego.speed_mps > 5.05", [(5.1, 9.9)]),
        ("ego.speed_mps > 18.18 km/h", [(5.1, 9.9)]),
        ("2 m/s <= ego.speed_mps < 3.05", [(2.0, 3.0)]),
        ("not ego.speed_mps < 5.05", [(5.1, 9.9)]),
        ("ego.speed_mps < 1.05 or ego.speed_mps > 8.95", [(0.0, 1.0), (9.0, 9.9)]),
        ("ego.speed_mps > 2 and ego.speed_mps < 3.05 for 0.5 s", [(2.1, 3.0)]),
        ("(ego.speed_mps > 2 and ego.speed_mps < 2.35) for 0.5 s", []),
        ("min(ego.speed_mps) over 2 s > 5.05", [(7.1, 9.9)]),
        ("max(ego.speed_mps) over 2 s > 5.05", [(5.1, 9.9)]),
        ("mean(ego.speed_mps) over 2 s > 5.05", [(6.1, 9.9)]),
        ("ego.speed_mps > 5.05 within 1 s after ego.speed_mps < 4.55", [(5.1, 5.5)]),
        ("ego.speed_mps < 4.55 within 1 s before ego.speed_mps > 5.05", [(4.1, 4.5)]),
        ("/status:left < 50", [(5.1, 9.9)]),
        ("/status:left < 50 and ego.speed_mps < 6.05", [(5.1, 6.0)]),
        ("ego.speed_mps > 50 km/h", []),
    ],
)
def test_spans_by_hand(ramp: Path, text: str, spans: list[tuple[float, float]]) -> None:
    with Log.open(ramp) as log:
        found = find_events_in_log(log, parse_query(text)).found
    assert [(each.start_s, each.start_s + each.duration_s) for each in found] == [pytest.approx(each) for each in spans]


def test_value_is_the_extreme_and_severity_its_ratio(ramp: Path) -> None:
    with Log.open(ramp) as log:
        (found,) = find_events_in_log(log, parse_query("ego.speed_mps > 4.95")).found
    assert found.moment.value == pytest.approx(9.9, abs=0.001)
    assert found.moment.severity == pytest.approx(2.0, abs=0.001)


BRAKE = Moment(T0_NS + 4_000_000_000, T0_NS + 6_000_000_000, ("ego",), 11.76, 3.0)
NEAR_MISS = Moment(T0_NS + 5_000_000_000, T0_NS + 7_000_000_000, ("ego", "leader"), 0.75, 2.0)


@pytest.mark.parametrize(
    ("text", "names", "shown"),
    [
        ("(hard-brake and ego.speed_mps > 30) or near-miss", ["near-miss"], ("least_ttc_or_pet_s", 0.75, 2.0)),
        (
            "(hard-brake and ego.speed_mps > 5.55) or near-miss",
            ["ego.speed", "hard-brake", "near-miss"],
            ("peak_deceleration_mps2", 11.76, 3.0),
        ),
        ("(hard-brake or near-miss) and ego.speed_mps > 6.55", ["ego.speed", "near-miss"], ("least_", 0.75, 2.0)),
        (
            "ego.speed_mps > 7.05 within 1.5 s after ((hard-brake and ego.speed_mps > 30) or near-miss)",
            ["ego.speed", "near-miss"],
            ("least_ttc_or_pet_s", 0.75, 2.0),
        ),
        (
            "ego.speed_mps > 7.05 within 1.5 s after (hard-brake or near-miss)",
            ["ego.speed", "hard-brake", "near-miss"],
            ("peak_deceleration_mps2", 11.76, 3.0),
        ),
        ("ego.speed_mps > 3.95 and hard-brake", ["ego.speed", "hard-brake"], ("peak_deceleration_mps2", 11.76, 3.0)),
        ("hard-brake or ego.speed_mps > 50", ["hard-brake"], ("peak_deceleration_mps2", 11.76, 3.0)),
        ("ego.speed_mps > 6.6 or ego.speed_mps < -5", ["ego.speed"], ("ego.speed_mps", 9.9, 1.5)),
        ("ego.speed_mps < -5 or ego.speed_mps > 6.6", ["ego.speed"], ("ego.speed_mps", 9.9, 1.5)),
    ],
)
def test_only_what_makes_an_expression_hold_is_named_and_value_and_severity_are_of_one_thing(
    ramp: Path, monkeypatch: pytest.MonkeyPatch, text: str, names: list[str], shown: tuple[str, float, float]
) -> None:
    """The ego brakes from 4 s to 6 s and nearly touches the leader from 5 s to 7 s; its speed is the time."""
    events = {
        name: SimpleNamespace(find=lambda evidence, moment=moment: [moment], value_name=EVENTS[name].value_name)
        for name, moment in (("hard-brake", BRAKE), ("near-miss", NEAR_MISS))
    }
    monkeypatch.setattr(search, "EVENTS", events)
    with Log.open(ramp) as log:
        (found,) = find_events_in_log(log, parse_query(text)).found
    assert [name for name in ("ego.speed", "hard-brake", "near-miss") if name in found.words] == names
    assert ("leader" in found.moment.actors) == ("near-miss" in names)
    assert found.value_name.startswith(shown[0])
    assert (found.moment.value, found.moment.severity) == pytest.approx(shown[1:], abs=0.001)


@pytest.mark.parametrize(
    ("value", "threshold", "critical", "severity"),
    [(-6.0, -3.0, "low", 2.0), (-3.0, -3.0, "low", 1.0), (-1.5, -3.0, "high", 2.0), (0.75, 1.5, "low", 2.0)],
)
def test_severity_is_a_ratio_of_magnitudes(
    value: float, threshold: float, critical: Literal["low", "high"], severity: float
) -> None:
    assert severity_as_ratio_to_threshold(value, threshold, critical) == pytest.approx(severity, rel=1e-12)


def test_equal_severities_are_sorted_by_kind_then_by_value() -> None:
    found = [
        FoundEvent("0", log, event, Moment(0, 1, ("ego",), value, 10.0), 0.0, value_name)
        for log, event, value, value_name in (
            ("c", "near-miss", 0.0, "least_ttc_or_pet_s"),
            ("b", "near-miss", 0.1, "least_ttc_or_pet_s"),
            ("d", "hard-brake", 9.0, "peak_deceleration_mps2"),
            ("a", "hard-brake", 8.0, "peak_deceleration_mps2"),
            ("a", "hard-brake", np.nan, "peak_deceleration_mps2"),
            ("a", "expression", 5.0, "speed_mps"),
        )
    ]
    shuffled = [found[k] for k in (3, 5, 1, 4, 2, 0)]
    assert sorted(shuffled, key=lambda each: each.rank) == found


def test_value_on_the_other_side_of_zero_than_its_limit_has_no_ratio(ramp: Path) -> None:
    with Log.open(ramp) as log:
        (found,) = find_events_in_log(log, parse_query("ego.speed_mps > -4.95")).found
    assert found.moment.severity == 1.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("cutin", "did you mean cut-in?"),
        ("ego.speed_kmh > 3", "did you mean ego.speed_mps?"),
        ("tttc_s < 1", "did you mean ttc_s"),
        ("median(ttc_s) over 3 s < 1", "mean"),
        ("ttc_s < 3 m", "ttc_s in s can't be compared with a number in m"),
        ("ego.speed_mps > 30 deg", "ego.speed_mps in m/s can't be compared with a number in rad"),
        ("ego.speed_mps > ttc_s", "ego.speed_mps in m/s can't be compared with ttc_s in s"),
        ("min(ttc_s) < 3", "expected `over` and a time"),
        ("cut-in for 0 s", "expected a time above 0 s"),
        ("cut-in for -3 s", "expected a time above 0 s"),
        ("cut-in for 2 h", "expected a unit behind the time"),
        ("cut-in for 3 m", "expected a time such as 3 s"),
        ("cut-in for 3", "expected a unit behind the time"),
        ("min(ttc_s) over 5000 s < 1", "up to 3600 s"),
        ("cut-in within 2 s cut-out", "expected `after`, `before` or `of`"),
        ("(cut-in", "expected `)`"),
        ("3 < 4", "compares numbers only"),
        ("speed > 3", "did you mean ego.speed_mps or other.speed_mps?"),
        ("ego.speed_mps = 3", "expected one of <= >= == != < > at character 15, found `= 3`"),
        ("ego.speed_mps > 3 furlong", "there is no unit furlong"),
        ("/status > 3", "expected a field of the topic, as in /topic:field at character 1, found `/status > 3`"),
        ("all or cut-in", "`all` stands alone"),
        ("", "it ends"),
        ("ego.speed_mps > 1e999", "a number that a computer can hold"),
        ("__import__('os')", "found `__import__"),
        ("(" * 60 + "cut-in" + ")" * 60, "parentheses inside each other"),
        ("cut-in or " * 400 + "cut-in", "longer than"),
    ],
)
def test_nonsense_is_refused(text: str, words: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_query(text)
    assert words in f"{caught.value} {caught.value.hint}"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("/gps/fix:latitude > 3 km/h", "/gps/fix:latitude in deg can't be compared with a number in m/s"),
        ("3 m < /gps/fix:latitude", "a number in m can't be compared with /gps/fix:latitude in deg"),
        ("/gps/fix:latitude < 49 deg", "a number without a unit is in that of the field"),
        ("/imu/data:linear_acceleration.x > 1 rad", "in m/s^2 can't be compared with a number in rad"),
        ("/gps/fix:altitude > /gps/fix:latitude", "altitude in m can't be compared with /gps/fix:latitude in deg"),
    ],
)
def test_units_that_messages_define_are_compared(text: str, words: str) -> None:
    with Log.open(SAMPLE) as log, pytest.raises(UsageError) as caught:
        find_events_in_log(log, parse_query(text))
    assert words in f"{caught.value} {caught.value.hint}"


def test_units_that_fit_a_message_are_taken() -> None:
    with Log.open(SAMPLE) as log:
        for text in ("/gps/fix:altitude > -9 km", "/gps/fix:latitude > 1", "/imu/data:linear_acceleration.x < 9 g"):
            assert len(find_events_in_log(log, parse_query(text)).found) == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("/stats:left > 1", "did you mean /status?"),
        ("/status:lef > 1", "did you mean left?"),
        ("/status:mode > 1", "mode of /status holds no numbers"),
        ("lane-departure", "run `cwcli lanes`"),
        ("warning", "run `cwcli warn`"),
    ],
)
def test_what_the_log_lacks_is_named(ramp: Path, text: str, words: str) -> None:
    with Log.open(ramp) as log, pytest.raises(MissingSignalError) as caught:
        find_events_in_log(log, parse_query(text))
    assert words in f"{caught.value} {caught.value.hint}"


@pytest.mark.parametrize("function", ["min", "max", "mean"])
def test_windows_equal_the_plain_ones(function: str) -> None:
    rng = np.random.default_rng(4)
    times_ns = np.cumsum(rng.integers(1, 300_000_000, 300))
    values = np.where(rng.random(300) < 0.2, np.nan, rng.normal(size=300))
    plain: Any = {"min": np.min, "max": np.max, "mean": np.mean}[function]
    expected = []
    for k, now in enumerate(times_ns):
        inside = values[: k + 1][times_ns[: k + 1] >= now - 2_000_000_000]
        known = inside[np.isfinite(inside)]
        expected.append(plain(known) if len(known) else np.nan)
    np.testing.assert_allclose(trailing_window_values(values, times_ns, function, 2.0), expected, rtol=1e-9, atol=1e-12)


def test_only_the_topics_that_are_asked_for_are_read(ramp: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: set[str] = set()
    load = Log.load_topics

    def noting(self: Log, wanted: dict[str, object], **settings: object) -> object:
        asked.update(wanted)
        return load(self, wanted, **settings)  # type: ignore[arg-type]

    monkeypatch.setattr(Log, "load_topics", noting)
    with Log.open(ramp) as log:
        find_events_in_log(log, parse_query("/status:left < 50"))
    assert asked == {"/status"}
