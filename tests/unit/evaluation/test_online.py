"""The online states of the ego against the truth, and against hindsight where there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cwcli.channels.published import EGO_ONLINE, EGO_STATE
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.evaluation.evaluate_log import evaluate_log
from cwcli.metrics.pooling import metric_rows_by_name, notes_from_metadata
from cwcli.signals.columns import OutputChannel
from tests.unit.evaluation.small_logs import T0_NS, log_of

N, STEP_NS = 101, 50_000_000


def states(topic: str, *, ahead_m: float = 0.0, delay_s: float = 0.0) -> OutputChannel:
    """East at 10 m/s, known some time after."""
    stamp_ns = T0_NS + STEP_NS * np.arange(N)
    state = np.zeros((N, 8))
    state[:, 0], state[:, 2] = 10.0 * (stamp_ns - T0_NS) / 1e9 + ahead_m, 10.0
    known = VehicleStates.from_ego_states(stamp_ns, state, np.tile(np.eye(8), (N, 1, 1)))
    later = replace(known, log_time_ns=stamp_ns + round(delay_s * 1e9))
    return make_vehicle_state_channel(EGO_STATE._replace(topic=topic), later, None)


@pytest.mark.parametrize("truth", [True, False])
def test_two_views_of_the_ego(tmp_path: Path, truth: bool) -> None:
    channels = [states(EGO_STATE.topic, ahead_m=0.125), states(EGO_ONLINE.topic, ahead_m=0.625, delay_s=0.2)]
    log = log_of(tmp_path / "a.mcap", channels + [states("/truth/ego")] * truth)
    table = evaluate_log(log)
    rows = metric_rows_by_name(table)
    online = rows["ego.online_position_rmse_m"]
    assert online.value == pytest.approx(0.625 if truth else 0.5)
    assert online.states == ("online vs truth" if truth else "online vs hindsight")
    assert rows["ego.online_along_rmse_m"].value == pytest.approx(0.625 if truth else 0.5)
    assert rows["ego.online_speed_rmse_mps"].value == pytest.approx(0.0)
    assert rows["ego.online_delay_mean_s"].value == pytest.approx(0.2)
    assert ("ego.position_rmse_m" in rows) is truth
    if truth:
        hindsight = rows["ego.position_rmse_m"]
        assert hindsight.value == pytest.approx(0.125)
        assert hindsight.states == "hindsight vs truth"
    assert notes_from_metadata(table) == ()


def test_an_online_channel_that_lags_and_a_log_with_one_channel(tmp_path: Path) -> None:
    log = log_of(tmp_path / "a.mcap", [states(EGO_STATE.topic), states(EGO_ONLINE.topic, delay_s=3.0)])
    (note,) = notes_from_metadata(evaluate_log(log))
    assert "/cwcli/ego/online: its states were usually known 3.0 s after their time" in note
    old = metric_rows_by_name(
        evaluate_log(log_of(tmp_path / "b.mcap", [states(EGO_STATE.topic), states("/truth/ego")]))
    )
    assert old["ego.position_rmse_m"].states == "hindsight vs truth"
    assert not any(name.startswith("ego.online_") for name in old)
