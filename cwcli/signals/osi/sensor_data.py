"""`osi3.SensorData`: a sensor's detections, and the GroundTruth of its SensorView where the trace keeps a copy.

Positions are in the axes of the sensor, whose place in the car is in the message; the car's origin is the middle of its
rear axle. They are brought into the body frame of cwcli's states, which is about the centre of the car's box.
Source: ASAM OSI 3.8.0, osi_sensordata.proto, osi_detectedobject.proto.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import DetectionSignal
from cwcli.signals.clocks import repair_and_order_times
from cwcli.signals.columns import Columns, FloatArray, absent_strings, median_of_values
from cwcli.signals.elements import Elements, find_ragged_field, offsets_and_indices_of_selected_sequences
from cwcli.signals.leaf_fields import read_numbers
from cwcli.signals.osi.leaves import (
    GROUND_TRUTH_PATH_PREFIX_IN_SENSOR_DATA,
    PATH_THAT_COUNTS_DETECTED_STATIONARY_OBJECTS,
)
from cwcli.signals.osi.world import (
    read_moving_objects,
    read_timestamps_ns_and_is_given,
    read_world_stamps_ns_and_is_given,
)
from cwcli.signals.quality import Quality, RowLedger

REFERENCE_POINT_FORWARD_HALF_LENGTHS_BY_CODE = np.array([0, 0, 0, 0, 0, -1, -1, -1, 1, 1, 1], np.float64)
"""The forward position of `DetectedMovingObject.ReferencePoint` on the box, in half lengths, by its number."""
REFERENCE_POINT_LEFT_HALF_WIDTHS_BY_CODE = np.array([0, 0, 0, 1, -1, 0, 1, -1, 0, 1, -1], np.float64)
"""The leftward position of `DetectedMovingObject.ReferencePoint` on the box, in half widths, by its number."""


def build_detections(columns: Columns, reading: Reading) -> tuple[DetectionSignal, Quality]:
    """Build detections of moving objects, about the centre of the host's box, x forward, y left.

    The time is that of the measurement; the covariance is that of `base_rmse`, where it is given.
    """
    ledger = RowLedger(columns, reading.role)
    objects = Elements(columns, ledger, "moving_object.base.position.x", "moving_object.base.position.y")
    place = np.stack([objects.read_numbers(f"moving_object.base.position.{axis}") for axis in "xy"], axis=1)
    place = place - _reference_point_offsets_m(objects)
    rmse = np.stack([objects.read_numbers(f"moving_object.base_rmse.position.{axis}") for axis in "xy"], axis=1)
    message = objects.message_rows
    yaw_rad = np.nan_to_num(read_numbers(columns, "mounting_position.orientation.yaw"))[message]
    mounting = np.stack([read_numbers(columns, f"mounting_position.position.{axis}") for axis in "xy"], axis=1)
    with np.errstate(invalid="ignore", over="ignore"):
        cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
        turn = np.stack([np.stack([cosine, -sine], axis=-1), np.stack([sine, cosine], axis=-1)], axis=-2)
        values = np.einsum("nij,nj->ni", turn, place) + np.nan_to_num(mounting)[message]
        variance = np.where(rmse > 0.0, rmse * rmse, np.nan)
        covariance = np.einsum("nij,nj,nkj->nik", turn, variance, turn)
    still = find_ragged_field(columns, PATH_THAT_COUNTS_DETECTED_STATIONARY_OBJECTS)
    if still is not None and len(still.values):
        ledger.add_note(
            f"{len(still.values)} detections of stationary objects are left out: road users are moving objects"
        )
    rear_x_m = _rear_axle_x_m(columns, reading)
    if np.isfinite(rear_x_m):
        values[:, 0] += rear_x_m
    else:
        ledger.add_note(
            "the position of the rear axle, which detections refer to, is not given: they are taken relative to the "
            "centre of the vehicle (--sensor TOPIC:x=-1.4 shifts them)"
        )
    stamp_ns, has_stamp = read_timestamps_ns_and_is_given(columns, "last_measurement_time")
    if not has_stamp.any():
        stamp_ns, has_stamp = read_world_stamps_ns_and_is_given(columns)
    else:
        has_stamp = np.ones(len(columns), np.bool_)
    marks = [
        objects.counts.astype(np.float64),
        *(objects.sum_per_message(np.nan_to_num(column)) for column in values.T),
    ]
    timeline = repair_and_order_times(ledger, stamp_ns, has_stamp, reading.clock, marks)
    offsets, index = offsets_and_indices_of_selected_sequences(objects.offsets, timeline.rows)
    signal = DetectionSignal(
        source=columns.topic,
        kind="position",
        stamp_ns=timeline.stamp_ns,
        log_time_ns=columns.log_time_ns[timeline.rows],
        frame=absent_strings(len(timeline.rows)),
        offsets=offsets,
        values=values[index],
        covariance=covariance[index],
    )
    return signal, ledger.quality


def _reference_point_offsets_m(objects: Elements) -> FloatArray:
    """Return the offsets (n, 2) in metres of `base.position` from each box's centre, in the axes of the sensor."""
    kind = objects.read_numbers("moving_object.reference_point")
    with np.errstate(invalid="ignore"):
        index = np.where((kind >= 0) & (kind < len(REFERENCE_POINT_FORWARD_HALF_LENGTHS_BY_CODE)), kind, 0).astype(
            np.intp
        )
    length, width, yaw = (
        np.nan_to_num(objects.read_numbers(f"moving_object.base.{leaf}"))
        for leaf in ("dimension.length", "dimension.width", "orientation.yaw")
    )
    with np.errstate(over="ignore"):
        ahead, left = (
            0.5 * length * REFERENCE_POINT_FORWARD_HALF_LENGTHS_BY_CODE[index],
            0.5 * width * REFERENCE_POINT_LEFT_HALF_WIDTHS_BY_CODE[index],
        )
        return np.stack([ahead * np.cos(yaw) - left * np.sin(yaw), ahead * np.sin(yaw) + left * np.cos(yaw)], axis=1)


def _rear_axle_x_m(columns: Columns, reading: Reading) -> float:
    """Return how far ahead (m) of the box's centre the host's rear axle is; NaN where the GroundTruth does not say."""
    world = read_moving_objects(
        columns, reading, RowLedger(columns, reading.role), GROUND_TRUTH_PATH_PREFIX_IN_SENSOR_DATA
    )
    known_x_m = world.rear_x_m[world.is_host_mask]
    known_x_m = known_x_m[np.isfinite(known_x_m)]
    return median_of_values(known_x_m) if len(known_x_m) else float("nan")
