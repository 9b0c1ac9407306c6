"""Errors of another system's state of the ego against the truth, or against cwcli's states in hindsight."""

from __future__ import annotations

import numpy as np

from cwcli.errors import DataError
from cwcli.evaluation.evaluation_context import EvaluationContext
from cwcli.evaluation.knowledge import OTHER_SYSTEM, comparison_label
from cwcli.evaluation.reference import EgoMotion, add_motion_errors, find_reference_motion
from cwcli.evaluation.system.placing import FramePlacement, fit_frame_placement
from cwcli.evaluation.system.reading import read_signal_of_other_system
from cwcli.lazy_dataclass import replace
from cwcli.pipeline.records import local_map_from_estimate_record, read_run_records
from cwcli.signals.canonical import PoseSignal, PositionSignal
from cwcli.signals.columns import EastNorthRows, FloatArray
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.role import Role

MIN_COMPARED_ROWS = 10
"""Least number of compared states. Chosen by hand; not fitted."""


def add_ego_state_errors_and_place_frame(context: EvaluationContext, topic: str) -> tuple[str, FramePlacement]:
    """Add the errors of another system's state of the ego, at the stamps of the reference.

    Returns:
        The frame of its poses, and the placement of that frame in the map.

    Raises:
        UsageError: Its messages are no poses.
        MissingSignalError: There is nothing to compare it with.
        DataError: No message can be used, or their times are not those of the states.
    """
    reference = find_reference_motion(context)
    signal = read_signal_of_other_system(context, "ego_state", topic, (Role.EGO_POSITION, Role.TRUTH))
    assert isinstance(signal, PoseSignal | PositionSignal)
    motion = _motion_from_signal(signal, _positions_with_geographic_in_map_m(context, signal)).interpolate_motion(
        signal.stamp_ns, reference.stamp_ns
    )
    if int(np.isfinite(motion.xy_m).all(axis=1).sum()) < MIN_COMPARED_ROWS:
        raise DataError(
            f"fewer than {MIN_COMPARED_ROWS} of its states are of a time at which the ego is known",
            where=f"{context.log.name}: {topic}",
        )
    frame, placing = "", FramePlacement(0.0, np.zeros(2), np.zeros(2))
    if isinstance(signal, PoseSignal) and signal.latitude_deg is None:
        found = fit_frame_placement(motion.xy_m, reference.motion.xy_m)
        assert found is not None  # there are MIN_ROWS
        frame, placing = signal.frame_id, found
        context.notes.append(placing.placement_note(topic, frame))
    placed_states = replace(
        motion, xy_m=placing.points_in_map_m(motion.xy_m), heading_rad=placing.headings_in_map_rad(motion.heading_rad)
    )
    with context.headline.label_rows_with_states(comparison_label(OTHER_SYSTEM, reference.knowledge)):
        add_motion_errors(context, "system.ego.", placed_states, reference.motion)
    return frame, placing


def _positions_with_geographic_in_map_m(context: EvaluationContext, signal: PoseSignal | PositionSignal) -> FloatArray:
    """Return positions (n, 2), m: in the map where they are geographic, else in their own frame."""
    local_map: LocalMap | None = local_map_from_estimate_record(read_run_records(context.log).get("estimate", {}))
    if signal.latitude_deg is None or signal.longitude_deg is None:
        return np.column_stack([signal.x_m, signal.y_m])
    if local_map is None:
        raise DataError(
            "positions on the globe can't be compared with states in a map of their own", where=signal.source
        )
    height_m = np.full(len(signal.latitude_deg), local_map.origin_alt_m)
    return np.column_stack(local_map.map_from_wgs84(signal.latitude_deg, signal.longitude_deg, height_m)[:2])


def _motion_from_signal(signal: PoseSignal | PositionSignal, xy_m: EastNorthRows) -> EgoMotion:
    """Return the motion of a signal in its own frame; NaN for what it does not have."""
    nothing = np.full(len(signal.stamp_ns), np.nan)
    if isinstance(signal, PositionSignal):
        return EgoMotion(xy_m, nothing, nothing, nothing)
    return EgoMotion(xy_m, signal.travel_rad, signal.speed_mps, signal.yaw_rate_radps)
