"""States of many vehicles, estimated one after the other, in the order of the channel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.estimation.result import Track
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.columns import Int64Array
from cwcli.signals.packed_covariances import PackedCovariances
from cwcli.signals.vehicle_state import N_STATES


class CollectedStates:
    """States of many vehicles, each put where it belongs in the channel.

    Args:
        signal: What the vehicles said.
        is_used: Which rows of it have a state.
    """

    def __init__(self, signal: RemoteSignal, is_used: npt.NDArray[np.bool_]) -> None:
        order = np.argsort(signal.log_time_ns, kind="stable")
        self._signal, self._order = signal, order[is_used[order]]
        n = len(self._order)
        self._place = np.empty(len(order), np.intp)
        self._place[self._order] = np.arange(n)
        self._state, self._covariance = np.empty((n, N_STATES)), PackedCovariances.empty(n, N_STATES)
        self._flags = np.zeros(n, np.uint8)

    def add(self, rows: Int64Array, track: Track) -> None:
        """The states of some rows of the signal; safe in a thread of its own for each vehicle."""
        at = self._place[rows]
        self._state[at], self._flags[at] = track.state, track.flags
        self._covariance.put(at, PackedCovariances.of(track.covariance))

    def states(self) -> VehicleStates:
        """All of them."""
        signal, order = self._signal, self._order
        return VehicleStates(
            signal.station.rows(order),
            signal.stamp_ns[order],
            signal.log_time_ns[order],
            self._state,
            self._covariance,
            signal.length_m[order],
            signal.width_m[order],
            self._flags,
        )
