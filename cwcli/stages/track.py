"""Stage `track`: detections of lidars and radars in, targets out (xiang2019)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Annotated

import numpy as np

from cwcli.channels.binding import bind_roles
from cwcli.channels.published import EGO_STATE, TARGETS_ONLINE
from cwcli.channels.target import make_target_channels
from cwcli.channels.vehicle_state import VehicleStates, read_vehicle_states
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.json_names import CellWithValues
from cwcli.pipeline.records import local_map_from_estimate_record, read_run_records
from cwcli.pipeline.result import Cell, InputMessageCount, StageResult, StageSummary, SummaryTable
from cwcli.pipeline.run_record import build_run_record
from cwcli.pipeline.states import States, choose_state_topics
from cwcli.signals.canonical import DetectionSignal, Signal
from cwcli.signals.columns import Int64Array, sort_distinct_values
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.role import Role
from cwcli.signals.units import S_PER_NS
from cwcli.stages.inputs.sources import SourceConfig, read_sensor_signals
from cwcli.stages.summaries import NIS_CELL_BY_IS_WITHIN_BOUNDS, cell_of_low_and_high_bound
from cwcli.tracking.association import default_clutter_density
from cwcli.tracking.config import FilterConfig, TrackerConfig
from cwcli.tracking.detections import DetectionCounts, DetectionKind, EgoStates, SensorModel
from cwcli.tracking.from_signals import (
    build_sensor_models,
    detections_from_signal,
    require_common_frame_and_tell_if_map,
    scan_stamps_and_knowable_times_ns,
    scan_stamps_and_log_times_ns,
)
from cwcli.tracking.sensor_setting import SensorSetting, parse_sensor_settings
from cwcli.tracking.single_target import NisConsistency
from cwcli.tracking.tables import (
    DETECTION_VALUE_NAMES_AND_UNITS,
    median_position_sigma_m,
    process_noise_density,
    process_noise_unit,
    track_metric_tables,
    turn_noise_density,
)
from cwcli.tracking.tracker import TargetCountChoice, TrackResult, track_targets_and_name_method, track_targets_online

EXAMPLES = (
    "cwcli track drive.mcap -o tracked.mcap --filter ukf --metrics tracks.parquet",
    "cwcli track drive.mcap --filter ekf --causal",
    "cwcli track drive.mcap --sensor /radar/scan:x=3.6,y=-0.4,yaw_deg=-30",
)
"""Command lines that the help of `cwcli track` shows."""
UNASSIGNED_DETECTION_REASONS = ("outside the gate", "belongs to no confirmed track")
"""Reasons that lie in the scene and not in the data: they are no faults."""
MAX_TARGETS_IN_TABLE = 20
"""Greatest number of targets that the table of the summary shows; chosen by hand."""


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
        TargetCountChoice,
        Option(
            "--targets",
            "auto: one target if no scan holds two detections and one track fits nine in ten of them, else many.",
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
            parse=parse_sensor_settings,
        ),
    ] = field(default_factory=dict)


@dataclass(frozen=True)
class TrackingEvidence:
    """Values that the evaluation of the stage needs.

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
    sources = read_sensor_signals(
        log, config.sources, command="track", required=(Role.DETECTIONS,), optional=(Role.TARGET_TRUTH,)
    )
    signals = [s for s in sources.by_role[Role.DETECTIONS] if isinstance(s, DetectionSignal)]
    single = config.tracker.single
    ego, ego_count = _read_ego_states(log, config.sources, "hindsight" if single.smooth else "online")
    models, notes = build_sensor_models(signals, config.sensors)
    in_map = require_common_frame_and_tell_if_map(models, has_ego=ego is not None, where=log.name)
    detections = [detections_from_signal(s, config.sensors.get(s.source, SensorSetting())) for s in signals]
    if not single.tune:
        models = {d.source: _replace_clutter_density(models[d.source], d.kind) for d in detections}
    result, how = track_targets_and_name_method(
        config.targets, detections, models, config.tracker, _ego_motion_of_states(ego)
    )
    known_ns = scan_stamps_and_log_times_ns(signals)
    car, _ = _read_ego_states(log, config.sources, "online")
    online = result
    if single.smooth:
        online = track_targets_online(result, how, detections, models, config.tracker, _ego_motion_of_states(car))
    knowable_ns = scan_stamps_and_knowable_times_ns(signals, None if car is None else (car.stamp_ns, car.log_time_ns))
    n_of_sensors = len(sources.notes) + len(notes)
    kinds = {d.source: d.kind for d in detections}
    notes.extend(_build_notes(result, signals, how, config))
    summary = StageSummary(
        title="track",
        sections=_summary_tables(result, kinds, in_map=in_map),
        inputs=(*sources.input_message_counts(), *ego_count, *_count_detections_by_sensor(result.counts)),
        notes=(*sources.notes, *notes),
    )
    return StageResult(
        stage="track",
        channels=(
            *make_target_channels(result, in_map=in_map, known_ns=known_ns),
            *make_target_channels(online, in_map=in_map, known_ns=knowable_ns, channel=TARGETS_ONLINE),
        ),
        tables=track_metric_tables(result, config.tracker.single, kinds),
        summary=summary,
        metadata=build_run_record(
            "track",
            log,
            config,
            summary,
            targets=how,
            frame="map" if in_map else "base_link",
        ),
        evaluation_inputs=TrackingEvidence(
            result=result,
            truths=sources.by_role.get(Role.TARGET_TRUTH, ()),
            moments_ns=known_ns[0]
            if how == "many"
            else sort_distinct_values(np.concatenate([d.stamp_ns for d in detections])),
            in_map=in_map,
            local_map=local_map_from_estimate_record(read_run_records(log).get("estimate", {}))
            if ego is not None
            else None,
            n_notes=n_of_sensors,
        ),
    )


def _replace_clutter_density(model: SensorModel, kind: DetectionKind) -> SensorModel:
    """Return the model with the default clutter density, instead of one estimated from the log, if none is set."""
    return (
        model
        if model.clutter_density is not None
        else replace(model, clutter_density=default_clutter_density(kind, model))
    )


def _ego_motion_of_states(states: VehicleStates | None) -> EgoStates | None:
    """Return the ego's motion for the tracker; None without states."""
    return None if states is None else EgoStates.from_states(states.stamp_ns, states.state)


def _read_ego_states(
    log: Log, config: SourceConfig, which: States
) -> tuple[VehicleStates | None, tuple[InputMessageCount, ...]]:
    """Read the ego's states by stamp and their counts; None and () if the log holds none."""
    chosen = choose_state_topics(config.topics, which, log.channels, (EGO_STATE.role,))
    bound = bind_roles(log.channels, chosen, required=(), optional=(EGO_STATE.role,), where=log.name)
    topic = bound.first_topic_of_role(EGO_STATE.role)
    if topic is None:
        return None, ()
    states = read_vehicle_states(log.columns(topic))
    if not len(states):
        return None, ()
    count = InputMessageCount(topic, EGO_STATE.role, len(states), len(states))
    return states.sort_by_stamp_without_repeats(), (count,)


def _build_notes(result: TrackResult, signals: Sequence[DetectionSignal], mode: str, config: TrackConfig) -> list[str]:
    """Return the notes on the tracker's choice, the sensors and the innovations."""
    notes = list(result.notes)
    if config.targets == "auto":
        notes.append(f"tracked as {mode} target{'s' if mode == 'many' else ''} (--targets one|many sets it)")
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
        if check.dof > 0.0 and not check.is_within_bounds
    )
    if not result.tracks:
        notes.append("no target was found")
    return notes


def _count_detections_by_sensor(counts: Mapping[str, DetectionCounts]) -> tuple[InputMessageCount, ...]:
    """Count the detections of each sensor; one that fits no track counts as used, because it was considered."""
    found = []
    for source, count in counts.items():
        faults = {reason: n for reason, n in count.rejected.items() if reason not in UNASSIGNED_DETECTION_REASONS}
        used = count.read - sum(faults.values())
        found.append(InputMessageCount(source, "each detection", count.read, used, faults, dict(count.repaired)))
    return tuple(found)


def _summary_tables(
    result: TrackResult, kinds: Mapping[str, DetectionKind], *, in_map: bool
) -> tuple[SummaryTable, ...]:
    """Return the stage's tables for the terminal, without empty ones."""
    found = [_sensors_table(result), _tuned_noise_table(result, kinds), _targets_table(result, in_map)]
    return tuple(item for item in found if item.rows)


def _sensors_table(result: TrackResult) -> SummaryTable:
    """Return the table of the sensors: what became of their detections, and the innovations."""
    rows: list[tuple[Cell, ...]] = []
    for source, count in result.counts.items():
        check = result.consistency.get(source)
        free = sum(count.rejected.get(reason, 0) for reason in UNASSIGNED_DETECTION_REASONS)
        faulty = count.read - count.used - free
        rows.append((source, count.read, count.used, free, faulty, *_nis_cells(check)))
    columns = (
        "sensor",
        "detections",
        "detections used",
        "detections of no track",
        "faulty detections",
        "mean NIS/dof",
        "95 % bounds of NIS/dof",
        "NIS/dof within bounds",
    )
    names = (*columns[:2], "used", "no track", "faulty", "NIS/dof", "bounds_95", "inside")
    title = (
        "Detections of each sensor, and how far they scatter about the tracks (NIS, normalised innovation squared, per "
        "degree of freedom (dof): about 1 if the noise is right)"
    )
    return SummaryTable("sensors", title, columns, tuple(rows), names=names)


def _nis_cells(check: NisConsistency | None) -> tuple[Cell, ...]:
    """Return the cells for the normalised innovation squared, its bounds and whether it lies within them."""
    if check is None or not check.dof > 0.0:
        return None, cell_of_low_and_high_bound(np.nan, np.nan), NIS_CELL_BY_IS_WITHIN_BOUNDS[None]
    bounds = cell_of_low_and_high_bound(check.low / check.dof, check.high / check.dof)
    return check.nis_mean / check.dof, bounds, NIS_CELL_BY_IS_WITHIN_BOUNDS[check.is_within_bounds]


def _tuned_noise_table(result: TrackResult, kinds: Mapping[str, DetectionKind]) -> SummaryTable:
    """Return the table of the noise found by maximum likelihood; one without rows if none was."""
    if result.tuned is None:
        return SummaryTable("noise", "", (), ())
    rows: list[tuple[Cell, ...]] = [
        (source, CellWithValues(name, {"": name, "unit": None}), factor)
        for source, factors in result.tuned.scale.items()
        for (name, _), factor in zip(DETECTION_VALUE_NAMES_AND_UNITS[kinds[source]], factors, strict=False)
    ]
    tuned = result.tuned.config
    rows.append(
        ("process", _process_noise_cell("acceleration", process_noise_unit(tuned)), process_noise_density(tuned))
    )
    if tuned.motion_model.turn_noise > 0.0:
        rows.append(("process", _process_noise_cell("turn rate", "rad/s^1.5"), turn_noise_density(tuned)))
    names = ("source", "quantity", "found")
    title = "Noise fitted to this log: factor on each given sigma, and noise of the targets' motion (process)"
    return SummaryTable("noise", title, ("source", "quantity", "fitted factor or noise"), tuple(rows), names=names)


def _process_noise_cell(name: str, unit: str) -> CellWithValues:
    return CellWithValues(f"{name} [{unit}]", {"": name, "unit": unit})


def _targets_table(result: TrackResult, in_map: bool) -> SummaryTable:
    """Return the table of the longest tracks, by id."""
    start_ns = min((int(track.stamp_ns[0]) for track in result.tracks), default=0)
    longest = sorted(result.tracks, key=len, reverse=True)[:MAX_TARGETS_IN_TABLE]
    rows: list[tuple[Cell, ...]] = []
    for track in sorted(longest, key=lambda one: one.id):
        speed = np.hypot(track.state[:, 2], track.state[:, 3])
        rows.append(
            (
                str(track.id),
                float(track.stamp_ns[0] - start_ns) * S_PER_NS,
                float(track.stamp_ns[-1] - track.stamp_ns[0]) * S_PER_NS,
                len(track),
                100.0 * float((track.source >= 0).mean()),
                float(speed.max()),
                median_position_sigma_m(track),
            )
        )
    shown = "" if len(longest) == len(result.tracks) else f" (the {len(longest)} longest of {len(result.tracks)})"
    columns = (
        "target",
        "start [s]",
        "duration [s]",
        "states",
        "states with a detection [%]",
        "max speed [m/s]",
        "median position sigma per axis [m]",
    )
    names = ("target", "from [s]", "for [s]", "states", "seen [%]", "max speed [m/s]", "median sigma [m]")
    title = f"Tracked targets in the {'map' if in_map else 'frame of the car'}{shown}; times from the first state"
    return SummaryTable("targets", title, columns, tuple(rows), names=names)
