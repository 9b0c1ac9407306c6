"""Whether a careful driver would have avoided a conflict: a standing car ahead, by the laws of braking."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cwcli.channels.published import EGO_STATE, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.evaluation.actual_outcomes import ActualOutcomes, find_actual_outcomes
from cwcli.evaluation.preventable import add_preventable_share, simulate_careful_driver
from cwcli.metrics.headline import HeadlineCollector
from cwcli.signals.columns import repeat_string
from tests.unit.evaluation.small_logs import T0_NS, log_of

STEP_NS = 50_000_000
CRASH_S = 10.0


def crash(path: Path, speed_mps: float) -> ActualOutcomes:
    """The ego runs into a car that stands in its lane: the centres meet at 10 s, the outlines 4.5 m before."""
    stamp_ns = T0_NS + STEP_NS * np.arange(241)
    time_s = (stamp_ns - T0_NS) / 1e9
    ego, other = np.zeros((2, len(stamp_ns), 8))
    ego[:, 0], ego[:, 2] = speed_mps * (time_s - CRASH_S), speed_mps
    covariance = np.tile(np.eye(8), (len(stamp_ns), 1, 1))
    own, theirs = (VehicleStates.from_ego_states(stamp_ns, state, covariance) for state in (ego, other))
    theirs = replace(theirs, ids=repeat_string("2", len(stamp_ns)))
    log = log_of(
        path / "a.mcap",
        [make_vehicle_state_channel(EGO_STATE, own, None), make_vehicle_state_channel(REMOTE_STATE, theirs, None)],
    )
    real = find_actual_outcomes(log)
    assert real is not None
    return real


@pytest.mark.parametrize(("speed_mps", "avoids"), [(10.0, True), (40.0, False)])
def test_who_brakes_two_seconds_before_stops_from_10_and_not_from_40_metres_a_second(
    tmp_path: Path, speed_mps: float, avoids: bool
) -> None:
    """At a TTC of 2 s the gap is 20 m and 80 m; at 0.774 g the way to a stop is 6.6 m and 105 m."""
    real = crash(tmp_path, speed_mps)
    ((conflict,),) = real.conflicts.values()
    found = simulate_careful_driver(real.pairs["2"], conflict)
    assert found is not None
    touched_s = CRASH_S - 4.5 / speed_mps
    assert (found.contact_ns - T0_NS) / 1e9 == pytest.approx(touched_s, abs=0.051)
    assert found.first_braking_ns is not None
    braked_s = (found.first_braking_ns - T0_NS) / 1e9
    assert touched_s - 2.0 - 0.2 <= braked_s <= touched_s - 1.0  # with what it needs to see and to react
    assert found.outcome.avoided is avoids
    assert (found.outcome.least_gap_m > 0.0) is avoids
    assert np.isfinite(found.outcome.impact_mps) is np.bool_(not avoids)
    headline = HeadlineCollector()
    add_preventable_share(headline, real)
    ((_, name, value, *_),) = headline.rows
    assert (name, value) == ("warnings.preventable_share", float(avoids))


def test_without_conflicts_there_is_nothing_to_prevent(tmp_path: Path) -> None:
    real = crash(tmp_path, 10.0)
    headline = HeadlineCollector()
    add_preventable_share(headline, replace(real, conflicts={"2": []}))
    assert headline.rows == []
