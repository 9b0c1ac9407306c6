"""One annotated log as what the report shows of it: tracks, raw measurements, warnings, counts. No images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np

from cwcli.channels.lanes import LaneRows, read_lanes
from cwcli.channels.published import EGO_STATE, LANES, REJECTED, REMOTE_STATE, TARGETS, WARNINGS
from cwcli.channels.rejected import read_gated_measurements
from cwcli.channels.target import read_targets_as_states
from cwcli.channels.vehicle_state import KINEMATIC_AND_FLAG_FIELDS, KINEMATIC_FIELDS, VehicleStates, read_vehicle_states
from cwcli.channels.warning import WARNING_FIELDS_FOR_EVENTS, read_warnings
from cwcli.errors import CwcliError, DataError, MissingSignalError
from cwcli.estimation.result import NO_GATED_MEASUREMENTS, GatedMeasurements
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.evaluation.records import (
    find_collision_warning_record_and_is_of_targets,
    source_config_from_record,
    warning_config_from_record,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.measures.pair import ActualTrack
from cwcli.pipeline.records import local_map_from_estimate_record, read_input_counts, read_run_records
from cwcli.signals.canonical import (
    HeadingSignal,
    ImuSignal,
    PoseSignal,
    PositionSignal,
    SpeedSignal,
    VelocitySignal,
)
from cwcli.signals.columns import Columns, FloatArray, Int64Array
from cwcli.signals.role import Role
from cwcli.signals.row_order import iter_track_rows
from cwcli.signals.units import NS_PER_S
from cwcli.stages.inputs.sources import read_sensor_signals
from cwcli.warning.rows import WarningRows
from cwcli.warning.types import WarningConfig, median_length_and_width_m

if TYPE_CHECKING:
    from cwcli.estimation.measurements import Measurements
    from cwcli.evaluation.evaluation_context import EgoTruth
    from cwcli.evaluation.system.warnings import FlagScores

EGO_SENSOR_ROLES = (Role.EGO_POSITION, Role.EGO_VELOCITY, Role.EGO_SPEED, Role.EGO_HEADING, Role.IMU)
"""Roles of the ego's sensors whose raw measurements the report draws."""
EgoSignal = PositionSignal | PoseSignal | VelocitySignal | SpeedSignal | HeadingSignal | ImuSignal


@dataclass(frozen=True)
class OtherTrack:
    """The track of another vehicle.

    Attributes:
        kind: `vehicle` (heard over V2X) or `target` (seen by a sensor).
        track: Stamps (n,) and states (n, 4): x_m, y_m, speed_mps, heading_rad.
        size_m: Length and width of its outline.
    """

    id: str
    kind: str
    track: ActualTrack
    size_m: tuple[float, float]


@dataclass(frozen=True)
class OtherSystemVerdicts:
    """Another system's warnings: their topic, their verdicts, and notes for the reader."""

    topic: str
    flag_scores: FlagScores
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Drive:
    """One annotated log as the report needs it.

    Attributes:
        ego: The ego's states, None where the log has none.
        others: The other vehicles, in order of id first seen.
        measurements: The ego's own measurements, as the estimator reads them.
        warnings: The warnings, None where the stage did not run.
        lanes: The lanes, None likewise.
        camera_topic: Topic of the camera frames, or "".
        notes: What the reader of the page should know.
        truth: The ego's, None where the log has none.
        gated: The ego's measurements that the estimator gated.
        other_system: Another system's warnings, None where none are judged.
        faults: What is wrong with the file itself -> how often.
    """

    name: str
    start_ns: int
    end_ns: int
    ego: VehicleStates | None
    others: tuple[OtherTrack, ...]
    measurements: tuple[Measurements, ...]
    warnings: WarningRows | None
    lanes: LaneRows | None
    warning_config: WarningConfig
    records: Mapping[str, Mapping[str, str]]
    camera_topic: str
    notes: tuple[str, ...] = ()
    truth: EgoTruth | None = None
    gated: GatedMeasurements = NO_GATED_MEASUREMENTS
    other_system: OtherSystemVerdicts | None = None
    faults: Mapping[str, int] = field(default_factory=dict)

    @property
    def doubt_evidence(self) -> DoubtEvidence:
        """What doubts about the drive are found in."""
        return DoubtEvidence(self.records, self.ego, self.start_ns, self.end_ns, self.faults)

    def seconds_since_start(self, stamp_ns: Int64Array) -> FloatArray:
        """Stamps as seconds from the log's start."""
        return np.asarray((stamp_ns - self.start_ns) / NS_PER_S, dtype=np.float64)

    def stage_input_records(self, stage: str) -> list[dict[str, Any]]:
        """Return what a stage's record says of its input messages; [] where it says nothing."""
        return read_input_counts(self.records.get(stage, {}))


SHOWN_FIELDS_BY_TOPIC: Mapping[str, tuple[str, ...] | None] = {
    EGO_STATE.topic: None,
    REMOTE_STATE.topic: KINEMATIC_FIELDS,
    TARGETS.topic: None,
    WARNINGS.topic: WARNING_FIELDS_FOR_EVENTS,
    LANES.topic: None,
    REJECTED.topic: None,
}
"""The channels that the report shows, and which of their fields it needs (None: all)."""
STORY_FIELDS_BY_TOPIC: Mapping[str, tuple[str, ...] | None] = {
    EGO_STATE.topic: KINEMATIC_AND_FLAG_FIELDS,
    REMOTE_STATE.topic: KINEMATIC_FIELDS,
    TARGETS.topic: None,
    WARNINGS.topic: WARNING_FIELDS_FOR_EVENTS,
}
"""The channels from which a story with warnings is told, and their fields."""


def require_results(log: Log) -> None:
    """Check that a stage of cwcli has run on the log.

    Raises:
        MissingSignalError: No stage of cwcli has run on it.
    """
    if not any(channel.topic in SHOWN_FIELDS_BY_TOPIC for channel in log.channels):
        raise MissingSignalError(
            "the log holds no channel of cwcli: there is nothing to report",
            where=log.name,
            hint=f"run `cwcli run {log.name} -o annotated.mcap` first, and report on annotated.mcap",
        )


def read_drive(log: Log, *, with_figures: bool = True) -> Drive:
    """Read what the report shows of a log.

    Args:
        log: An annotated log, on disk or in memory.
        with_figures: Read what the figures need: covariances, lanes, camera, raw measurements and truth. Without it
            there is only what the story of a drive with warnings needs.

    Raises:
        InputError: The log is damaged.
        DataError: A channel of cwcli's was written by another version.
    """
    records = read_run_records(log)
    topics_of_log = {channel.topic for channel in log.channels}
    fields_by_topic = SHOWN_FIELDS_BY_TOPIC if with_figures else STORY_FIELDS_BY_TOPIC
    fields_in_log = {topic: fields for topic, fields in fields_by_topic.items() if topic in topics_of_log}
    columns = log.load_topics(fields_in_log) if fields_in_log else {}
    warn, is_of_targets = find_collision_warning_record_and_is_of_targets(records)
    ego = None
    if EGO_STATE.topic in columns:
        ego = read_vehicle_states(columns[EGO_STATE.topic], with_covariance=with_figures)
    notes: list[str] = []
    others: list[OtherTrack] = []
    if REMOTE_STATE.topic in columns:
        others += _split_into_tracks(read_vehicle_states(columns[REMOTE_STATE.topic], with_covariance=False), "vehicle")
    if TARGETS.topic in columns:
        others += _read_target_tracks(columns[TARGETS.topic], notes)
    if is_of_targets:
        others.sort(key=lambda other: other.kind != "target")
    has_figures = with_figures and ego is not None and len(ego) > 0
    measured = _read_ego_measurements(log, records, notes) if has_figures else ()
    return Drive(
        name=log.name,
        start_ns=log.start_ns,
        end_ns=log.end_ns,
        ego=ego if ego is not None and len(ego) else None,
        others=tuple(others),
        measurements=measured,
        truth=_read_ego_truth_or_note(log, records, ego, notes) if has_figures and ego is not None else None,
        warnings=read_warnings(columns[WARNINGS.topic]) if WARNINGS.topic in columns else None,
        lanes=read_lanes(columns[LANES.topic]) if LANES.topic in columns else None,
        warning_config=warning_config_from_record(warn),
        records=records,
        camera_topic=find_camera_topic(log, records) if with_figures else "",
        notes=tuple(notes),
        gated=read_gated_measurements(columns[REJECTED.topic]) if REJECTED.topic in columns else NO_GATED_MEASUREMENTS,
        faults=log.faults.counts_by_reason(),
    )


def _read_target_tracks(columns: Columns, notes: list[str]) -> list[OtherTrack]:
    """Read the tracked targets; a note is added if they can't be read."""
    try:
        return _split_into_tracks(read_targets_as_states(columns), "target")
    except DataError as error:
        notes.append(f"the targets are not drawn: {error.what}")
        return []


def _split_into_tracks(states: VehicleStates, kind: str) -> list[OtherTrack]:
    """Split states into one track per vehicle."""
    found = []
    for vehicle, rows in iter_track_rows(states.ids, states.stamp_ns):
        size = median_length_and_width_m(states.length_m[rows], states.width_m[rows])
        found.append(OtherTrack(vehicle, kind, ActualTrack(states.stamp_ns[rows], states.state[rows, :4]), size))
    return found


def ego_length_and_width_m(ego: VehicleStates) -> tuple[float, float]:
    """Return length and width of the ego in m; the warnings' defaults where the states have none."""
    return median_length_and_width_m(ego.length_m, ego.width_m)


def _read_ego_measurements(
    log: Log, records: Mapping[str, Mapping[str, str]], notes: list[str]
) -> tuple[Measurements, ...]:
    """Read the ego's measurements as the estimator did: same topics, same clock, same time span."""
    from cwcli.estimation.from_signals import ego_signal_to_measurements

    record = records.get("estimate", {})
    try:
        sources = read_sensor_signals(
            log, source_config_from_record(record), command="report", required=(), optional=EGO_SENSOR_ROLES
        )
        local_map = local_map_from_estimate_record(record)
        found: list[Measurements] = []
        for role in EGO_SENSOR_ROLES:
            for signal in sources.by_role.get(role, ()):
                assert isinstance(signal, EgoSignal)
                if not isinstance(signal, PositionSignal) or local_map is not None:
                    found.extend(ego_signal_to_measurements(signal, local_map))
    except CwcliError as error:
        notes.append(f"the raw measurements are not drawn: {error.what}")
        return ()
    return tuple(found)


def _read_ego_truth_or_note(
    log: Log, records: Mapping[str, Mapping[str, str]], ego: VehicleStates, notes: list[str]
) -> EgoTruth | None:
    """Read the ego's truth from the topic that the estimator chose; a note is added if it can't be read."""
    from cwcli.evaluation.estimate import read_ego_truth

    try:
        return read_ego_truth(log, records.get("estimate", {}), ego.sort_by_stamp_without_repeats())
    except CwcliError as error:
        notes.append(f"the truth is not drawn: {error.what}")
        return None


def find_camera_topic(log: Log, records: Mapping[str, Mapping[str, str]]) -> str:
    """Find the camera's topic: the one that the lanes used, else the first channel of frames, else ""."""
    from cwcli.logs.read.frames import is_camera_channel

    topics = [channel.topic for channel in log.channels if is_camera_channel(channel)]
    for entry in read_input_counts(records.get("lanes", {})):
        if entry.get("topic") in topics:
            return str(entry["topic"])
    return topics[0] if topics else ""
