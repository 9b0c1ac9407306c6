"""Poses with an orientation: which axis of the body points forward, and which axis of the world up.

Trajectories of cars have the axes of the body (x forward, z up) or of a camera (z forward, y down), and a world with z
up, or the camera's first pose as its world. The direction of the way in the axes of the body shows which.
"""

from __future__ import annotations

import numpy as np

from cwcli.importing.inertial import car_from_sensor_rotation_by_user_or_none
from cwcli.importing.meaning import Meaning
from cwcli.importing.motion import first_rows_of_intervals, spans_of_map_points
from cwcli.importing.readers.trajectory import xyzw_quaternions_of_rotations
from cwcli.signals.angles import rotation_matrices_of_unit_quaternions
from cwcli.signals.columns import FloatArray

TIME_STEP_BETWEEN_COMPARED_POSITIONS_S = 1.0
"""Time in s between two positions whose direction is compared with the axes of the poses. Chosen by hand."""
MIN_STEP_LENGTH_TO_SHOW_AXES_M = 0.5
"""Least distance in m between two such positions. Chosen by hand."""
MIN_STEPS_TO_SHOW_AXES = 5
"""Least number of such pairs of positions. Chosen by hand."""
MIN_MOTION_COSINE_OF_FORWARD_AXIS = 0.85
"""Least mean cosine between the direction of motion and an axis that counts as pointing forward. Chosen by hand."""
MIN_COSINE_OF_WORLD_UP_AXIS = 0.9
"""Least cosine between the mean vertical of the body and an axis of the world that counts as up: that of 26 degrees.
Chosen by hand."""
CAMERA_TO_BODY = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Camera axes (z forward, x right, y down) -> body axes (x forward, y left, z up)."""


def rotate_poses_into_car_axes(meaning: Meaning) -> None:
    """Turn poses into x forward and z up, or leave their orientation out where the way does not show forward."""
    values = meaning.values
    if "quaternion_w" not in values or "x" not in values:
        return
    place = np.stack([values["x"], values["y"], values.get("z", np.zeros(len(values["x"])))], axis=1)
    rotation = rotations_of_quaternions(np.stack([values[f"quaternion_{axis}"] for axis in "xyzw"], axis=1))
    found = _body_from_sensor_and_if_orientation_usable(meaning, place, rotation)
    if found is None:
        return
    body_from_sensor, is_orientation_known = found
    if not is_orientation_known:
        for axis in "xyzw":
            del values[f"quaternion_{axis}"]
        return
    turned_rotation = rotation @ body_from_sensor.T
    world = _rotation_of_world_to_mean_vertical_or_none(turned_rotation)
    if world is None:
        meaning.add_question(
            "the body's vertical is along no axis of the world", "--axes FORWARD,UP names the body's axes: x,z or z,-y"
        )
        return
    if not np.array_equal(world, np.eye(3)):
        meaning.notes.append("the world has another axis up: positions are turned so that z is up")
        place = place @ world.T
        values["x"], values["y"], values["z"] = place.T
        turned_rotation = world @ turned_rotation
    if not np.array_equal(body_from_sensor, np.eye(3)) or not np.array_equal(world, np.eye(3)):
        quaternions = xyzw_quaternions_of_rotations(turned_rotation)
        for k, axis in enumerate("xyzw"):
            values[f"quaternion_{axis}"] = quaternions[:, k]
        meaning.track = spans_of_map_points(meaning.stamp_ns, values["x"], values["y"])


def _body_from_sensor_and_if_orientation_usable(
    meaning: Meaning, place: FloatArray, rotation: FloatArray
) -> tuple[FloatArray, bool] | None:
    """Return the rotation from the sensor's axes to the car's, and whether the orientation can be used."""
    rotation_by_user = car_from_sensor_rotation_by_user_or_none(meaning)
    if rotation_by_user is not None or meaning.questions:
        return None if rotation_by_user is None else (rotation_by_user, True)
    ways = _unit_motion_directions_in_body(meaning, place, rotation)
    if len(ways) < MIN_STEPS_TO_SHOW_AXES:
        if np.allclose(rotation, np.eye(3), atol=1e-9):
            return np.eye(3), False
        meaning.notes.append("too little motion shows the body's axes: taken as x forward, z up")
        return np.eye(3), True
    mean = ways.mean(axis=0)
    if mean[0] > MIN_MOTION_COSINE_OF_FORWARD_AXIS:
        return np.eye(3), True
    if mean[2] > MIN_MOTION_COSINE_OF_FORWARD_AXIS:
        meaning.notes.append("the way is along the body's z axis: camera axes (z forward, y down)")
        return CAMERA_TO_BODY, True
    meaning.notes.append(
        f"the way is along no usual axis of the body (mean direction {mean[0]:.2f}, {mean[1]:.2f}, {mean[2]:.2f}): "
        "the orientation is left out; --axes FORWARD,UP names the axes"
    )
    return np.eye(3), False


def _unit_motion_directions_in_body(meaning: Meaning, place: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return unit directions of the way in the axes of the body, (m, 3)."""
    stamps = meaning.stamp_ns
    rows = first_rows_of_intervals(stamps, TIME_STEP_BETWEEN_COMPARED_POSITIONS_S)
    if len(rows) < 2:
        return np.zeros((0, 3))
    steps = np.diff(place[rows], axis=0)
    length = np.linalg.norm(steps, axis=1)
    middle = (rows[:-1] + rows[1:]) // 2
    use = (
        (length > MIN_STEP_LENGTH_TO_SHOW_AXES_M) & np.isfinite(length) & np.isfinite(rotation[middle]).all(axis=(1, 2))
    )
    return np.asarray(np.einsum("nji,nj->ni", rotation[middle[use]], steps[use] / length[use, None]))


def _rotation_of_world_to_mean_vertical_or_none(body_rotations: FloatArray) -> FloatArray | None:
    """Return the rotation (3, 3) of the world that makes the mean vertical of the body z; None for a slanted one."""
    upward = np.nanmean(body_rotations[:, :, 2], axis=0)
    upward = upward / max(float(np.linalg.norm(upward)), 1e-9)
    k = int(np.argmax(np.abs(upward)))
    if abs(upward[k]) < MIN_COSINE_OF_WORLD_UP_AXIS:
        return None
    if k == 2:
        return np.eye(3) if upward[2] > 0 else np.diag([1.0, -1.0, -1.0])
    if k == 1:  # a camera's world: y down or up
        return CAMERA_TO_BODY if upward[1] < 0 else np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    sign = 1.0 if upward[0] > 0 else -1.0
    up = sign * np.eye(3)[0]
    ahead = np.eye(3)[1]
    return np.stack([ahead, np.cross(up, ahead), up])


def rotations_of_quaternions(xyzw_quaternions: FloatArray) -> FloatArray:
    """Return rotation matrices (n, 3, 3) of quaternions x, y, z, w (n, 4) of any length; NaN for zero ones."""
    length = np.linalg.norm(xyzw_quaternions, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = (xyzw_quaternions / np.where(length > 0, length, np.nan)).T
    return rotation_matrices_of_unit_quaternions(unit)
