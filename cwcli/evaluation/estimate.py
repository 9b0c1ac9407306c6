"""Evaluation of `estimate`: errors of its result against the truth, and headline metrics."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.channels.binding import DESCRIPTION_BY_ROLE
from cwcli.channels.published import EGO_STATE
from cwcli.channels.vehicle_state import VehicleStates, driven_distance_m, read_vehicle_states
from cwcli.estimation.consistency import effective_count_of_squared_errors, nees
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.summary import summarise_track
from cwcli.estimation.verdict import consistency_verdict_sentence
from cwcli.evaluation.doubts.silences import MAX_UNDOUBTED_SILENCE_S, SILENCES_RECORD_KEY
from cwcli.evaluation.evaluation_context import TRUTH_AUTO, EgoStatesAndTruth, EgoTruth, EvaluationContext
from cwcli.evaluation.fix_offsets import fix_offsets_to_record_entry
from cwcli.evaluation.knowledge import TRUTH, comparison_label, online_or_hindsight_of_ego_states
from cwcli.evaluation.link import RadioLinkSummary, add_link_metrics
from cwcli.evaluation.records import source_config_from_record
from cwcli.evaluation.truth import (
    build_nees_section,
    build_truth_errors_section,
    compare_track_with_truth,
    covariances_nearest_in_time,
    notes_on_truth_mounting,
    place_truth_in_map_with_notes,
    truth_error_metric_rows,
)
from cwcli.evaluation.truth_rules import truth_rules_to_record_entry
from cwcli.lazy_dataclass import replace
from cwcli.logs.read.reader import Log
from cwcli.metrics.chi_square import chi_square_mean_bounds
from cwcli.metrics.headline import HeadlineCollector, find_metric
from cwcli.metrics.table import append_metric_rows
from cwcli.pipeline.records import (
    Record,
    local_map_from_estimate_record,
    parse_json_entry_or_empty,
    read_finite_number_or_nan,
    read_run_records,
)
from cwcli.pipeline.result import StageResult
from cwcli.signals.angles import wrap_angle
from cwcli.signals.canonical import PoseSignal, PositionSignal, Signal
from cwcli.signals.clocks import find_stamp_gaps
from cwcli.signals.columns import FloatArray, Int64Array, StateRows, median_of_values
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.resample import MAX_INTERPOLATED_STATE_GAP_S, interpolate_signal_at_times
from cwcli.signals.role import Role
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import EGO_ID
from cwcli.stages.estimate import EstimateConfig, EstimateEvidence
from cwcli.stages.inputs.sources import SensorSignals, read_sensor_signals

MAX_INTERPOLATED_FIX_GAP_S = 1.5
"""Longest gap between fixes that is interpolated, s. Chosen for fixes at 1 Hz."""
MIN_TRUTH_ROWS = 10
"""Least number of truth rows for a comparison. Chosen by hand; not fitted."""
CHI_SQUARE_95_TWO_DOF = -2.0 * float(np.log(0.05))
"""Chi-square quantile of 95 % with two degrees of freedom."""
MIN_SILENCE_IN_USUAL_STEPS = 5.0
"""Least duration of a silence in usual steps of its source. Chosen: as for the gaps of `cwcli info`."""
MEASURED_QUANTITIES_BY_KIND = {
    Kind.POSITION: ("position",),
    Kind.VELOCITY: ("speed", "heading"),
    Kind.SPEED: ("speed",),
    Kind.HEADING: ("heading",),
    Kind.ACCEL: ("acceleration",),
    Kind.YAW_RATE: ("yaw rate",),
    Kind.IMU: ("acceleration", "yaw rate"),
}
"""Kind of a measurement -> the quantities that it measures; a silence matters only where no other source has them."""


def add_scores_to_result(log: Log, config: EstimateConfig, result: StageResult) -> StageResult:
    """Add the radio link and the offsets from the fixes to the result, and the track's errors if there is a truth."""
    evidence: EstimateEvidence = result.evaluation_inputs
    errors = compare_track_with_truth(
        evidence.truths, evidence.measurements, evidence.ego, evidence.local_map, config.truth_origin
    )
    link = RadioLinkSummary(evidence.remotes, evidence.ego, evidence.local_map)
    entries = {
        **link.build_record_entries(),
        **fix_offsets_to_record_entry(evidence.measurements, evidence.ego),
        **lost_quantity_spans_to_record_entry(evidence.measurements),
    }
    if errors is None:
        return result.with_evaluation(sections=link.build_sections(), tables=link.build_tables(), entries=entries)
    table = append_metric_rows(result.tables["estimate"], truth_error_metric_rows(errors))
    return result.with_evaluation(
        sections=(*link.build_sections(), build_truth_errors_section(errors), build_nees_section(errors)),
        tables={"estimate": table, **link.build_tables()},
        notes=errors.notes,
        verdict=consistency_verdict_sentence(summarise_track(evidence.ego), errors.nees),
        entries={**entries, **(truth_rules_to_record_entry(errors.rules) if errors.rules else {})},
    )


def add_metrics(context: EvaluationContext) -> None:
    """Add the metrics of the ego's states, and the ego itself; nothing if the log has none."""
    log, headline = context.log, context.headline
    if all(channel.topic != EGO_STATE.topic for channel in log.channels):
        return
    record = read_run_records(log).get("estimate", {})
    states = read_vehicle_states(log.columns(EGO_STATE.topic)).sort_by_stamp_without_repeats()
    if not len(states):
        return
    reports = parse_json_entry_or_empty(record, "sources", list)
    read = _read_position_and_truth(log, record, context.truth)
    sources = read.by_role
    local_map = local_map_from_estimate_record(record)
    fixes = _stamps_and_positions_of_latency_corrected_fixes(sources.get(Role.EGO_POSITION, ()), local_map, reports)
    with headline.label_rows_with_states(
        comparison_label(online_or_hindsight_of_ego_states(read_run_records(log)), TRUTH)
    ):
        found = _add_errors_against_truth(headline, states, sources.get(Role.TRUTH, ()), local_map, fixes, record)
    if fixes is not None:
        stamp_ns, fix_xy = fixes
        at_fix = interpolate_signal_at_times(
            states.stamp_ns, states.state[:, :2], stamp_ns, max_gap_s=MAX_INTERPOLATED_STATE_GAP_S
        )
        headline.add_errors("ego.fix_residual_rmse_m", np.hypot(*(fix_xy - at_fix).T))
    headline.add_count("ego.distance_km", driven_distance_m(states) / 1000.0)
    variance = 0.5 * (states.covariance[:, 0, 0] + states.covariance[:, 1, 1])
    headline.add_from_sums("ego.sigma_median_m", median_of_values(np.sqrt(variance)) * len(states), len(states))
    _add_consistency_metrics(headline, reports)
    add_link_metrics(headline, parse_json_entry_or_empty(record, "link", dict))
    context.notes += [
        note for each in sources.get(Role.TRUTH, ()) if found is not None for note in _truth_mounting_notes(each)
    ]
    context.ego = EgoStatesAndTruth(states, found, _notes_on_unused_truth(read))


def _truth_mounting_notes(truth: Signal) -> tuple[str, ...]:
    return notes_on_truth_mounting(truth) if isinstance(truth, PoseSignal) else ()


def _notes_on_unused_truth(read: SensorSignals) -> tuple[str, ...]:
    """Return notes on why no truth is used although there are candidates; the binding's note names another option."""
    phrase = f" channels hold {DESCRIPTION_BY_ROLE[Role.TRUTH]}: "
    return tuple(
        f"{note.rpartition(';')[0]}; none is used (choose one with --truth)" for note in read.notes if phrase in note
    )


def _read_position_and_truth(log: Log, record: Record, truth: str) -> SensorSignals:
    """Read the position and truth signals as `cwcli estimate` did."""
    used = source_config_from_record(record)
    roles = (Role.EGO_POSITION,) if truth == "none" else (Role.EGO_POSITION, Role.TRUTH)
    chosen = {role.value: used.topics[role.value] for role in roles if role in used.topics}
    if truth not in ("auto", "none"):
        chosen[Role.TRUTH.value] = truth
    config = replace(used, topics=chosen)
    return read_sensor_signals(log, config, command="evaluate", required=(), optional=roles)


def _stamps_and_positions_of_latency_corrected_fixes(
    signals: Sequence[Signal], local_map: LocalMap | None, reports: Sequence[Any]
) -> tuple[Int64Array, FloatArray] | None:
    """Return stamps (n,), corrected by the latency that was found, and positions (n, 2) of the fixes."""
    signal = signals[0] if signals else None
    if isinstance(signal, PositionSignal) and local_map is not None:
        x_m, y_m, _ = local_map.map_from_wgs84(signal.latitude_deg, signal.longitude_deg, signal.altitude_m)
    elif isinstance(signal, PoseSignal) and local_map is None:
        x_m, y_m = signal.x_m, signal.y_m
    else:
        return None
    latency_s = 0.0
    for report in reports:
        if isinstance(report, dict) and report.get("source") == signal.source and report.get("quantity") == "position":
            found = read_finite_number_or_nan(report, "latency_s")
            latency_s = found if np.isfinite(found) else 0.0
    return signal.stamp_ns - round(latency_s * NS_PER_S), np.column_stack([x_m, y_m])


def read_ego_truth(log: Log, record: Record, states: VehicleStates) -> EgoTruth | None:
    """Read the truth of the ego from an annotated log; None where there is no usable one.

    Args:
        record: Record of `estimate`.
        states: States of the ego, in stamp order.

    Raises:
        InputError: The log is damaged.
        UsageError: A recorded topic is not in the log.
    """
    read = _read_position_and_truth(log, record, TRUTH_AUTO)
    local_map = local_map_from_estimate_record(record)
    fixes = _stamps_and_positions_of_latency_corrected_fixes(
        read.by_role.get(Role.EGO_POSITION, ()), local_map, parse_json_entry_or_empty(record, "sources", list)
    )
    found = _truth_in_map_with_signal_and_row_mask(states, read.by_role.get(Role.TRUTH, ()), local_map, fixes, record)
    return None if found is None else found[0]


def _truth_in_map_with_signal_and_row_mask(
    states: VehicleStates,
    truths: Sequence[Signal],
    local_map: LocalMap | None,
    stamps_and_positions_of_fixes: tuple[Int64Array, FloatArray] | None,
    record: Mapping[str, str],
) -> tuple[EgoTruth, PoseSignal | PositionSignal, npt.NDArray[np.bool_]] | None:
    """Return the truth in the span of the states, its signal and the mask of its rows; None without a usable one."""
    signal = truths[0] if truths else None
    if not isinstance(signal, PoseSignal | PositionSignal) or (
        isinstance(signal, PositionSignal) and local_map is None
    ):
        return None
    inside = (signal.stamp_ns >= states.stamp_ns[0]) & (signal.stamp_ns <= states.stamp_ns[-1])
    stamp_ns = signal.stamp_ns[inside]
    if len(stamp_ns) < MIN_TRUTH_ROWS:
        return None
    measured_xy = np.full((len(stamp_ns), 2), np.nan)
    if stamps_and_positions_of_fixes is not None:
        measured_xy = interpolate_signal_at_times(
            *stamps_and_positions_of_fixes, stamp_ns, max_gap_s=MAX_INTERPOLATED_FIX_GAP_S
        )
    origin = parse_json_entry_or_empty(record, "configuration", dict).get("truth_origin")
    given_origin = tuple(origin) if isinstance(origin, list) and len(origin) == 3 else None
    true_xy, _ = place_truth_in_map_with_notes(signal, inside, local_map, given_origin, measured_xy)
    if isinstance(signal, PositionSignal):
        return EgoTruth(signal.source, stamp_ns, true_xy), signal, inside
    motion = (each[inside] for each in (signal.speed_mps, signal.travel_rad, signal.yaw_rate_radps))
    return EgoTruth(signal.source, stamp_ns, true_xy, *motion), signal, inside


def _add_errors_against_truth(
    headline: HeadlineCollector,
    states: VehicleStates,
    truths: Sequence[Signal],
    local_map: LocalMap | None,
    stamps_and_positions_of_fixes: tuple[Int64Array, FloatArray] | None,
    record: Mapping[str, str],
) -> EgoTruth | None:
    """Add the errors at the truth's stamps and return the truth; None without a usable one."""
    found = _truth_in_map_with_signal_and_row_mask(states, truths, local_map, stamps_and_positions_of_fixes, record)
    if found is None:
        return None
    truth, signal, inside = found
    state = interpolate_signal_at_times(
        states.stamp_ns, states.state, truth.stamp_ns, max_gap_s=MAX_INTERPOLATED_STATE_GAP_S
    )
    error = state[:, :2] - truth.xy
    known = np.isfinite(error).all(axis=1)
    distance = np.hypot(*error.T)
    headline.add_errors("ego.position_rmse_m", distance)
    if truth.heading_rad is not None:
        cosine, sine = np.cos(truth.heading_rad), np.sin(truth.heading_rad)
        headline.add_errors("ego.along_rmse_m", error[:, 0] * cosine + error[:, 1] * sine)
        headline.add_errors("ego.cross_rmse_m", -error[:, 0] * sine + error[:, 1] * cosine)
    headline.add_errors("ego.position_max_m", distance)
    if isinstance(signal, PoseSignal):
        _add_motion_errors(headline, signal, inside, state)
    if known.any():
        covariance = covariances_nearest_in_time(truth.stamp_ns[known], states)[:, :2, :2]
        squared = nees(error[known], covariance)
        low, high = chi_square_mean_bounds(2.0, effective_count_of_squared_errors(error[known], covariance))
        headline.add_errors("ego.position_nees", squared)
        headline.add_share("ego.position_nees_inside", [low <= float(squared.mean()) <= high])
        headline.add_share("ego.position_inside_95_share", squared <= CHI_SQUARE_95_TWO_DOF)
    return truth


def _add_motion_errors(
    headline: HeadlineCollector, signal: PoseSignal, row_mask: npt.NDArray[np.bool_], state: StateRows
) -> None:
    heading = wrap_angle(state[:, 3] - signal.travel_rad[row_mask])
    headline.add_errors("ego.speed_rmse_mps", state[:, 2] - signal.speed_mps[row_mask])
    headline.add_errors("ego.heading_rmse_deg", np.degrees(heading))
    headline.add_errors("ego.yaw_rate_rmse_degps", np.degrees(state[:, 5] - signal.yaw_rate_radps[row_mask]))
    if signal.accel_mps2 is not None:
        headline.add_errors("ego.accel_rmse_mps2", state[:, 4] - signal.accel_mps2[row_mask])


def _add_consistency_metrics(headline: HeadlineCollector, reports: Sequence[Any]) -> None:
    """Add NIS by quantity, the share of sources inside their bounds, and the share of gated measurements."""
    own = [report for report in reports if isinstance(report, dict) and report.get("vehicle") == EGO_ID]
    others = [report for report in reports if isinstance(report, dict) and report.get("vehicle") != EGO_ID]
    for quantity in dict.fromkeys(str(report.get("quantity")) for report in own):
        judged_sources = [
            report
            for report in own
            if report.get("quantity") == quantity and isinstance(report.get("nis_inside"), bool)
        ]
        if not judged_sources or find_metric(f"ego.{quantity}_nis") is None:
            continue
        n = sum(read_finite_number_or_nan(report, "used") for report in judged_sources)
        total = sum(
            read_finite_number_or_nan(report, "used") * read_finite_number_or_nan(report, "nis_per_dof")
            for report in judged_sources
        )
        headline.add_from_sums(f"ego.{quantity}_nis", total, n)
        headline.add_share(f"ego.{quantity}_nis_inside", [report["nis_inside"] for report in judged_sources])
    for who, found in (("ego", own), ("remote", others)):
        inside = [report["nis_inside"] for report in found if isinstance(report.get("nis_inside"), bool)]
        headline.add_share(f"{who}.nis_inside_share", inside)
        read = sum(read_finite_number_or_nan(report, "read") for report in found)
        if read > 0:
            headline.add_from_sums(
                f"{who}.gated_share", sum(read_finite_number_or_nan(report, "gated") for report in found), read
            )
    if others:
        headline.add_count("remote.vehicles_count", len({str(report.get("vehicle")) for report in others}))


def lost_quantity_spans_to_record_entry(measurements: Sequence[Measurements]) -> dict[str, str]:
    """Return the entry of the record with the spans in which nothing told a quantity that is told elsewhere in the log.

    Each span has its `source`, its lost `quantities`, `begin_ns` and `end_ns`, whether it lasts `from_the_start` or
    `to_the_end`, and the `others` that tell something there. A time in which all sources are silent is a pause of the
    recording and no silence of a source.

    Args:
        measurements: Of the ego; the first one has the positions, with which the states begin.
    """
    stamps_by_source = [(m, np.sort(m.stamp_ns[np.isfinite(m.values).all(axis=1)])) for m in measurements]
    stamps_by_source = [(m, stamp_ns) for m, stamp_ns in stamps_by_source if len(stamp_ns)]
    positions_ns = [stamp_ns for m, stamp_ns in stamps_by_source if m.kind is Kind.POSITION]
    if not positions_ns:
        return {SILENCES_RECORD_KEY: "[]"}
    first_ns = min(int(each[0]) for each in positions_ns)
    last_ns = max(int(each[-1]) for _, each in stamps_by_source)
    found: dict[tuple[str, int, int], dict[str, Any]] = {}
    for m, stamp_ns in stamps_by_source:
        usual_s = median_of_values(np.diff(stamp_ns)) / NS_PER_S if len(stamp_ns) > 1 else 0.0
        least_s = max(MAX_UNDOUBTED_SILENCE_S, MIN_SILENCE_IN_USUAL_STEPS * usual_s)
        within_ns = stamp_ns[stamp_ns >= first_ns]
        for gap in find_stamp_gaps(within_ns, start_ns=first_ns, end_ns=last_ns, min_gap_s=least_s):
            others = [
                each
                for each in stamps_by_source
                if each[0] is not m and _does_source_go_on_in_span(each[1], gap.start_ns, gap.end_ns)
            ]
            known = {name for other, _ in others for name in MEASURED_QUANTITIES_BY_KIND[other.kind]}
            lost_quantities = [name for name in MEASURED_QUANTITIES_BY_KIND[m.kind] if name not in known]
            if not lost_quantities or not others:
                continue
            silence = found.setdefault(
                (m.source, gap.start_ns, gap.end_ns),
                {
                    "source": m.source,
                    "quantities": [],
                    "begin_ns": gap.start_ns,
                    "end_ns": gap.end_ns,
                    "from_the_start": gap.start_ns <= first_ns,
                    "to_the_end": gap.end_ns >= last_ns,
                    "others": {},
                },
            )
            silence["quantities"] += [name for name in lost_quantities if name not in silence["quantities"]]
            for other, _ in others:
                of_topic = silence["others"].setdefault(other.source, [])
                of_topic += [name for name in MEASURED_QUANTITIES_BY_KIND[other.kind] if name not in of_topic]
    return {SILENCES_RECORD_KEY: json.dumps(list(found.values()))}


def _does_source_go_on_in_span(stamp_ns: Int64Array, begin_ns: int, end_ns: int) -> bool:
    """Whether a source goes on for more than half of a span: it has no gap of so long there."""
    inside = stamp_ns[(stamp_ns > begin_ns) & (stamp_ns < end_ns)]
    edges_ns = np.concatenate([[begin_ns], inside, [end_ns]])
    return len(inside) > 0 and int(np.diff(edges_ns).max()) <= (end_ns - begin_ns) // 2
