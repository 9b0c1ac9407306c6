"""Planted events are found, with their start and end; nothing else is found, and nothing in quiet drives.

`python -m tests.studies.planted_events` does the same on 200 drives and ten quiet hours.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.evaluation.system_topics import parse_other_system_options
from cwcli.events import EVENTS
from cwcli.events.lane_change import _running_median
from cwcli.events.search import FoundEvent, find_events_in_log, parse_query
from cwcli.logs.read.columns import load_columns
from cwcli.logs.read.message_reader import MessageReader
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Columns
from tests.laws.planted_drives import PLANTS, RATE_HZ, planted_drive, quiet_drive, smooth_step, write_drive

ATOL_S = 0.3
"""Largest error of a start or an end, s."""
OTHER_SYSTEM = parse_other_system_options(["warning=/adas/fcw:data==true"])
VERDICTS = " or ".join(name for name in EVENTS if name.startswith("warning-"))


def found_in(path: Path, text: str) -> tuple[FoundEvent, ...]:
    with Log.open(path) as log:
        return find_events_in_log(log, parse_query(text), OTHER_SYSTEM).found


@pytest.mark.parametrize("kind", PLANTS)
def test_planted_event_is_found_and_nothing_else(tmp_path: Path, kind: str) -> None:
    drive = planted_drive(kind, seed=3)
    path = write_drive(drive, tmp_path / "drive.mcap", seed=3)
    found = found_in(path, "all") + (found_in(path, VERDICTS) if drive.warnings_s else ())
    for event, (start_s, end_s) in drive.truth.items():
        (hit,) = [each for each in found if each.event == event]
        assert hit.start_s == pytest.approx(start_s, abs=ATOL_S)
        assert hit.start_s + hit.duration_s == pytest.approx(end_s, abs=ATOL_S)
        assert 0.0 < hit.moment.severity <= 10.0
    assert {each.event for each in found} - set(drive.truth) <= drive.implied


@pytest.mark.parametrize(
    "text",
    [
        "near-miss within 2 s after ego.speed_mps > 1",
        "(near-miss and ego.speed_mps > 1)",
        "near-miss and ego.speed_mps > 1 for 0.2 s",
        "near-miss and other.speed_mps > 0.5",
    ],
)
def test_an_expression_has_the_vehicles_the_words_and_the_severity_of_its_event(tmp_path: Path, text: str) -> None:
    path = write_drive(planted_drive("near-miss", seed=3), tmp_path / "drive.mcap", seed=3)
    (event,), (found, *rest) = found_in(path, "near-miss"), found_in(path, text)
    assert rest == []
    assert event.moment.actors == found.moment.actors == ("ego", "leader")
    assert f"near-miss: {event.words}" in found.words
    assert found.moment.severity == event.moment.severity != 1.0


def test_an_expression_names_what_it_comes_after_and_not_what_it_excludes(tmp_path: Path) -> None:
    path = write_drive(planted_drive("near-miss", seed=3), tmp_path / "drive.mcap", seed=3)
    (event,) = found_in(path, "near-miss")
    (after,) = found_in(path, "ego.speed_mps > 1 within 2 s after near-miss")
    assert after.moment.actors == ("ego", "leader")
    assert after.words.endswith(f"; near-miss: {event.words}")
    assert "near-miss" not in found_in(path, "ego.speed_mps > 1 and not near-miss")[0].words


def test_every_event_is_planted_somewhere() -> None:
    assert {event for kind in PLANTS for event in planted_drive(kind, seed=3).truth} == set(EVENTS)


def test_quiet_drive_holds_nothing(tmp_path: Path) -> None:
    for seed in (1, 2):
        path = write_drive(quiet_drive(np.random.default_rng(seed), 120.0), tmp_path / f"{seed}.mcap", seed)
        assert found_in(path, "all") == ()


@pytest.mark.parametrize(("top_mps", "n_events"), [(1.0, 0), (2.0, 1)])
def test_a_standing_car_with_a_noisy_speed_does_not_stop_and_go(tmp_path: Path, top_mps: float, n_events: int) -> None:
    """It stands for 60 s but for two humps of its speed, of 2 s each."""
    drive = planted_drive("stop-and-go", seed=3)
    t = drive.time_s
    humps = [smooth_step(t - at_s) - smooth_step(t - at_s - 1.0) for at_s in (20.0, 30.0)]
    drive.ego = (np.cumsum(top_mps * np.sum(humps, axis=0)) / RATE_HZ, np.zeros(len(t)))
    assert len(found_in(write_drive(drive, tmp_path / "drive.mcap"), "stop-and-go")) == n_events


def test_clip_holds_the_event_with_its_id(tmp_path: Path) -> None:
    from cwcli.fleet.clips import write_clips

    path = write_drive(planted_drive("cut-in", seed=3), tmp_path / "drive.mcap", seed=3)
    (hit,) = found_in(path, "cut-in")
    written = write_clips([hit], {hit.log: str(path)}, tmp_path / "clips", Log.open, margin_s=5.0)
    (again,) = found_in(Path(written[hit.key]), "cut-in")
    assert (again.id, again.moment.start_ns, again.moment.end_ns) == (hit.id, hit.moment.start_ns, hit.moment.end_ns)


def test_an_event_of_the_ego_alone_reads_no_other_vehicle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_drive(planted_drive("hard-brake", seed=3), tmp_path / "drive.mcap", seed=3)
    topics: list[str] = []
    load_topics = Log.load_topics

    def record(log: Log, wanted: object, *arguments: object, **options: object) -> object:
        topics.extend(wanted)  # type: ignore[arg-type]
        return load_topics(log, wanted, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Log, "load_topics", record)
    assert len(found_in(path, "hard-brake")) == 1
    assert topics == ["/cwcli/ego/state"]
    found_in(path, "cut-in")
    assert topics == ["/cwcli/ego/state"] * 2 + ["/cwcli/remote/state"]


def test_states_are_read_in_one_pass_for_all_events(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []

    def load_and_note(reader: MessageReader, channels: dict[str, Any], *more: Any) -> dict[str, Columns]:
        read.append(" ".join(sorted(channels)))
        return load_columns(reader, channels, *more)

    monkeypatch.setattr("cwcli.logs.read.columns.load_columns", load_and_note)
    found_in(write_drive(planted_drive("cut-in", seed=3), tmp_path / "drive.mcap", seed=3), "all")
    assert [each for each in read if "/state" in each] == ["/cwcli/ego/state /cwcli/remote/state"]


@pytest.mark.parametrize("n_rows", [1, 5, 240, 1000])
def test_running_median_is_the_median_of_each_window(n_rows: int) -> None:
    values = np.round(np.random.default_rng(n_rows).normal(size=n_rows), 1)  # with equal ones
    for known in (values, np.where(values > 1.0, np.nan, values)):
        padded = np.pad(known, 120, mode="symmetric")
        expected = [np.median(padded[k : k + 241]) for k in range(n_rows)]
        np.testing.assert_array_equal(_running_median(known, 240), expected)
