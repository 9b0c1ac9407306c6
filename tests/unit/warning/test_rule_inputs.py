"""Measures that a rule asks for by name: of the two states that the host has at the moment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.measures import MEASURES
from cwcli.warning import pair
from cwcli.warning.evaluate import _times_along_predicted_paths_s
from cwcli.warning.measures import Measures
from cwcli.warning.pair import MIN_ROWS_PER_BLOCK, PairEvaluation, evaluate_pairs
from cwcli.warning.rule_inputs import describe_problem_with_measure_names
from cwcli.warning.rules.base import Decision, Rule
from cwcli.warning.types import VehicleTrack, WarningConfig
from tests.unit.warning.vehicles import seconds, straight

OF_A_MOMENT = tuple(name for name, measure in MEASURES.items() if measure.is_pointwise)


def hard(measures: Measures, onset: Measures | None, config: WarningConfig, persistence_s: float) -> Decision:
    """Braking of more than 3.35 m/s^2 is needed."""
    needed = measures.by_name["drac"]
    raised = needed > 3.35
    held = raised | (measures.by_name["gap"] < 1.0)
    return Decision(raised, raised, held, measures.by_name["ttc"], needed)


HARD = Rule(summary="needs hard braking", persistence_s=0.0, decide=hard, measures=("drac", "gap", "ttc"))


def found(host: VehicleTrack, other: VehicleTrack, rule: Rule = HARD, window_rows: int = 512) -> PairEvaluation:
    config = WarningConfig()
    time_s = _times_along_predicted_paths_s(host, config, rule)
    return evaluate_pairs(host, [other], rule, config, time_s, window_rows=window_rows)[0]


def test_a_rule_raises_where_a_measure_that_it_asks_for_says() -> None:
    host = straight("host", speed_mps=20.0, length_m=4.0, duration_s=4.0)
    own = found(host, straight("wall", x_m=104.0, speed_mps=0.0, length_m=4.0, duration_s=4.0))
    # 20^2 / (2 (100 - 20 t)) > 3.35 from a gap of 59.70 m on: 40.30 m after the start, at 2.015 s
    assert seconds(own.stamp_ns[own.decision.raised])[0] == 2.05
    at = seconds(own.stamp_ns).index(2.05)
    assert own.decision.time_to_event_s[at] == pytest.approx(59.0 / 20.0)
    assert own.decision.predicted_distance_m[at] == pytest.approx(400.0 / (2.0 * 59.0))


def test_an_old_state_is_brought_forward_to_the_moment() -> None:
    host = straight("host", speed_mps=20.0, length_m=4.0, duration_s=4.0)
    other = straight("other", x_m=104.0, speed_mps=10.0, length_m=4.0, duration_s=4.0, rate_hz=4.0, delay_s=0.1)
    own = found(host, other)
    assert own.age_s.max() == pytest.approx(0.3)
    time_s = np.array(seconds(own.stamp_ns))
    np.testing.assert_allclose(own.decision.time_to_event_s, (100.0 - 10.0 * time_s) / 10.0, atol=1e-9)


def everything(measures: Measures, onset: Measures | None, config: WarningConfig, persistence_s: float) -> Decision:
    """Raises never; its times add up everything."""
    values = np.array([np.nan_to_num(measures.by_name[name], posinf=1e3) for name in OF_A_MOMENT])
    never = np.zeros(values.shape[1], bool)
    assert onset is None or not onset.by_name
    return Decision(never, never, never, values.sum(axis=0), np.abs(values).max(axis=0))


EVERYTHING = Rule("all", 0.0, everything, measures=OF_A_MOMENT, uses_onset=True)


@pytest.mark.parametrize("rows_per_block", [MIN_ROWS_PER_BLOCK, 16])
def test_windows_change_nothing(monkeypatch: pytest.MonkeyPatch, rows_per_block: int) -> None:
    host = straight("host", speed_mps=12.0, accel_mps2=0.5, duration_s=3.0)
    other = straight("other", x_m=30.0, y_m=-20.0, speed_mps=9.0, heading_rad=1.2, duration_s=3.0, delay_s=0.07)
    other = replace(other, onset_paths=other.paths)
    whole = found(host, other, EVERYTHING)
    monkeypatch.setattr(pair, "MIN_ROWS_PER_BLOCK", rows_per_block)
    parts = found(host, other, EVERYTHING, window_rows=7)
    np.testing.assert_array_equal(whole.stamp_ns, parts.stamp_ns)
    np.testing.assert_array_equal(whole.decision.time_to_event_s, parts.decision.time_to_event_s)
    assert np.ptp(whole.decision.time_to_event_s) > 1.0


def test_nothing_that_came_later_counts() -> None:
    host = straight("host", speed_mps=12.0, duration_s=3.0)
    other = straight("other", x_m=40.0, y_m=1.0, speed_mps=5.0, duration_s=3.0, delay_s=0.12)
    whole = found(host, other, EVERYTHING).decision.time_to_event_s
    state = other.state.copy()
    state[31:] += [5.0, -3.0, 4.0, 0.5, 2.0, 0.1, 1.0, 0.0]  # from 1.55 s on, known from 1.67 s on
    changed = found(host, replace(other, state=state), EVERYTHING).decision.time_to_event_s
    time_s = np.array(seconds(found(host, other).stamp_ns))
    before = time_s < 1.66
    np.testing.assert_array_equal(changed[before], whole[before])
    assert (changed[~before] != whole[~before]).any()


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("ttc", "nothing"), "asks for the measure 'nothing', which does not exist (docs/measures.md lists them)"),
        (("pet",), "asks for the measure 'pet', which needs more than the two states of a moment"),
        (("tet",), "asks for the measure 'tet', which needs more than the two states of a moment"),
        ("ttc", "has measures = 'ttc', which is not a tuple of names"),
        ((1,), "has measures = (1,), which is not a tuple of names"),
        (("ttc", "drac"), ""),
        ((), ""),
    ],
)
def test_what_a_rule_may_ask_for(names: object, said: str) -> None:
    assert describe_problem_with_measure_names(names) == said
