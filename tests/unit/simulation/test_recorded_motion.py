"""Recorded vehicles as actors: on their states, between them, and off the road before and after."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.signals.vehicle_state import HEADING, SPEED, X, Y
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import parse_scenario
from tests.studies.recorded_motion import RecordedMotion, RecordedTrack, replace_vehicles

ATOL_M = 1e-4


def circle_track(speed_mps: float = 10.0, radius_m: float = 50.0) -> RecordedTrack:
    """Ten seconds on a circle, a state each 0.1 s, across the cut of the heading at 180 degrees."""
    time_s = np.arange(0.0, 10.05, 0.1)
    turned = 2.5 + speed_mps / radius_m * time_s
    state = np.zeros((len(time_s), 8))
    state[:, X], state[:, Y] = radius_m * np.sin(turned), -radius_m * np.cos(turned)
    state[:, SPEED], state[:, HEADING] = speed_mps, np.angle(np.exp(1j * turned))
    return RecordedTrack(time_s, state, 4.5, 1.8)


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
