"""Recorded vehicles as actors: on their states, between them, and off the road before and after."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cwcli
from cwcli.errors import MissingSignalError, UsageError
from cwcli.logs.read.reader import Log
from cwcli.signals.vehicle_state import HEADING, SPEED, X, Y
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.recorded_actors import RecordedMotion, RecordedTrack, replace_vehicles
from cwcli.simulation.scenario import parse_scenario

ATOL_M = 1e-4


def circle_track(speed_mps: float = 10.0, radius_m: float = 50.0) -> RecordedTrack:
    """Ten seconds on a circle, a state each 0.1 s, across the cut of the heading at 180 degrees."""
    time_s = np.arange(0.0, 10.05, 0.1)
    turned = 2.5 + speed_mps / radius_m * time_s
    state = np.zeros((len(time_s), 8))
    state[:, X], state[:, Y] = radius_m * np.sin(turned), -radius_m * np.cos(turned)
    state[:, SPEED], state[:, HEADING] = speed_mps, np.angle(np.exp(1j * turned))
    return RecordedTrack(time_s, state, 4.5, 1.8)


def read_states(path: Path, topic: str) -> tuple[np.ndarray, ...]:
    """Times, s, places and speeds of the only vehicle of a channel."""
    with Log.open(str(path)) as log:
        columns = log.columns(topic)
    stamp_ns, x_m, y_m, speed_mps = (columns.fields[name] for name in ("stamp_ns", "x_m", "y_m", "speed_mps"))
    return (np.asarray(stamp_ns) / 1e9, np.asarray(x_m), np.asarray(y_m), np.asarray(speed_mps))


def test_positions_between_the_states_are_on_the_circle() -> None:
    """Hermite's cubic errs by R (w dt)^4 / 384 on a circle, less than a micrometre here."""
    at_s = np.linspace(0.0, 10.0, 777)
    found = RecordedMotion(circle_track()).states_at(at_s)
    np.testing.assert_allclose(found[:, X], 50.0 * np.sin(2.5 + 0.2 * at_s), atol=ATOL_M)
    np.testing.assert_allclose(found[:, HEADING], 2.5 + 0.2 * at_s, atol=ATOL_M)


def test_outside_its_states_it_drives_straight_on_and_is_not_present() -> None:
    motion = RecordedMotion(circle_track())
    before = motion.states_at(np.array([-1.0]))[0]
    assert before[X] == pytest.approx(50.0 * np.sin(2.5) - 10.0 * np.cos(2.5), abs=ATOL_M)
    assert motion.is_present_at(np.array([-1.0, 0.0, 10.0, 10.2])).tolist() == [False, True, True, False]


def test_in_a_gap_of_its_states_it_is_not_present() -> None:
    track = circle_track()
    rows = np.r_[0:31, 60:101]  # known until 3 s and from 6 s on
    motion = RecordedMotion(RecordedTrack(track.time_s[rows], track.state[rows], 4.5, 1.8))
    assert motion.is_present_at(np.array([2.95, 3.0, 3.1, 5.9, 6.0, 10.0])).tolist() == [
        True, True, False, False, True, True,
    ]  # fmt: skip


def test_too_many_actors_are_refused() -> None:
    base = parse_scenario({"duration_s": 1, "vehicles": {"host": {"speed_mps": 1}}}, name="base")
    long = RecordedTrack(np.array([0.0, 40_001.0]), np.zeros((2, 8)), 4.5, 1.8)
    with pytest.raises(UsageError, match="2 recorded vehicles for 40001 s are too many"):
        replace_vehicles(base, {"host": long, "a": long}, name="long")


def test_the_vehicles_of_a_log_drive_again_with_other_sensors(tmp_path: Path) -> None:
    """Their states in hindsight are the truth of the new log; a braking lead is smoothed by a few centimetres."""
    first, annotated, again = (tmp_path / name for name in ("first.mcap", "annotated.mcap", "again.mcap"))
    cwcli.simulate("rear-end", first, seed=1)
    cwcli.open(first).run("estimate").save(annotated)
    cwcli.simulate("rear-end", again, values={"sensors.gnss.sigma_m": 5.0}, actors=annotated)
    for topic, state in (("/truth/ego", "/cwcli/ego/state"), ("/simulation/vehicles", "/cwcli/remote/state")):
        recorded, driven = (read_states(path, name) for path, name in ((annotated, state), (again, topic)))
        for k, column in enumerate(recorded[1:], start=1):
            expected = np.interp(driven[0], recorded[0], column)
            np.testing.assert_allclose(driven[k], expected, atol=(0, 0.01, 0.01, 0.02)[k])
    with pytest.raises(MissingSignalError, match="no states of vehicles"):
        cwcli.simulate("rear-end", tmp_path / "no.mcap", actors=first)


def test_an_actor_is_heard_only_while_it_was_recorded_and_the_sensors_are_the_scenario_s() -> None:
    base = parse_scenario(
        {"duration_s": 1, "vehicles": {"host": {"speed_mps": 1}}, "v2x": {"rate_hz": 10}}, name="base"
    )
    host = circle_track()
    part = RecordedTrack(host.time_s[30:61], host.state[30:61], 12.0, 2.5)
    scenario = replace_vehicles(base, {"0badcafe": part, "host": host}, name="again")
    assert scenario.duration_s == pytest.approx(10.0)
    (received,) = simulate_scenario(scenario, 1).v2x.values()
    assert (received.station_id, received.length_m) == ("0badcafe", 12.0)
    sent_s = (received.stamp_ns - scenario.start_ns) / 1e9
    assert sent_s.min() == pytest.approx(3.0)
    assert sent_s.max() == pytest.approx(6.0)


@pytest.mark.parametrize("rows", [slice(0, 1), slice(5, None, -1)], ids=["one state", "times that fall"])
def test_what_is_no_track_is_refused(rows: slice) -> None:
    track = circle_track()
    with pytest.raises(UsageError, match="whose times increase"):
        RecordedMotion(RecordedTrack(track.time_s[rows], track.state[rows], 4.5, 1.8))
