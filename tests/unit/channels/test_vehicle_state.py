"""What may be published as a state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from cwcli.channels.published import EGO_STATE
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import N_STATES

STAMP_NS = np.array([10, 11, 12]) * NS_PER_S


def states(covariance: np.ndarray) -> VehicleStates:
    return VehicleStates.from_ego_states(STAMP_NS, np.zeros((3, N_STATES)), covariance)


@pytest.mark.parametrize(
    "wrong",
    [
        np.diag([1.0, 1, 1, 1, 1, 1, 1, -1e-9]),
        np.diag([1.0, 1, 1, 1, 1, 1, 1, 0]),
        np.eye(N_STATES) + np.eye(N_STATES, k=1) * 1.2 + np.eye(N_STATES, k=-1) * 1.2,  # correlated by more than 1
        np.full((N_STATES, N_STATES), np.nan),
        np.diag([np.inf, 1, 1, 1, 1, 1, 1, 1]),
    ],
    ids=["negative", "zero", "correlated by more than 1", "not a number", "infinite"],
)
def test_covariance_that_is_not_positive_definite_is_a_bug_in_words(wrong: np.ndarray) -> None:
    covariance = np.tile(np.eye(N_STATES), (3, 1, 1))
    covariance[1] = wrong
    told = "/cwcli/ego/state: 1 of 3 covariances are not positive definite, the first that of ego at 11.000 s"
    with pytest.raises(ArithmeticError, match=told):
        make_vehicle_state_channel(EGO_STATE, states(covariance), None)


def test_covariance_that_is_not_known_is_not_checked() -> None:
    channel = make_vehicle_state_channel(
        EGO_STATE, VehicleStates.from_ego_states(STAMP_NS, np.zeros((3, N_STATES))), None, has_covariance=False
    )
    fields: Mapping[str, Any] = channel.fields
    assert np.isnan(fields["sigma"]).all() and np.isnan(fields["correlation"]).all()


def test_rows_of_an_unknown_covariance_take_no_memory() -> None:
    unknown = VehicleStates.from_ego_states(STAMP_NS, np.zeros((3, N_STATES)))
    rows = unknown.select_rows(np.array([2, 0])).covariance
    assert rows.shape == (2, N_STATES, N_STATES)
    assert isinstance(rows, np.ndarray)
    assert rows.strides[0] == 0
    assert np.isnan(rows).all()
    assert len(unknown.select_rows(np.zeros(0, np.intp)).covariance) == 0
