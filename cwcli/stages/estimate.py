"""Stage `estimate`: sensors and V2X messages in, the ego's and the remote vehicles' states out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cwcli.errors import DataError
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.measurements import Measurements
from cwcli.estimation.track import Track, estimate_track, estimate_tracks
from cwcli.logs.log import Log
from cwcli.signals.canonical import CameraInfoSignal, PoseSignal, PositionSignal, RemoteSignal
from cwcli.signals.codec import Role
from cwcli.signals.columns import FloatArray, Int64Array, OutputChannel, Strings
from cwcli.signals.geodesy import LocalMap
from cwcli.stages.channels import (
    EGO_ID,
    EGO_STATE_TOPIC,
    REMOTE_STATE_TOPIC,
    constant_strings,
    vehicle_states,
    viewer_channels,
)
from cwcli.stages.estimate_summary import estimate_tables, gap_notes, sections
from cwcli.stages.measurements import EgoSignal, ego_measurements, remote_measurements
from cwcli.stages.result import StageResult, Summary
from cwcli.stages.run_record import run_record
from cwcli.stages.sources import SourceConfig, Sources, read_sources
from cwcli.stages.states import vehicle_rows
from cwcli.stages.truth import TruthErrors, against_truth

EGO_ROLES = (Role.EGO_POSITION, Role.EGO_VELOCITY, Role.EGO_SPEED, Role.EGO_HEADING, Role.IMU)
MAX_STATES = 20_000_000
NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class EstimateConfig:
    """Settings of the stage.

    Attributes:
        sources: Which channels are read, and how.
        estimator: The filter; remote vehicles run the same one, without a search for latencies, because the
            quantities of one message share its time.
        rate_hz: Rate of `/cwcli/ego/state`. Remote states come at the times of their messages.
        truth_origin: Latitude, longitude (deg) and altitude (m) of a Cartesian truth channel's origin, or None.
    """

    sources: SourceConfig = field(default_factory=SourceConfig)
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
    rate_hz: float = 20.0
    truth_origin: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class RemoteTracks:
    """The remote vehicles' tracks and, for each, the rows of the V2X signal that it was made from."""

    signal: RemoteSignal
    rows: Mapping[str, Int64Array]
    tracks: Mapping[str, Track]


def estimate(log: Log, config: EstimateConfig) -> StageResult:
    """Estimate the states of the ego and of every remote vehicle.

    Raises:
        MissingSignalError: No channel, or more than one, holds the ego position.
        UsageError: An override that does not fit the log.
        DataError: No usable position.
    """
    sources = read_sources(
        log,
        config.sources,
        command="estimate",
        required=(Role.EGO_POSITION,),
        optional=(*EGO_ROLES[1:], Role.REMOTE, Role.TRUTH),
    )
    local_map = _local_map(sources)
    measurements = _ego_measurements(sources, local_map)
    grid_ns = _output_grid(measurements, config.rate_hz)
    ego = estimate_track(measurements, config.estimator, grid_ns)
    remote = _remote_tracks(sources, local_map, config.estimator)
    errors = against_truth(sources.by_role.get(Role.TRUTH, ()), measurements, ego, local_map, config.truth_origin)
    channels = [*_ego_channels(ego, local_map)]
    if remote is not None and local_map is not None:
        channels.append(_remote_channel(remote, local_map))
    summary = _summary(sources, ego, remote, errors, log)
    return StageResult(
        stage="estimate",
        channels=tuple(channels),
        tables=estimate_tables(ego, remote.tracks if remote else {}, errors),
        summary=summary,
        metadata=run_record("estimate", log, config, summary, **_origin_record(local_map)),
    )


def _local_map(sources: Sources) -> LocalMap | None:
    """The map frame: east-north-up at the first valid fix; None where the position is Cartesian from the start."""
    position = sources.by_role[Role.EGO_POSITION][0]
    if not isinstance(position, PositionSignal):
        return None
    altitude_m = float(position.altitude_m[0])
    return LocalMap(
        float(position.latitude_deg[0]),
        float(position.longitude_deg[0]),
        altitude_m if np.isfinite(altitude_m) else 0.0,
    )


def _ego_measurements(sources: Sources, local_map: LocalMap | None) -> list[Measurements]:
    found: list[Measurements] = []
    for role in EGO_ROLES:
        for signal in sources.by_role.get(role, ()):
            assert isinstance(signal, EgoSignal)
            found.extend(ego_measurements(signal, local_map))
    return found


def _output_grid(measurements: list[Measurements], rate_hz: float) -> Int64Array:
    """Stamps of the ego's states: from its first position to its last measurement, at the given rate.

    Raises:
        DataError: The span is so long that a stamp must be wrong.
    """
    first_ns, last_ns = int(measurements[0].stamp_ns[0]), int(measurements[0].stamp_ns[-1])
    last_ns = max(int(m.stamp_ns[-1]) for m in measurements if len(m) and int(m.stamp_ns[0]) <= last_ns)
    step_ns = round(NS_PER_S / rate_hz)
    n = (last_ns - first_ns) // step_ns + 1
    if n > MAX_STATES:
        raise DataError(
            f"the measurements span {(last_ns - first_ns) / NS_PER_S:.0f} s, {n} states at {rate_hz:g} Hz",
            where=measurements[0].source,
            hint="check the stamps with `cwcli info`, use --clock log, or cut with --start and --end",
        )
    return np.asarray(first_ns + step_ns * np.arange(n), dtype=np.int64)


def _remote_tracks(sources: Sources, local_map: LocalMap | None, estimator: EstimatorConfig) -> RemoteTracks | None:
    signals = [s for s in sources.by_role.get(Role.REMOTE, ()) if isinstance(s, RemoteSignal)]
    if not signals or local_map is None:
        return None
    signal = merged(signals)
    rows = {station: np.asarray(own, np.int64) for station, own in vehicle_rows(signal.station)}
    config = EstimatorConfig(
        model=estimator.model,
        causal=estimator.causal,
        latency="none",
        gate_probability=estimator.gate_probability,
        reset_after=estimator.reset_after,
    )
    groups = [(remote_measurements(signal, own, local_map), signal.stamp_ns[own]) for own in rows.values()]
    tracks = estimate_tracks(groups, config)
    return RemoteTracks(signal, rows, dict(zip(rows, tracks, strict=True)))


def merged(signals: list[RemoteSignal]) -> RemoteSignal:
    """Several V2X channels as one signal in stamp order; a station heard on two of them is one vehicle."""
    if len(signals) == 1:
        return signals[0]
    stamp_ns = np.concatenate([s.stamp_ns for s in signals])
    order = np.argsort(stamp_ns, kind="stable")
    names = list(dict.fromkeys(name for s in signals for name in s.station.values))
    codes = np.concatenate(
        [np.array([names.index(name) for name in s.station.values], np.int32)[s.station.codes] for s in signals]
    )
    columns = {
        name: np.concatenate([getattr(s, name) for s in signals])[order]
        for name in RemoteSignal.__dataclass_fields__
        if name not in {"source", "station"}
    }
    source = ", ".join(s.source for s in signals)
    return RemoteSignal(source=source, station=Strings(codes[order], tuple(names)), **columns)


def _ego_channels(ego: Track, local_map: LocalMap | None) -> tuple[OutputChannel, ...]:
    n = len(ego.stamp_ns)
    latitude_deg, longitude_deg = _geographic(ego.state, local_map)
    unknown = np.full(n, np.nan)
    states = vehicle_states(
        EGO_STATE_TOPIC,
        ids=constant_strings(EGO_ID, n),
        stamp_ns=ego.stamp_ns,
        log_time_ns=ego.stamp_ns,
        state=ego.state,
        covariance=ego.covariance,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        length_m=unknown,
        width_m=unknown,
    )
    return (
        states,
        *viewer_channels(
            stamp_ns=ego.stamp_ns,
            state=ego.state,
            covariance=ego.covariance,
            latitude_deg=latitude_deg,
            longitude_deg=longitude_deg,
            altitude_m=local_map.origin_alt_m if local_map else 0.0,
        ),
    )


def _remote_channel(remote: RemoteTracks, local_map: LocalMap) -> OutputChannel:
    rows = np.concatenate(list(remote.rows.values()))
    tracks = list(remote.tracks.values())
    state = np.concatenate([track.state for track in tracks])
    latitude_deg, longitude_deg = _geographic(state, local_map)
    signal = remote.signal
    return vehicle_states(
        REMOTE_STATE_TOPIC,
        ids=Strings(signal.station.codes[rows], signal.station.values),
        stamp_ns=signal.stamp_ns[rows],
        log_time_ns=signal.log_time_ns[rows],
        state=state,
        covariance=np.concatenate([track.covariance for track in tracks]),
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        length_m=signal.length_m[rows],
        width_m=signal.width_m[rows],
    )


def _geographic(state: FloatArray, local_map: LocalMap | None) -> tuple[FloatArray, FloatArray]:
    if local_map is None:
        unknown = np.full(len(state), np.nan)
        return unknown, unknown
    latitude_deg, longitude_deg, _ = local_map.wgs84_from_map(state[:, 0], state[:, 1], np.zeros(len(state)))
    return latitude_deg, longitude_deg


def _summary(
    sources: Sources, ego: Track, remote: RemoteTracks | None, errors: TruthErrors | None, log: Log
) -> Summary:
    signals = [s for found in sources.by_role.values() for s in found if not isinstance(s, CameraInfoSignal)]
    start_ns = min(int(signal.stamp_ns[0]) for signal in signals)
    end_ns = max(int(signal.stamp_ns[-1]) for signal in signals)
    notes = [*sources.notes, *gap_notes(signals, start_ns, end_ns), *ego.notes]
    position = signals[0]
    if isinstance(position, PoseSignal) and Role.REMOTE in sources.by_role:
        notes.append("the ego position is Cartesian: remote vehicles can't be placed beside it and are left out")
    tracks = remote.tracks if remote else {}
    for station, track in tracks.items():
        notes.extend(f"{station}: {note}" for note in track.notes)
    if errors is not None:
        notes.extend(errors.notes)
    return Summary("estimate", sections(ego, tracks, errors), sources.counts(), tuple(dict.fromkeys(notes)))


def _origin_record(local_map: LocalMap | None) -> dict[str, str]:
    if local_map is None:
        return {"map_origin": "cartesian"}
    values = (local_map.origin_lat_deg, local_map.origin_lon_deg, local_map.origin_alt_m)
    names = ("map_origin_latitude_deg", "map_origin_longitude_deg", "map_origin_altitude_m")
    return {name: repr(value) for name, value in zip(names, values, strict=True)}
