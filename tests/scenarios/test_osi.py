"""Whole runs on OSI traces: made-up worlds whose times to contact are known in closed form, and a simulator's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from osi3.osi_object_pb2 import MovingObject

from cwcli.cli.main import run_command_line
from cwcli.logs.read.reader import Log
from tests.osi_traces import Actor, along, time_to_contact_s, write_trace

TRACES = Path(__file__).parents[2].parent / "shared" / "oracles" / "osi"
SETTLED_NS = 500_000_000
ATOL_TTC_S = 0.05
MOST_TTC_S = 0.1
"""Where a simulator changes a velocity at once, and no message lies at the moment."""


@dataclass(frozen=True)
class World:
    """A trace: the first actor is the host, the second the one whose time to contact is known."""

    actors: tuple[Actor, ...]
    how: dict[str, Any] = field(default_factory=dict)


HOST = Actor(3, along(0.0, 0.0, 0.3, 20.0), size_m=(4.4, 1.9))
LEAD = Actor(8, along(66.86, 20.68, 0.3, 12.0), size_m=(12.0, 2.5))
WALKER = Actor(5, along(60.0, -10.0, pi / 2, 1.3), size_m=(0.5, 0.5), kind=MovingObject.TYPE_PEDESTRIAN, rear_m=None)
PARKED = Actor(1, along(40.0, -9.0, 0.3, 0.0))
WORLDS = {
    "following": World((HOST, LEAD), {"host": 3}),
    "no host, from zero": World((HOST, LEAD, PARKED, WALKER)),
    "unix time": World((HOST, LEAD), {"host": 3, "start_ns": 1_700_000_000_000_000_000, "rate_hz": 20.0}),
    "10 Hz, far away": World((HOST, LEAD), {"host": 3, "rate_hz": 10.0, "at_m": (691_000.0, 5_336_000.0)}),
    "100 Hz, a view": World((HOST, LEAD), {"host": 3, "rate_hz": 100.0, "as_view": True}),
    "oncoming": World((Actor(0, along(0.0, 0.0, 0.0, 15.0)), Actor(1, along(200.0, 0.0, pi, 15.0))), {"host": 0}),
    "braking": World((HOST, Actor(8, along(66.86, 20.68, 0.3, 15.0, -2.0))), {"host": 3, "duration_s": 5.0}),
    "reversing": World((Actor(2, along(0.0, 0.0, 0.0, -3.0)), Actor(6, along(-25.0, 0.0, 0.0, 0.0))), {"host": 2}),
    "many": World((HOST, LEAD, *(Actor(20 + k, along(5.0 * k, 30.0, 0.3, 10.0 + k)) for k in range(12))), {"host": 3}),
}


@pytest.mark.parametrize("name", WORLDS)
def test_run_and_measure_find_the_time_to_contact_of_a_made_up_world(name: str, tmp_path: Path) -> None:
    world = WORLDS[name]
    trace = write_trace(tmp_path / "trace.mcap", world.actors, **world.how)
    out = tmp_path / "out.mcap"
    assert (
        run_command_line(["run", str(trace), "--stage", "estimate,predict,warn,measure", "-o", str(out), "--quiet"])
        == 0
    )
    host, other = world.actors[:2]
    with Log.open(out) as log:
        assert "/cwcli/warnings" in {channel.topic for channel in log.channels}
        columns = log.columns("/cwcli/measures")
        known: Mapping[str, Any] = columns.fields
        ego: Mapping[str, Any] = log.columns("/cwcli/ego/state").fields
    rows = known["other_id"].codes == known["other_id"].values.index(str(other.id))
    t_s = (known["stamp_ns"][rows] - world.how.get("start_ns", 0)) / 1e9
    exact_s = np.array([time_to_contact_s(host, other, t) for t in t_s])
    found_s = known["ttc_s"][rows]
    judged = np.isfinite(exact_s) & (exact_s < 8.0) & (exact_s > 0.0) & (t_s > SETTLED_NS / 1e9)
    assert judged.sum() >= 10
    np.testing.assert_allclose(found_s[judged], exact_s[judged], atol=ATOL_TTC_S)
    assert len(set(known["other_id"].values)) == len(world.actors) - 1
    at_m = world.how.get("at_m", (0.0, 0.0))
    middle = len(ego["stamp_ns"]) // 2
    x_m, y_m, *_ = host.motion((ego["stamp_ns"][middle] - world.how.get("start_ns", 0)) / 1e9)
    np.testing.assert_allclose([ego["x_m"][middle], ego["y_m"][middle]], [x_m + at_m[0], y_m + at_m[1]], atol=0.01)


@pytest.mark.parametrize("name", ["alks_cut-in", "acc-test"])
def test_run_and_warn_work_on_a_simulators_trace(name: str, tmp_path: Path) -> None:
    """The states are those of the trace, and the time to contact is gap over closing speed."""
    trace = TRACES / f"{name}.mcap"
    if not trace.exists():
        pytest.skip(f"no {trace.name} beside the repository")
    out = tmp_path / "out.mcap"
    assert (
        run_command_line(["run", str(trace), "--stage", "estimate,predict,warn,measure", "-o", str(out), "--quiet"])
        == 0
    )
    with Log.open(out) as log:
        traced: Mapping[str, Any] = log.columns("ground_truth").fields
        states: dict[str, Mapping[str, Any]] = {
            topic: log.columns(f"/cwcli/{topic}/state").fields for topic in ("ego", "remote")
        }
        measured: Mapping[str, Any] = log.columns("/cwcli/measures").fields
    stamps = np.nan_to_num(traced["timestamp.seconds"]) * 1e9 + np.nan_to_num(traced["timestamp.nanos"])
    x_m, y_m, v_mps = (
        traced[f"moving_object.base.{leaf}"].values.reshape(-1, 2)
        for leaf in ("position.x", "position.y", "velocity.x")
    )
    for column, (topic, size) in enumerate((("ego", (5.04, 2.0)), ("remote", (5.04, 2.0)))):
        own = states[topic]
        np.testing.assert_allclose(own["x_m"], np.interp(own["stamp_ns"], stamps, x_m[:, column]), atol=0.05)
        np.testing.assert_allclose(own["y_m"], np.interp(own["stamp_ns"], stamps, y_m[:, column]), atol=0.05)
        np.testing.assert_allclose((own["length_m"][0], own["width_m"][0]), size, atol=1e-6)
    with np.errstate(divide="ignore", invalid="ignore"):
        exact_s = (x_m[:, 1] - x_m[:, 0] - 5.04) / (v_mps[:, 0] - v_mps[:, 1])
    exact_s[np.abs(y_m[:, 1] - y_m[:, 0]) > 1.9] = np.nan
    exact_s = np.interp(measured["stamp_ns"], stamps, exact_s)
    judged = (exact_s > 0.0) & (exact_s < 5.0) & np.isfinite(measured["ttc_s"])
    assert judged.sum() >= 15
    errors_s = np.abs(measured["ttc_s"] - exact_s)[judged]
    assert np.quantile(errors_s, 0.9) < ATOL_TTC_S
    assert errors_s.max() < MOST_TTC_S


def test_a_host_that_is_named_by_an_option_sees_the_others(tmp_path: Path) -> None:
    trace = write_trace(tmp_path / "trace.mcap", (HOST, LEAD), host=3)
    out = tmp_path / "out.mcap"
    assert run_command_line(["estimate", str(trace), "--ego-station", "8", "-o", str(out), "--quiet"]) == 0
    with Log.open(out) as log:
        others: Mapping[str, Any] = log.columns("/cwcli/remote/state").fields
    assert others["id"].values == ("3",)
