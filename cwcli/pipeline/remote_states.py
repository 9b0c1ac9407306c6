"""The remote vehicles' states, each vehicle estimated for itself, as the channels of a stage."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.from_signals import remote_station_to_measurements
from cwcli.estimation.online_availability import not_overtaken_message_mask
from cwcli.estimation.result import Track, TrackSummary
from cwcli.estimation.summary import summarise_track
from cwcli.estimation.track import estimate_hindsight_and_online_tracks, map_in_threads
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.columns import Int64Array
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.packed_covariances import PackedCovariances
from cwcli.signals.row_order import iter_rows_by_id
from cwcli.signals.vehicle_state import N_STATES


@dataclass(frozen=True)
class RemoteStates:
    """The remote vehicles' states, and a summary of each track.

    Attributes:
        hindsight, online: In log-time order.
        tracks: Station -> the summary of its track in hindsight.
        n_overtaken: Number of messages that arrived after a newer one of their station; no online state uses them.
    """

    hindsight: VehicleStates
    online: VehicleStates
    tracks: Mapping[str, TrackSummary]
    n_overtaken: int


def estimate_remote_states(
    signal: RemoteSignal, local_map: LocalMap | None, estimator: EstimatorConfig
) -> RemoteStates:
    """Estimate the states of the remote vehicles, in parallel threads.

    The online states do not use a message that arrives after a newer one of its station.
    """
    stations = list(iter_rows_by_id(signal.station))
    is_fresh = np.ones(len(signal.stamp_ns), np.bool_)
    for _, own in stations:
        is_fresh[own] = not_overtaken_message_mask(signal.stamp_ns[own], signal.log_time_ns[own])
    config = replace(estimator, calibration=None, latency="none", sensor_model="none", compares_sources=False)

    def estimate_station(own: Int64Array) -> TrackSummary:
        fresh_rows = own[is_fresh[own]]
        fewer = None
        if len(fresh_rows) < len(own):
            fewer = (
                remote_station_to_measurements(signal, fresh_rows, local_map, config.senders),
                signal.stamp_ns[fresh_rows],
            )
        said = remote_station_to_measurements(signal, own, local_map, config.senders)
        track, known = estimate_hindsight_and_online_tracks(
            said, config, signal.stamp_ns[own], blind=estimator.takes_no_online_parameter_from_log, online_input=fewer
        )
        hindsight.store_states_of_track(own, track)
        online.store_states_of_track(fresh_rows, known)
        return summarise_track(track)

    hindsight, online = _CollectedStates(signal, np.ones_like(is_fresh)), _CollectedStates(signal, is_fresh)
    tracks_of_stations = map_in_threads(estimate_station, [own for _, own in stations])
    tracks = {station: track for (station, _), track in zip(stations, tracks_of_stations, strict=True)}
    return RemoteStates(
        hindsight.to_vehicle_states(), online.to_vehicle_states(), tracks, int(np.count_nonzero(~is_fresh))
    )


class _CollectedStates:
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

    def store_states_of_track(self, rows: Int64Array, track: Track) -> None:
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
