"""Stage `estimate`: sensors and V2X messages in, the ego's and the remote vehicles' states out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Annotated

import numpy as np

from cwcli.channels.ego_viewers import make_ego_channels
from cwcli.channels.published import EGO_ONLINE, REMOTE_ONLINE, REMOTE_STATE
from cwcli.channels.rejected import make_rejected_measurement_channel, table_of_rejected_measurements
from cwcli.channels.road_event import make_road_event_channels, road_event_table_by_name
from cwcli.channels.transforms import read_lever_arms_transform_counts_and_notes
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.estimation.calibration import Calibration, run_record_entry_of_calibration_file
from cwcli.estimation.config import EstimatorConfig, LeverArms
from cwcli.estimation.correction import Correction
from cwcli.estimation.from_signals import (
    EgoSignal,
    drop_stretches_without_position_and_note,
    ego_output_stamps_ns,
    ego_signal_to_measurements,
    merge_remotes_placed_in_map_and_note,
)
from cwcli.estimation.geodetic_faults import (
    GEODETIC_FAULTS,
    is_position_contradicted,
    is_position_doubted,
    topics_corrected_or_blamed,
)
from cwcli.estimation.hypotheses import UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND
from cwcli.estimation.hypotheses.base import compose_hypothesis_by_name
from cwcli.estimation.measurements import Measurements
from cwcli.estimation.online_availability import (
    ORIGIN_NAME_OF_PARAMETERS_FROM_LOG,
    ORIGIN_NAME_OF_PARAMETERS_FROM_MESSAGES,
    STAMP_ROUNDING_SLACK_NS,
    OnlineAvailability,
    available_times_of_states_ns,
    parameter_origin_text,
)
from cwcli.estimation.result import Track, TrackSummary
from cwcli.estimation.seen_ego import drop_ego_seen_by_others_and_note
from cwcli.estimation.seen_senders import drop_seen_objects_that_are_senders_and_note
from cwcli.estimation.source_clocks import align_source_clocks_and_note
from cwcli.estimation.stated_noise import (
    SigmasByRoleOrTopic,
    fill_missing_noise_with_stated,
    require_known_names_and_sigma_counts,
)
from cwcli.estimation.summary import build_estimate_table, format_source_diagnostics_json, summarise_track
from cwcli.estimation.track import estimate_hindsight_and_online_tracks
from cwcli.estimation.verdict import consistency_verdict_sentence
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.records import map_origin_record_entries
from cwcli.pipeline.remote_states import estimate_remote_states
from cwcli.pipeline.result import InputMessageCount, StageResult, StageSummary
from cwcli.pipeline.run_record import build_run_record
from cwcli.signals.canonical import PoseSignal, PositionSignal, Signal, TimedSignal
from cwcli.signals.columns import Int64Array
from cwcli.signals.geodesy import LocalMap, parse_truth_origin
from cwcli.signals.role import Role
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import EGO_ID
from cwcli.stages.inputs.sources import SensorSignals, SourceConfig, read_sensor_signals
from cwcli.stages.summaries.estimate import estimate_tables, format_gap_notes, online_states_table
from cwcli.work_share import part_of_work

EXAMPLES = (
    "cwcli estimate drive.mcap -o estimated.mcap --metrics estimate.parquet",
    "cwcli estimate drive.mcap --latency /gps/vel=300 -o estimated.mcap",
)
"""Command lines that the help of `cwcli estimate` shows."""
EGO_SENSOR_ROLES = (Role.EGO_POSITION, Role.EGO_VELOCITY, Role.EGO_SPEED, Role.EGO_HEADING, Role.IMU)
"""Roles of the signals that the ego is estimated from; the position comes first and is required."""
MAX_BRIDGED_SENSOR_PAUSE_S = 60
"""Longest pause of all the ego's sources together [s] over which the estimate goes on; chosen by hand."""


@dataclass(frozen=True)
class EstimateConfig:
    """Settings of the stage.

    Attributes:
        sources: Which channels are read, and how.
        estimator: The filter; remote vehicles run the same one, without a search for latencies, because the
            quantities of one message share its time, and without one for the sensors' errors.
        rate_hz: Rate of the ego's states. Remote states come at the times of their messages.
        stitch: Join the ids of a remote vehicle that changes its pseudonym.
        calibration: Constants of the ego's sensors from other drives, or None.
        truth_origin: Latitude, longitude (deg) and altitude (m) of a Cartesian truth channel's origin, or None.
    """

    sources: SourceConfig = field(default_factory=SourceConfig)
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
    rate_hz: Annotated[
        float, Option("--rate", "Rate of the ego's states.", metavar="HZ", above=0.0, at_most=10_000.0)
    ] = 20.0
    stitch: Annotated[bool, Option("--stitch", "Treat a remote vehicle that changes its id as one vehicle.")] = False
    calibration: Calibration | None = None
    truth_origin: Annotated[
        tuple[float, float, float] | None,
        Option(
            "--truth-origin",
            "Origin of a Cartesian truth channel, in degrees and metres.",
            metavar="LAT,LON,ALT",
            kind=str | None,
            parse=parse_truth_origin,
        ),
    ] = None


@dataclass(frozen=True)
class EstimateEvidence:
    """Values that the evaluation of the stage needs.

    Attributes:
        truths, remotes: Signals of the ego's truth and of the remote vehicles, () without any.
        measurements: Measurements of the ego, positions first.
        ego: Estimated track of the ego.
        local_map: The map's place on the earth, or None where it has none.
    """

    truths: tuple[Signal, ...]
    remotes: tuple[Signal, ...]
    measurements: Sequence[Measurements]
    ego: Track
    local_map: LocalMap | None


def estimate(log: Log, config: EstimateConfig) -> StageResult:
    """Estimate the states of the ego and the remote vehicles.

    Needs the ego's position; uses its velocity, speed, heading and IMU, V2X messages and a truth channel where the log
    has them. Each source's latency and the IMU's biases are found from the log itself and reported.

    Raises:
        MissingSignalError: No channel, or more than one, holds the ego position.
        UsageError: An override that does not fit the log.
        DataError: No usable position.
    """
    with part_of_work(0.0, 0.1, "chunks"):
        sources = read_sensor_signals(
            log,
            config.sources,
            command="estimate",
            required=(Role.EGO_POSITION,),
            optional=(*EGO_SENSOR_ROLES[1:], Role.REMOTE, Role.TRUTH),
        )
    _check_topics_of_options(config.estimator, log)
    if config.estimator.model != "cwcli" and (config.calibration is not None or config.estimator.lever_arms):
        option = "--lever-arm" if config.calibration is None else "--calibration"
        raise UsageError(f"{option} is not for --model {config.estimator.model}")
    lever_arms, transforms, lever_arm_notes = _read_lever_arms_if_used(log, sources, config.estimator)
    estimator = replace(config.estimator, calibration=config.calibration, lever_arms=lever_arms)
    with part_of_work(0.1, 0.7 if sources.by_role.get(Role.REMOTE) else 0.95):
        estimated = _estimate_ego(sources, estimator, config.rate_hz)
    sources, estimated = _undo_exchanged_or_reversed_coordinates(sources, estimated, estimator, config.rate_hz)
    measurements, local_map, stretch_notes = estimated.measurements, estimated.local_map, estimated.notes
    ego, online = estimated.hindsight, estimated.online
    position = sources.by_role[Role.EGO_POSITION][0]
    remote_signals = sources.by_role.get(Role.REMOTE, ())
    signal, notes = merge_remotes_placed_in_map_and_note(remote_signals, position, local_map, is_stitched=config.stitch)
    size_m = position.size_m if isinstance(position, PoseSignal) else (None, None)
    if signal is not None:
        signal, ego_notes = drop_ego_seen_by_others_and_note(signal, online, size_m, local_map)
        signal, twice = drop_seen_objects_that_are_senders_and_note(signal, local_map)
        notes = (*notes, *ego_notes, *twice)
    remote = None
    if signal is not None and len(signal.stamp_ns):
        with part_of_work(0.7, 0.95, "vehicles"):
            remote = estimate_remote_states(signal, local_map, estimator)
    events = None if signal is None else signal.events
    whole = VehicleStates.from_ego_states(ego.stamp_ns, ego.state, ego.covariance, size_m=size_m, flags=ego.flags)
    hindsight = whole.round_to_published_precision()
    knowable = replace(
        VehicleStates.from_ego_states(
            online.stamp_ns, online.state, online.covariance, size_m=size_m, flags=online.flags
        ),
        log_time_ns=_times_online_states_became_known_ns(measurements, online, estimator),
    )
    channels = [
        *make_ego_channels(hindsight, local_map),
        make_vehicle_state_channel(EGO_ONLINE, knowable, local_map),
        *([make_rejected_measurement_channel(ego.gated)] if len(ego.gated) else []),
        *make_road_event_channels(events, local_map),
    ]
    if remote is not None:
        channels.append(make_vehicle_state_channel(REMOTE_STATE, remote.hindsight, local_map))
        channels.append(make_vehicle_state_channel(REMOTE_ONLINE, remote.online, local_map))
    hindsight_states = replace(ego, state=hindsight.state, covariance=np.asarray(hindsight.covariance))
    tracks = {EGO_ID: summarise_track(ego), **(remote.tracks if remote else {})}
    notified = road_event_table_by_name(events, local_map)
    parameters = parameter_origin_text(estimator)
    availabilities = [OnlineAvailability(EGO_ONLINE.topic, parameters, knowable.stamp_ns, knowable.log_time_ns)]
    if remote is not None:
        of_remote = (
            ORIGIN_NAME_OF_PARAMETERS_FROM_MESSAGES if estimator.takes_no_online_parameter_from_log else parameters
        )  # a calibration says nothing of other cars
        availabilities.append(
            OnlineAvailability(REMOTE_ONLINE.topic, of_remote, remote.online.stamp_ns, remote.online.log_time_ns)
        )
        if remote.n_overtaken:
            stretch_notes.append(
                f"{remote.n_overtaken} messages came behind a newer one of their vehicle: not in its online states"
            )
    summary = _build_summary(
        sources,
        (*lever_arm_notes, *stretch_notes, *notes),
        tracks,
        availabilities,
        transforms,
        estimator,
        estimated.clock_corrections,
    )
    return StageResult(
        stage="estimate",
        channels=tuple(channels),
        tables={**build_estimate_table(tracks), "rejected": table_of_rejected_measurements(ego.gated), **notified},
        summary=summary,
        metadata=build_run_record(
            "estimate",
            log,
            replace(config, calibration=None),
            summary,
            sources=format_source_diagnostics_json(tracks),
            online_parameters=parameters,
            **map_origin_record_entries(local_map),
            **run_record_entry_of_calibration_file(config.calibration),
        ),
        evaluation_inputs=EstimateEvidence(
            sources.by_role.get(Role.TRUTH, ()), remote_signals, measurements, hindsight_states, local_map
        ),
    )


@dataclass(frozen=True)
class _EstimatedEgo:
    """Tracks of the ego with what they are from.

    Attributes:
        measurements: Measurements, positions first.
        local_map: The map's place on the earth, or None.
        clock_corrections: Sentences on clocks that were corrected.
        notes: Notes on measurements that were left out.
        hindsight, online: The tracks.
    """

    measurements: list[Measurements]
    local_map: LocalMap | None
    clock_corrections: list[str]
    notes: list[str]
    hindsight: Track
    online: Track


def _estimate_ego(sources: SensorSignals, estimator: EstimatorConfig, rate_hz: float) -> _EstimatedEgo:
    """Estimate the ego's tracks."""
    local_map = _map_at_first_fix_unless_cartesian(sources)
    corrects_clocks = not (estimator.takes_no_online_parameter_from_log or estimator.calibration is not None)
    aligned, clock_notes = align_source_clocks_and_note(
        _collect_ego_measurements(sources, local_map, estimator.sigmas),
        corrects=corrects_clocks,
        trusted=estimator.sources_with_trusted_clock,
    )
    measurements, stretch_notes = drop_stretches_without_position_and_note(aligned, MAX_BRIDGED_SENSOR_PAUSE_S)
    tracks = estimate_hindsight_and_online_tracks(
        measurements,
        estimator,
        ego_output_stamps_ns(measurements, rate_hz, MAX_BRIDGED_SENSOR_PAUSE_S),
        blind=estimator.takes_no_online_parameter_from_log,
    )
    corrections = clock_notes if corrects_clocks else []
    notes = stretch_notes if corrects_clocks else [*clock_notes, *stretch_notes]
    return _EstimatedEgo(measurements, local_map, corrections, notes, *tracks)


def _undo_exchanged_or_reversed_coordinates(
    sources: SensorSignals, estimated: _EstimatedEgo, estimator: EstimatorConfig, rate_hz: float
) -> tuple[SensorSignals, _EstimatedEgo]:
    """Return signals and tracks with right latitudes and longitudes, where the other sources say that they are wrong.

    Nothing is changed where no online state may depend on the whole log, or where no known fault explains it.
    """
    positions = sources.by_role[Role.EGO_POSITION]
    signal = positions[0]
    decided_by_user = {*estimator.trusted_sources, *estimator.source_units}
    is_outvoted = is_position_doubted(estimated.hindsight, signal.source)
    if (
        not isinstance(signal, PositionSignal)
        or signal.source in decided_by_user
        or estimator.takes_no_online_parameter_from_log
        or not (is_outvoted or is_position_contradicted(estimated.hindsight, signal.source))
    ):
        return sources, estimated
    known = topics_corrected_or_blamed(estimated.hindsight)
    for fault in GEODETIC_FAULTS:
        if (fault.needs_vote and not is_outvoted) or not fault.are_corrected_fixes_on_earth(signal):
            continue
        corrected = tuple(fault.correct(each) if each is signal else each for each in positions)
        tried_sources = replace(sources, by_role={**sources.by_role, Role.EGO_POSITION: corrected})
        tried = _estimate_ego(tried_sources, estimator, rate_hz)
        in_doubt = topics_corrected_or_blamed(tried.hindsight)
        if signal.source in in_doubt or in_doubt - known:
            continue
        correction = fault.correction_of(signal)
        tracks = (
            replace(track, corrections=(correction, *track.corrections)) for track in (tried.hindsight, tried.online)
        )
        return tried_sources, _EstimatedEgo(
            tried.measurements, tried.local_map, tried.clock_corrections, tried.notes, *tracks
        )
    return sources, estimated


def _map_at_first_fix_unless_cartesian(sources: SensorSignals) -> LocalMap | None:
    """Return the map frame, east-north-up at the first valid fix; None where the positions are Cartesian."""
    position = sources.by_role[Role.EGO_POSITION][0]
    if not isinstance(position, PositionSignal):
        return None
    altitude_m = float(position.altitude_m[0])
    return LocalMap(
        float(position.latitude_deg[0]),
        float(position.longitude_deg[0]),
        altitude_m if np.isfinite(altitude_m) else 0.0,
    )


def _collect_ego_measurements(
    sources: SensorSignals, local_map: LocalMap | None, sigmas: SigmasByRoleOrTopic
) -> list[Measurements]:
    """Return the measurements of all signals of the ego, in the order of `EGO_SENSOR_ROLES`."""
    found: list[Measurements] = []
    for role in EGO_SENSOR_ROLES:
        for signal in sources.by_role.get(role, ()):
            assert isinstance(signal, EgoSignal)
            found.extend(fill_missing_noise_with_stated(ego_signal_to_measurements(signal, local_map), role, sigmas))
    return found


def _read_lever_arms_if_used(
    log: Log, sources: SensorSignals, estimator: EstimatorConfig
) -> tuple[LeverArms, tuple[InputMessageCount, ...], tuple[str, ...]]:
    """Return lever arms, counts and notes as read, or nothing for the paper's filter, which has no lever arms."""
    if estimator.model != "cwcli":
        return {}, (), ()
    known = {channel.topic for channel in log.channels}
    topics = [s.source for role in EGO_SENSOR_ROLES for s in sources.by_role.get(role, ()) if s.source in known]
    found, counts, notes = read_lever_arms_transform_counts_and_notes(
        log, list(dict.fromkeys(topics)), estimator.lever_arms
    )
    return found, tuple(InputMessageCount.from_transforms(*each) for each in counts), notes


def _check_topics_of_options(estimator: EstimatorConfig, log: Log) -> None:
    """Refuse an option for a topic that the log does not have, because it would be ignored.

    Raises:
        UsageError: There is no such topic.
    """
    known = [channel.topic for channel in log.channels]
    require_known_names_and_sigma_counts(estimator.sigmas, known, where=log.name)
    for option, names in (
        ("--latency", () if isinstance(estimator.latency, str) else estimator.latency),
        ("--trust", estimator.trusted_sources),
        ("--as", estimator.source_units),
    ):
        for name in names:
            if name not in known:
                raise UsageError(
                    f"{option} {name}: the log has no topic {name}",
                    where=log.name,
                    hint=hint_at_closest_or_all_known_names(name, known),
                )


def _add_corrections_to_input_counts(
    inputs: Sequence[InputMessageCount], corrections: Sequence[Correction]
) -> tuple[InputMessageCount, ...]:
    """Return the counts with the rows that were corrected as repaired, and those that were left out as set aside."""
    counted = []
    for entry in inputs:
        own = [
            each
            for each in corrections
            if each.who.source == entry.topic and each.who.role_name_for_options == entry.role
        ]
        aside = {each.fault: each.n_set_aside for each in own if each.n_set_aside}
        used = entry.used - sum(aside.values())
        repaired = {each.fault: min(each.n_rows, used) for each in own if not each.n_set_aside}
        counted.append(
            replace(entry, used=used, repaired={**entry.repaired, **repaired}, set_aside={**entry.set_aside, **aside})
        )
    return tuple(counted)


def _times_online_states_became_known_ns(
    measurements: Sequence[Measurements], online: Track, estimator: EstimatorConfig
) -> Int64Array:
    """Return the log times at which the ego's online states could have been known [ns], (n,)."""
    slack_ns = STAMP_ROUNDING_SLACK_NS
    if estimator.model == "song2016":  # whose measurements go to the nearest step
        slack_ns += round(0.5 * estimator.song2016_step_s * NS_PER_S)
    return available_times_of_states_ns(
        measurements, online.sources, online.stamp_ns, max_pause_s=MAX_BRIDGED_SENSOR_PAUSE_S, slack_ns=slack_ns
    )


def _build_summary(
    sources: SensorSignals,
    remarks: Sequence[str],
    tracks: Mapping[str, TrackSummary],
    online: Sequence[OnlineAvailability],
    transforms: Sequence[InputMessageCount],
    estimator: EstimatorConfig,
    clock_corrections: Sequence[str],
) -> StageSummary:
    """Return the summary of the stage: tables, input counts, notes, verdict and contradictions."""
    signals = [s for found in sources.by_role.values() for s in found if isinstance(s, TimedSignal) and len(s.stamp_ns)]
    start_ns = min(int(signal.stamp_ns[0]) for signal in signals)
    end_ns = max(int(signal.stamp_ns[-1]) for signal in signals)
    corrections = tracks[EGO_ID].corrections
    notes = [*clock_corrections, *(each.sentence_on_fault_and_undoing for each in corrections)]
    if estimator.takes_no_online_parameter_from_log:
        notes += [
            f"the online states use {each.who} as it is, because they may depend on no later message"
            + _hint_for_online_states(each, corrections)
            for each in corrections
            if not each.is_by_user and not each.n_set_aside
        ]
    notes += [*remarks, *sources.notes, *format_gap_notes(signals, start_ns, end_ns), *tracks[EGO_ID].notes]
    notes.extend(_merged_remote_notes(tracks))
    if online[0].parameters == ORIGIN_NAME_OF_PARAMETERS_FROM_LOG:
        notes.append(
            "noise and latencies of the online states were found from the whole log; with --calibration or "
            "--latency none no online state depends on a later message"
        )
    notes.extend(note for each in online for note in each.notes_on_late_states)
    return StageSummary(
        "estimate",
        (*estimate_tables(tracks), online_states_table(online)),
        (*_add_corrections_to_input_counts(sources.input_message_counts(), corrections), *transforms),
        tuple(dict.fromkeys(notes)),
        consistency_verdict_sentence(tracks[EGO_ID]),
        tuple(each.contradiction_sentence for each in tracks[EGO_ID].contradictions),
        corrections=(
            *clock_corrections,
            *(each.sentence_on_fault_and_undoing for each in corrections if not each.is_by_user),
        ),
        verdict_subject="the ego's states",
    )


def _hint_for_online_states(correction: Correction, corrections: Sequence[Correction]) -> str:
    """Return which option corrects the online states, too; "" where a fault of the source has no name for `--as`.

    The option names all faults of the source, because what it does not name is then left as it is.
    """
    kind = correction.who.kind
    name = "+".join(each.name for each in corrections if each.who == correction.who and not each.n_set_aside)
    if compose_hypothesis_by_name(kind, UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND.get(kind, ()), name) is None:
        return ""
    return f"; --as {correction.who.source}={name} corrects them, too"


def _merged_remote_notes(tracks: Mapping[str, TrackSummary]) -> list[str]:
    """Return the remote vehicles' notes; a note that several vehicles share is listed once."""
    stations: dict[str, list[str]] = {}
    for station, track in tracks.items():
        for note in track.notes if station != EGO_ID else ():
            stations.setdefault(note, []).append(station)
    return [f"{own[0] if len(own) == 1 else f'{len(own)} vehicles'}: {note}" for note, own in stations.items()]
