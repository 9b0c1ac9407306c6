"""Another system's state of the ego against the truth, or against cwcli's own hindsight where there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwcli.errors import DataError, MissingSignalError
from cwcli.evaluation.subject import Subject
from cwcli.evaluation.system.placing import Placing, fitted
from cwcli.evaluation.system.reading import read_system
from cwcli.pipeline.records import map_of, run_records
from cwcli.signals.angles import wrap_angle
from cwcli.signals.canonical import PoseSignal, PositionSignal
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.resample import resample
from cwcli.signals.role import Role
from cwcli.signals.vehicle_state import HEADING, SPEED, YAW_RATE

MAX_GAP_S = 0.5
MIN_ROWS = 10


@dataclass(frozen=True)
class Reference:
    """What a system is held against, in the map.

    Attributes:
        stamp_ns: Shape (n,).
        xy_m: Shape (n, 2).
        heading_rad, speed_mps, yaw_rate_radps: Shape (n,), NaN where not known.
        states: `truth` or `hindsight`.
    """

    stamp_ns: Int64Array
    xy_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    yaw_rate_radps: FloatArray
    states: str


def reference_of(subject: Subject) -> Reference:
    """The truth, or cwcli's states where there is none.

    Raises:
        MissingSignalError: The log has neither.
    """
    states, truth = subject.ego.states, subject.ego.truth
    if truth is not None:
        nothing = np.full(len(truth.stamp_ns), np.nan)
        motion = (truth.heading_rad, truth.speed_mps, truth.yaw_rate_radps)
        return Reference(truth.stamp_ns, truth.xy, *(nothing if each is None else each for each in motion), "truth")
    if states is None:
        raise MissingSignalError(
            "another system's state or path of the ego can't be judged: the log holds no states of the ego",
            where=subject.log.name,
            hint="annotate it first: `cwcli run LOG -o annotated.mcap`",
        )
    own = states.state
    return Reference(states.stamp_ns, own[:, :2], own[:, HEADING], own[:, SPEED], own[:, YAW_RATE], "hindsight")


def add_state(subject: Subject, topic: str) -> tuple[str, Placing]:
    """Add the errors of another system's state of the ego, at the stamps of the reference.

    Returns:
        The frame of its poses, and where that lies in the map.

    Raises:
        UsageError: Its messages are no poses.
        MissingSignalError: There is nothing to hold it against.
        DataError: Nothing of it can be used, or it is of another time than the states.
    """
    reference = reference_of(subject)
    signal = read_system(subject, "ego_state", topic, (Role.EGO_POSITION, Role.TRUTH))
    assert isinstance(signal, PoseSignal | PositionSignal)
    xy_m = _at(signal, _own_xy(subject, signal), reference)
    if int(np.isfinite(xy_m).all(axis=1).sum()) < MIN_ROWS:
        raise DataError(
            f"fewer than {MIN_ROWS} of its states are of a time at which the ego is known",
            where=f"{subject.log.name}: {topic}",
        )
    frame, placing = "", Placing(0.0, np.zeros(2), np.zeros(2))
    if isinstance(signal, PoseSignal) and signal.latitude_deg is None:
        found = fitted(xy_m, reference.xy_m)
        assert found is not None  # there are MIN_ROWS
        frame, placing = signal.frame_id, found
        subject.notes.append(placing.note(topic, frame))
    _add_errors(subject, signal, reference, placing.xy(xy_m), placing)
    return frame, placing


def _own_xy(subject: Subject, signal: PoseSignal | PositionSignal) -> FloatArray:
    """Its positions: in the map where they are on the globe, else in their own frame."""
    local_map: LocalMap | None = map_of(run_records(subject.log).get("estimate", {}))
    if signal.latitude_deg is None or signal.longitude_deg is None:
        return np.column_stack([signal.x_m, signal.y_m])
    if local_map is None:
        raise DataError(
            "positions on the globe can't be compared with states in a map of their own", where=signal.source
        )
    height_m = np.full(len(signal.latitude_deg), local_map.origin_alt_m)
    return np.column_stack(local_map.map_from_wgs84(signal.latitude_deg, signal.longitude_deg, height_m)[:2])


def _at(signal: PoseSignal | PositionSignal, values: FloatArray, reference: Reference) -> FloatArray:
    return resample(signal.stamp_ns, values, reference.stamp_ns, max_gap_s=MAX_GAP_S)


def _add_errors(
    subject: Subject, signal: PoseSignal | PositionSignal, reference: Reference, xy_m: FloatArray, placing: Placing
) -> None:
    error_m = xy_m - reference.xy_m
    cosine, sine = np.cos(reference.heading_rad), np.sin(reference.heading_rad)
    errors = {
        "position_rmse_m": np.hypot(*error_m.T),
        "along_rmse_m": error_m[:, 0] * cosine + error_m[:, 1] * sine,
        "cross_rmse_m": -error_m[:, 0] * sine + error_m[:, 1] * cosine,
        "position_max_m": np.hypot(*error_m.T),
    }
    if isinstance(signal, PoseSignal):
        yaw_rad = placing.heading(
            resample(signal.stamp_ns, signal.yaw_rad, reference.stamp_ns, max_gap_s=MAX_GAP_S, is_angle=True)
        )
        errors["speed_rmse_mps"] = _at(signal, signal.speed_mps, reference) - reference.speed_mps
        errors["heading_rmse_deg"] = np.degrees(wrap_angle(yaw_rad - reference.heading_rad))
        yaw_rate = _at(signal, signal.yaw_rate_radps, reference)
        errors["yaw_rate_rmse_degps"] = np.degrees(yaw_rate - reference.yaw_rate_radps)
    with subject.headline.of(f"system vs {reference.states}"):
        for name, values in errors.items():
            subject.headline.errors(f"system.ego.{name}", values)
