"""The remote vehicles' states, each vehicle estimated for itself, as the channels of a stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cwcli.channels.collected_states import CollectedStates
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.from_signals import remote_station_to_measurements
from cwcli.estimation.online_availability import not_overtaken_message_mask
from cwcli.estimation.result import TrackSummary
from cwcli.estimation.summary import summarise_track
from cwcli.estimation.track import estimate_hindsight_and_online, map_in_threads
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.columns import Int64Array
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.row_order import iter_rows_by_id


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
        heard = own[is_fresh[own]]
        fewer = None
        if len(heard) < len(own):
            fewer = remote_station_to_measurements(signal, heard, local_map, config.senders), signal.stamp_ns[heard]
        said = remote_station_to_measurements(signal, own, local_map, config.senders)
        track, known = estimate_hindsight_and_online(
            said, config, signal.stamp_ns[own], blind=estimator.takes_no_online_parameter_from_log, online_input=fewer
        )
        hindsight.add_track(own, track)
        online.add_track(heard, known)
        return summarise_track(track)

    hindsight, online = CollectedStates(signal, np.ones_like(is_fresh)), CollectedStates(signal, is_fresh)
    told = map_in_threads(estimate_station, [own for _, own in stations])
    tracks = {station: track for (station, _), track in zip(stations, told, strict=True)}
    return RemoteStates(
        hindsight.to_vehicle_states(), online.to_vehicle_states(), tracks, int(np.count_nonzero(~is_fresh))
    )
