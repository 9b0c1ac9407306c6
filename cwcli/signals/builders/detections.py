"""Detections of other road users: radar scans and tracks, 3D boxes, objects of Autoware, drawn cubes, JSON
(docs/detections.md)."""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import DetectionKind, DetectionSignal
from cwcli.signals.clocks import MAX_STAMP_NS, MIN_STAMP_NS, repair_and_order_times
from cwcli.signals.columns import Columns, FloatArray, StampsNsAndIsGiven, Strings, absent_strings
from cwcli.signals.elements import Elements, find_ragged_field, offsets_and_indices_of_selected_sequences
from cwcli.signals.leaf_fields import find_field, read_stamps
from cwcli.signals.quality import Quality, RowLedger
from cwcli.signals.units import NS_PER_S

MIN_ELEVATION_COSINE = 0.1
"""The least cosine (1) of an elevation: beyond it, a range says nothing about the ground plane. Chosen by hand."""
POSE_COVARIANCE_XY_INDICES = (0, 1, 6, 7)
"""The indices of xx, xy, yx and yy in a 6 x 6 covariance, row-major."""
UPPER_TRIANGLE_XY_INDICES = (0, 1, 1, 3)
"""The indices of xx, xy, yx and yy in the upper triangle xx, xy, xz, yy, yz, zz."""
AUTOWARE_POSE_FIELD_NAMES = ("pose_with_covariance", "initial_pose_with_covariance")
"""The names of the pose fields of Autoware's objects: of detected and tracked objects, and of predicted ones."""


def build_radar_scan(columns: Columns, reading: Reading) -> tuple[DetectionSignal, Quality]:
    """Build detections from `radar_msgs/RadarScan`.

    Range and rate are brought into the plane by the elevation. A rate that is 0 in every return is not measured.
    """
    ledger = RowLedger(columns, reading.role)
    returns = Elements(columns, ledger, "returns.range", "returns.azimuth")
    elevation = returns.read_numbers("returns.elevation")
    with np.errstate(invalid="ignore"):
        cosine = np.maximum(np.cos(np.where(np.isfinite(elevation), elevation, 0.0)), MIN_ELEVATION_COSINE)
    rate = returns.read_numbers("returns.doppler_velocity")
    if len(rate) > 1 and not np.any(rate):
        ledger.add_note("the range rate is exactly 0 in every return, taken as not measured")
        rate = np.full(len(rate), np.nan)
    values = np.stack(
        [returns.read_numbers("returns.range") * cosine, returns.read_numbers("returns.azimuth"), rate / cosine], 1
    )
    return _make_detection_signal(reading, ledger, "radar", returns, values, None, read_stamps(columns))


def build_radar_tracks(columns: Columns, reading: Reading) -> tuple[DetectionSignal, Quality]:
    """Build detections from `radar_msgs/RadarTracks`: positions and velocities relative to the radar."""
    ledger = RowLedger(columns, reading.role)
    tracks = Elements(columns, ledger, "tracks.position.x", "tracks.position.y")
    leaves = ("position.x", "position.y", "velocity.x", "velocity.y")
    values = np.stack([tracks.read_numbers(f"tracks.{leaf}") for leaf in leaves], axis=1)
    if len(values) > 1 and not np.any(values[:, 2:]):
        ledger.add_note("the velocity is exactly 0 in every track, taken as not measured")
        values[:, 2:] = np.nan
    covariance = np.zeros((len(tracks), 4, 4))
    for name, part in (("position", slice(0, 2)), ("velocity", slice(2, 4))):
        triangle = tracks.read_numbers(f"tracks.{name}_covariance", width=6)
        covariance[:, part, part] = triangle[:, UPPER_TRIANGLE_XY_INDICES].reshape(-1, 2, 2)
    return _make_detection_signal(reading, ledger, "radar_track", tracks, values, covariance, read_stamps(columns))


def build_autoware(columns: Columns, reading: Reading) -> tuple[DetectionSignal, Quality]:
    """Build detections from the centres of Autoware's objects, with the covariance of their poses.

    Of detected objects it is given where they say so. Tracked and predicted ones are what a filter made of those: they
    are in the map, and their errors last from message to message.
    """
    ledger = RowLedger(columns, reading.role)
    known = [
        name
        for name in AUTOWARE_POSE_FIELD_NAMES
        if find_field(columns, f"objects.kinematics.{name}.pose.position.x") is not None
    ]
    pose = f"objects.kinematics.{(known or AUTOWARE_POSE_FIELD_NAMES)[0]}"
    objects = Elements(columns, ledger, f"{pose}.pose.position.x", f"{pose}.pose.position.y")
    values = np.stack([objects.read_numbers(f"{pose}.pose.position.{axis}") for axis in "xy"], axis=1)
    covariance = objects.read_numbers(f"{pose}.covariance", width=36)[:, POSE_COVARIANCE_XY_INDICES].reshape(-1, 2, 2)
    is_left_out = objects.read_numbers("objects.kinematics.has_position_covariance") == 0
    covariance = np.where((is_left_out | ~covariance.any(axis=(1, 2)))[:, None, None], np.nan, covariance)
    return _make_detection_signal(reading, ledger, "position", objects, values, covariance, read_stamps(columns))


def build_vision_boxes(columns: Columns, reading: Reading) -> tuple[DetectionSignal, Quality]:
    """Build detections from `vision_msgs/Detection3DArray`: the centres of the boxes.

    The covariance is that of the pose of the only hypothesis; with several, or none, it is not given. Where every box
    is left empty, the poses of the hypotheses are taken.
    """
    ledger = RowLedger(columns, reading.role)
    boxes = Elements(columns, ledger, "detections.bbox.center.position.x", "detections.bbox.center.position.y")
    values = np.stack([boxes.read_numbers(f"detections.bbox.center.position.{axis}") for axis in "xy"], axis=1)
    if len(values) > 1 and not np.any(values):
        poses = np.stack([boxes.read_numbers(f"detections.results.pose.pose.position.{axis}") for axis in "xy"], axis=1)
        if np.isfinite(poses).any():
            ledger.add_note("every box is empty: the poses of the hypotheses are used")
            values = poses
    matrices = boxes.read_numbers("detections.results.pose.covariance", width=36)
    covariance = matrices[:, POSE_COVARIANCE_XY_INDICES].reshape(-1, 2, 2)
    return _make_detection_signal(reading, ledger, "position", boxes, values, covariance, read_stamps(columns))


def build_scene_cubes(columns: Columns, reading: Reading) -> tuple[DetectionSignal, Quality]:
    """Build detections from `foxglove.SceneUpdate`: the centres of the cubes.

    The time is that of the message's first entity. Its frame is inside the entities and not read: mount the sensor.
    """
    ledger = RowLedger(columns, reading.role)
    path = "entities.cubes.pose.position"
    cubes = Elements(columns, ledger, f"{path}.x", f"{path}.y")
    values = np.stack([cubes.read_numbers(f"{path}.{axis}") for axis in "xy"], axis=1)
    return _make_detection_signal(
        reading, ledger, "position", cubes, values, None, _read_first_entity_stamps_ns_and_is_given(columns)
    )


def build_json_detections(columns: Columns, reading: Reading) -> tuple[DetectionSignal, Quality]:
    """Build detections from JSON messages as in `schemas/detections.schema.json`: positions, or ranges and azimuths."""
    ledger = RowLedger(columns, reading.role)
    if find_field(columns, "detections.range_m") is not None:
        found = Elements(columns, ledger, "detections.range_m", "detections.azimuth_rad")
        names = ("range_m", "azimuth_rad", "range_rate_mps")
        sigmas = [found.read_numbers(f"detections.{name}") for name in ("range_sigma_m", "azimuth_sigma_rad")]
        rate_sigma = found.read_numbers("detections.range_rate_sigma_mps")
        values = np.stack([found.read_numbers(f"detections.{name}") for name in names], axis=1)
        # a rate that is not measured has no noise: 1 keeps the matrix whole, and nobody reads it
        rate_sigma = np.where(np.isnan(values[:, 2]) & np.isnan(rate_sigma), 1.0, rate_sigma)
        covariance = np.stack([*sigmas, rate_sigma], axis=1)[:, :, None] ** 2 * np.eye(3)
        return _make_detection_signal(reading, ledger, "radar", found, values, covariance, read_stamps(columns))
    found = Elements(columns, ledger, "detections.x_m", "detections.y_m")
    values = np.stack([found.read_numbers("detections.x_m"), found.read_numbers("detections.y_m")], axis=1)
    parts = ("covariance_xx_m2", "covariance_xy_m2", "covariance_xy_m2", "covariance_yy_m2")
    covariance = np.stack([found.read_numbers(f"detections.{name}") for name in parts], axis=1).reshape(-1, 2, 2)
    return _make_detection_signal(reading, ledger, "position", found, values, covariance, read_stamps(columns))


def _make_detection_signal(
    reading: Reading,
    ledger: RowLedger,
    kind: DetectionKind,
    elements: Elements,
    values: FloatArray,
    covariance: FloatArray | None,
    stamps_ns_and_is_given: StampsNsAndIsGiven,
) -> tuple[DetectionSignal, Quality]:
    """Build the detection signal of a channel, scan by scan, from the values of its detections.

    Args:
        reading, ledger: Settings of the channel of s messages, and its ledger.
        kind: The contents of a row of `values`, see `DetectionSignal`.
        elements: The detections in each message, n together.
        values: Shape (n, k).
        covariance: Shape (n, k, k), or None where no message gives any.
        stamps_ns_and_is_given: Stamps, and whether there is one, shape (s,) each.
    """
    columns, width = ledger.columns, values.shape[1]
    if covariance is None:
        covariance = np.full((len(values), width, width), np.nan)
    with np.errstate(invalid="ignore", over="ignore"):
        marks = [elements.counts.astype(np.float64), *(elements.sum_per_message(column) for column in values.T)]
    timeline = repair_and_order_times(ledger, *stamps_ns_and_is_given, reading.clock, marks)
    offsets, index = offsets_and_indices_of_selected_sequences(elements.offsets, timeline.rows)
    signal = DetectionSignal(
        source=columns.topic,
        kind=kind,
        stamp_ns=timeline.stamp_ns,
        log_time_ns=columns.log_time_ns[timeline.rows],
        frame=_frame_names_of_rows(columns, timeline.rows),
        offsets=offsets,
        values=values[index],
        covariance=covariance[index],
    )
    return signal, ledger.quality


def _frame_names_of_rows(columns: Columns, rows: np.ndarray[tuple[int, ...], np.dtype[np.intp]]) -> Strings:
    field = find_field(columns, "header.frame_id", "frame_id")
    if not isinstance(field, Strings):
        return absent_strings(len(rows))
    return Strings(field.codes[rows], tuple(name.lstrip("/") for name in field.values))


def _read_first_entity_stamps_ns_and_is_given(columns: Columns) -> StampsNsAndIsGiven:
    """Return the stamps (ns) of each message's first entity, and whether it has one."""
    seconds = find_ragged_field(columns, "entities.timestamp.seconds", "entities.timestamp.sec")
    nanoseconds = find_ragged_field(
        columns, "entities.timestamp.nanos", "entities.timestamp.nsec", "entities.timestamp.nanosec"
    )
    n = len(columns)
    if seconds is None or nanoseconds is None or not (len(seconds.values) and len(nanoseconds.values)):
        return np.zeros(n, np.int64), np.zeros(n, np.bool_)
    has_entity = (np.diff(seconds.offsets) > 0) & (np.diff(nanoseconds.offsets) > 0)
    whole = seconds.values[np.minimum(seconds.offsets[:-1], len(seconds.values) - 1)].astype(np.float64)
    rest = nanoseconds.values[np.minimum(nanoseconds.offsets[:-1], len(nanoseconds.values) - 1)].astype(np.float64)
    has_entity &= np.isfinite(whole) & np.isfinite(rest) & (np.abs(whole) < MAX_STAMP_NS // NS_PER_S)
    has_entity &= np.abs(rest) < MAX_STAMP_NS
    stamp_ns = np.where(has_entity, whole, 0.0).astype(np.int64) * NS_PER_S
    stamp_ns += np.where(has_entity, rest, 0.0).astype(np.int64)
    return stamp_ns, has_entity & (stamp_ns >= MIN_STAMP_NS) & (stamp_ns <= MAX_STAMP_NS)
