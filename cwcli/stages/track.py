"""Stage `track`: detections of lidars and radars in, targets out (xiang2019)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from cwcli.channels.binding import bind
from cwcli.channels.published import EGO_STATE
from cwcli.channels.target import write_targets
from cwcli.channels.vehicle_state import read_states
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.records import map_of, run_records
from cwcli.pipeline.result import InputCount, StageResult, Summary
from cwcli.pipeline.run_record import run_record
from cwcli.signals.canonical import DetectionSignal, Signal
from cwcli.signals.columns import Int64Array
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.role import Role
from cwcli.stages.inputs.sources import SourceConfig, read_sources
from cwcli.stages.summaries.track import detection_counts, sections, track_tables
from cwcli.tracking.config import FilterConfig, TrackerConfig
from cwcli.tracking.detections import EgoStates
from cwcli.tracking.from_signals import (
    check_carriers,
    detections_of,
    scan_times,
    sensor_models,
)
from cwcli.tracking.sensor_setting import SensorSetting, parse_sensors
from cwcli.tracking.tracker import Targets, TrackResult, track_targets

EXAMPLES = (
    "cwcli track drive.mcap -o tracked.mcap --filter ukf --metrics tracks.parquet",
    "cwcli track drive.mcap --filter ekf --causal",
    "cwcli track drive.mcap --sensor /radar/scan:x=3.6,y=-0.4,yaw_deg=-30",
)


@dataclass(frozen=True)
class TrackConfig:
    """Settings of the stage.

    Attributes:
        sources: Which channels are read, and how.
        tracker: Filter and tracker.
        targets: `one`: every detection is of one target, or an outlier. `many`: births, deaths, clutter. `auto`: one
            where no scan holds two detections and a single track takes nine in ten of them, else many.
        sensors: Topic -> what the user says of the sensor.
    """

    sources: SourceConfig = field(default_factory=SourceConfig)
    tracker: TrackerConfig = field(default_factory=lambda: TrackerConfig(FilterConfig(tune=True)))
    targets: Annotated[
        Targets,
        Option(
            "--targets",
            "auto: one target where no scan holds two detections and one track takes nine in ten, else many.",
        ),
    ] = "auto"
    sensors: Annotated[
        Mapping[str, SensorSetting],
        Option(
            "--sensor",
            "Mounting and noise of a sensor: x, y (m), yaw_deg, axes (body, paper), carrier (body, map), frame, "
            "sigma (one value, or one per measured value with / between), range_m, fov_deg, detection (probability), "
            "rate (away, toward, off). Repeatable.",
            metavar="TOPIC:KEY=VALUE,..",
            kind=list[str],
            parse=parse_sensors,
        ),
    ] = field(default_factory=dict)


@dataclass(frozen=True)
class Made:
    """What is compared with the truth.

    Attributes:
        result: The tracks.
        truths: Signals of the targets' truth, () without one.
        moments_ns: Stamps at which they are compared.
        in_map: The tracks' frame is the map.
        local_map: Where the map lies on the earth, if that is known.
        n_notes: How many notes of the summary are about the sensors: those about the truth follow them.
    """

    result: TrackResult
    truths: tuple[Signal, ...]
    moments_ns: Int64Array
    in_map: bool
    local_map: LocalMap | None
    n_notes: int


def track(log: Log, config: TrackConfig) -> StageResult:
    """Track other road users from the detections of lidars and radars.

    Needs a channel of detections; every such channel is a sensor. With the states of `cwcli estimate` in the log,
    targets are in the map and the car's own motion is taken out; without them, in the frame of the car (or of sensors
    that report in the map). Where the log has their truth, errors are shown.

    Raises:
        MissingSignalError: No channel holds detections, or the ego state is needed and missing.
        UsageError: An override or a sensor setting that does not fit the log.
        DataError: No message of any sensor can be used.
    """
    sources = read_sources(
        log, config.sources, command="track", required=(Role.DETECTIONS,), optional=(Role.TARGET_TRUTH,)
    )
    signals = [s for s in sources.by_role[Role.DETECTIONS] if isinstance(s, DetectionSignal)]
    ego, ego_count = _ego(log, config.sources)
    models, notes = sensor_models(signals, config.sensors)
    in_map = check_carriers(models, has_ego=ego is not None, where=log.name)
    detections = [detections_of(s, config.sensors.get(s.source, SensorSetting())) for s in signals]
    result, how = track_targets(config.targets, detections, models, config.tracker, ego)
    known_ns = scan_times(signals)
    n_of_sensors = len(sources.notes) + len(notes)
    kinds = {d.source: d.kind for d in detections}
    notes.extend(_notes(result, signals, how, config))
    summary = Summary(
        title="track",
        sections=sections(result, kinds, in_map=in_map),
        inputs=(*sources.counts(), *ego_count, *detection_counts(result.counts)),
        notes=(*sources.notes, *notes),
    )
    return StageResult(
        stage="track",
        channels=write_targets(result, in_map=in_map, known_ns=known_ns),
        tables=track_tables(result, config.tracker.single, kinds),
        summary=summary,
        metadata=run_record(
            "track",
            log,
            config,
            summary,
            targets=how,
            frame="map" if in_map else "base_link",
        ),
        made=Made(
            result=result,
            truths=sources.by_role.get(Role.TARGET_TRUTH, ()),
            moments_ns=known_ns[0] if how == "many" else np.unique(np.concatenate([d.stamp_ns for d in detections])),
            in_map=in_map,
            local_map=map_of(run_records(log).get("estimate", {})) if ego is not None else None,
            n_notes=n_of_sensors,
        ),
    )


def _ego(log: Log, config: SourceConfig) -> tuple[EgoStates | None, tuple[InputCount, ...]]:
    """The car's states, if an earlier `cwcli estimate` has left them in the log."""
    bound = bind(log.channels, config.topics, required=(), optional=(EGO_STATE.role,), where=log.name)
    topic = bound.topic(EGO_STATE.role)
    if topic is None:
        return None, ()
    states = read_states(log.columns(topic))
    if not len(states):
        return None, ()
    count = InputCount(topic, EGO_STATE.role, len(states), len(states))
    states = states.by_stamp()
    return EgoStates.of(states.stamp_ns, states.state), (count,)


def _notes(result: TrackResult, signals: Sequence[DetectionSignal], how: str, config: TrackConfig) -> list[str]:
    notes = list(result.notes)
    if config.targets == "auto":
        notes.append(f"tracked as {how} target{'s' if how == 'many' else ''} (--targets one|many says so for itself)")
    kinds = {signal.kind for signal in signals}
    if {"radar", "radar_track"} <= kinds:
        names = [signal.source for signal in signals if signal.kind != "position"]
        notes.append(
            f"{', '.join(names)}: scans and tracks of radars; if they are of one radar, choose one of them with "
            "--topic detections=/a,/b"
        )
    notes.extend(
        f"{source}: the innovations are outside their 95 % bounds"
        for source, check in result.consistency.items()
        if check.dof > 0.0 and not check.is_inside
    )
    if not result.tracks:
        notes.append("no target was found")
    return notes
