"""Autoware's objects: `DetectedObjects`, `TrackedObjects`, `PredictedObjects`, as detections of other road users."""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.detections import POSE_COVARIANCE_XY_INDICES, make_detection_signal
from cwcli.signals.canonical import DetectionSignal
from cwcli.signals.columns import Columns
from cwcli.signals.elements import Elements
from cwcli.signals.leaf_fields import find_field, read_stamps
from cwcli.signals.quality import Quality, RowLedger

POSE_FIELD_NAMES = ("pose_with_covariance", "initial_pose_with_covariance")
"""The names of the pose fields: of detected and tracked objects, and of predicted ones."""


def build_objects(columns: Columns, reading: Reading) -> tuple[DetectionSignal, Quality]:
    """Build detections from the centres of the objects, with the covariance of their poses.

    Of detected objects it is given where they say so. Tracked and predicted ones are what a filter made of those: they
    are in the map, and their errors last from message to message.
    """
    ledger = RowLedger(columns, reading.role)
    known = [
        name
        for name in POSE_FIELD_NAMES
        if find_field(columns, f"objects.kinematics.{name}.pose.position.x") is not None
    ]
    pose = f"objects.kinematics.{(known or POSE_FIELD_NAMES)[0]}"
    objects = Elements(columns, ledger, f"{pose}.pose.position.x", f"{pose}.pose.position.y")
    values = np.stack([objects.read_numbers(f"{pose}.pose.position.{axis}") for axis in "xy"], axis=1)
    covariance = objects.read_numbers(f"{pose}.covariance", width=36)[:, POSE_COVARIANCE_XY_INDICES].reshape(-1, 2, 2)
    is_left_out = objects.read_numbers("objects.kinematics.has_position_covariance") == 0
    covariance = np.where((is_left_out | ~covariance.any(axis=(1, 2)))[:, None, None], np.nan, covariance)
    return make_detection_signal(reading, ledger, "position", objects, values, covariance, read_stamps(columns))
