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
    """Collects the states of many vehicles into the rows of one channel.

    Args:
        signal: The messages of the vehicles, n rows.
        is_used: Shape (n,): the rows that get a state.
    """

    def __init__(self, signal: RemoteSignal, is_used: npt.NDArray[np.bool_]) -> None:
        order = np.argsort(signal.log_time_ns, kind="stable")
        self._signal, self._order = signal, order[is_used[order]]
        n = len(self._order)
        self._place = np.empty(len(order), np.intp)
        self._place[self._order] = np.arange(n)
        self._state, self._covariance = np.empty((n, N_STATES)), PackedCovariances.allocate_uninitialised(n, N_STATES)
        self._flags = np.zeros(n, np.uint8)

    def add_track(self, rows: Int64Array, track: Track) -> None:
        """Store the states of one vehicle's rows; different vehicles may be added from different threads."""
        at = self._place[rows]
        self._state[at], self._flags[at] = track.state, track.flags
        self._covariance.fill_rows(at, PackedCovariances.from_dense(track.covariance))

    def to_vehicle_states(self) -> VehicleStates:
        """All collected states, in log-time order."""
        signal, order = self._signal, self._order
        return VehicleStates(
            signal.station.select_rows(order),
            signal.stamp_ns[order],
            signal.log_time_ns[order],
            self._state,
            self._covariance,
            signal.length_m[order],
            signal.width_m[order],
            self._flags,
        )
