"""Autoware's objects: `DetectedObjects`, `TrackedObjects`, `PredictedObjects`, as detections of other road users."""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.detections import POSE_COVARIANCE_XY, detection_signal
from cwcli.signals.canonical import DetectionSignal
from cwcli.signals.columns import Columns
from cwcli.signals.elements import Elements
from cwcli.signals.leaf_fields import find, stamps
from cwcli.signals.quality import Quality, RowLedger

POSES = ("pose_with_covariance", "initial_pose_with_covariance")
"""The names of the pose fields: of detected and tracked objects, and of predicted ones."""


def build_objects(columns: Columns, reading: Reading) -> tuple[DetectionSignal, Quality]:
    """Build detections from the centres of the objects, with the covariance of their poses.

    Of detected objects it is given where they say so. Tracked and predicted ones are what a filter made of those: they
    are in the map, and their errors last from message to message.
    """
    ledger = RowLedger(columns, reading.role)
    known = [name for name in POSES if find(columns, f"objects.kinematics.{name}.pose.position.x") is not None]
    pose = f"objects.kinematics.{(known or POSES)[0]}"
    objects = Elements(columns, ledger, f"{pose}.pose.position.x", f"{pose}.pose.position.y")
    values = np.stack([objects.numbers(f"{pose}.pose.position.{axis}") for axis in "xy"], axis=1)
    covariance = objects.numbers(f"{pose}.covariance", width=36)[:, POSE_COVARIANCE_XY].reshape(-1, 2, 2)
    is_left_out = objects.numbers("objects.kinematics.has_position_covariance") == 0
    covariance = np.where((is_left_out | ~covariance.any(axis=(1, 2)))[:, None, None], np.nan, covariance)
    return detection_signal(columns, reading, ledger, "position", objects, values, covariance, *stamps(columns))
