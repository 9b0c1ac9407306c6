"""Inertial columns: units by gravity and by the turning of the course, and the axes of the car.

An IMU that stands upright (gravity along its z axis) is taken as mounted with x forward unless the speed shows another
direction. A phone lies in any direction: gravity gives its vertical, and the changes of speed and course give forward;
where they do not, only its turn rate about the vertical is used.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.importing.meaning import Meaning
from cwcli.importing.motion import TrackSpans, mean_over_spans, turn_rate_units_per_radps_and_correlation
from cwcli.importing.tables import UNKNOWN_UNIT, Guess, UnitChoice
from cwcli.importing.units import FACTOR_BY_KIND_AND_UNIT
from cwcli.signals.columns import FloatArray
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.units import NS_PER_S, STANDARD_GRAVITY_MPS2

ComplexArray = npt.NDArray[np.complex128]
"""Horizontal vectors as complex numbers: forward and left, or x and y of a level sensor."""

MAX_RELATIVE_GRAVITY_ERROR_OF_UNIT = 0.2
"""Largest relative deviation of the mean acceleration from 9.81 m/s^2 at which a unit is accepted. Chosen by hand; not
fitted."""
MAX_CAR_TURN_RATE_RADPS = 1.5
"""Greatest turn rate of a car, rad/s (86 degrees/s); larger numbers are degrees. Chosen by hand."""
MIN_CORRELATION_TO_SHOW_AXIS = 0.5
"""Least correlation that shows the sense of a turn rate, or forward. Chosen by hand; not fitted."""
MIN_GRAVITY_COSINE_OF_VERTICAL_AXIS = 0.94
"""Least cosine between gravity and an axis of the sensor that counts as vertical: that of 20 degrees. Chosen by
hand."""
MAX_INTERPOLATED_ACCEL_GAP_S = 0.25
"""Longest time in s between two accelerations across which they are interpolated to the stamps of the turn rates.
Chosen by hand."""
MIN_ACCEL_SCATTER_TO_REFUTE_AXES_MPS2 = 0.3
"""Least scatter of accelerations in m/s^2 that must follow speed and course for the axes to be right. Chosen by hand:
three times the noise of an IMU of phones."""
MIN_CORRELATION_TO_SHOW_ACCEL_UNIT = 0.7
"""Least correlation of accelerations with those of the track that shows their unit. Chosen by hand."""
MAX_LOG_RATIO_OF_ACCEL_UNIT = 0.5
"""Largest natural logarithm of the ratio of accelerations to those of the track at which a unit is accepted. Chosen by
hand; g and m/s^2 differ by 2.3."""
MIN_ADVANTAGE_OF_MIRRORED_AXES = 0.05
"""Least advantage of the correlation of mirrored accelerations with the way, without turn rates that show the sense.
Chosen by hand."""
MIN_SPANS_TO_COMPARE_ACCELERATIONS = 10
"""Least number of spans of a track whose accelerations are compared with those of a sensor. Chosen by hand."""
MIN_CORRECTED_MOUNTING_YAW_RAD = 0.44
"""Least angle in rad, 25 degrees, by which an IMU is turned about its vertical for the turn to be corrected. Chosen by
hand."""


def find_accelerations_and_turn_rates(meaning: Meaning, track: TrackSpans | None, other: Meaning | None = None) -> None:
    """Find accelerations and turn rates in m/s^2 and rad/s, and turn them into the axes of the car.

    Args:
        other: A table with the accelerations of the same device, whose turn rates are in the first one.
    """
    specific_force = _read_si_vector_in_sensor_axes(meaning, "accel", track)
    turn_rate = _read_si_vector_in_sensor_axes(meaning, "gyro", track, specific_force)
    if other is not None and specific_force is None and turn_rate is not None:
        specific_force = _read_si_vector_in_sensor_axes(other, "accel", track)
        if specific_force is not None:
            specific_force = _accelerations_at_turn_rate_stamps(meaning, other, specific_force)
    if meaning.questions or (specific_force is None and turn_rate is None):
        return
    _rotate_into_car_axes_and_store(meaning, specific_force, turn_rate, track)


def acceleration_table_by_turn_rate_table(meanings: Sequence[Meaning]) -> dict[str, Meaning]:
    """Return by name of a table with turn rates alone the table with the accelerations of the same device.

    Phones write a table each. Where there is one of each kind, they belong together.
    """
    lonely = {
        name: [
            each
            for each in meanings
            if each.candidate_columns(f"{name}_x") and not each.candidate_columns(f"{without}_x")
        ]
        for name, without in (("accel", "gyro"), ("gyro", "accel"))
    }
    if any(len(tables) != 1 for tables in lonely.values()):
        return {}
    accel, gyro = lonely["accel"][0], lonely["gyro"][0]
    return {gyro.name: accel} if accel.since == gyro.since else {}


def _read_si_vector_in_sensor_axes(
    meaning: Meaning, accel_or_gyro: str, track: TrackSpans | None, specific_force: FloatArray | None = None
) -> FloatArray | None:
    """Return accelerations or turn rates in SI and the sensor's axes (n, 3); None without, or behind a question.

    Args:
        specific_force: Accelerations beside the turn rates, (n, 3) in the sensor's axes, which show its vertical.
    """
    columns = _choose_axis_columns(meaning, accel_or_gyro)
    if columns is None or meaning.questions:
        return None
    values = np.stack([meaning.numbers_in_file_unit(column) for column in columns], axis=1)
    if accel_or_gyro == "accel" and meaning.table.source.has_accelerations_of_other_sign:
        values = -values
    if accel_or_gyro == "accel":
        kind, choice = "acceleration", _choose_accel_unit_or_ask(meaning, columns, values, track)
    else:
        kind, choice = "turn rate", _choose_gyro_unit_or_ask(meaning, columns, values, track, specific_force)
    if not choice.unit:
        return None
    for axis, column in zip("xyz", columns, strict=True):
        meaning.guesses.append(Guess(f"{accel_or_gyro}_{axis}", column, *choice))
    return values * FACTOR_BY_KIND_AND_UNIT[kind][choice.unit]


def _accelerations_at_turn_rate_stamps(meaning: Meaning, other: Meaning, specific_force: FloatArray) -> FloatArray:
    """Return accelerations at the stamps of the turn rates: straight lines between rows, NaN in gaps."""
    meaning.notes.append(f"accelerations of {other.name} are interpolated to its stamps")
    return interpolate_signal_at_times(
        other.stamp_ns, specific_force, meaning.stamp_ns, max_gap_s=MAX_INTERPOLATED_ACCEL_GAP_S
    )


def _choose_axis_columns(meaning: Meaning, name: str) -> list[str] | None:
    """Return the columns of x, y and z; raw accelerations where those without gravity are there, too."""
    quantities = [f"{name}_{axis}" for axis in "xyz"]
    for quantity in quantities:
        columns = meaning.candidate_columns(quantity)
        if len(columns) > 1 and not meaning.is_decided_by_user(quantity):
            whole = [
                column
                for column in columns
                if not {"linear", "user", "calibrated"} & set(meaning.words_of_column(column))
            ]
            meaning.table.candidates[quantity] = whole or columns
    chosen = [meaning.choose_column_or_ask(quantity) for quantity in quantities]
    return [column for column in chosen if column is not None] if all(chosen) else None


def _choose_accel_unit_or_ask(
    meaning: Meaning, columns: list[str], values: FloatArray, track: TrackSpans | None
) -> UnitChoice:
    stated = meaning.stated_unit("accel_x", columns[0])
    norm = float(np.nanmedian(np.sqrt((values**2).sum(axis=1))))
    fitting = [
        each
        for each, factor in FACTOR_BY_KIND_AND_UNIT["acceleration"].items()
        if abs(norm * factor / STANDARD_GRAVITY_MPS2 - 1.0) < MAX_RELATIVE_GRAVITY_ERROR_OF_UNIT
    ]
    if stated.unit:
        if fitting and stated.unit not in fitting and stated.confidence != "given":
            meaning.add_question(
                f"{columns[0]!r}: the header says {stated.unit}, but gravity is {norm:.3g}, as in {fitting[0]}",
                " ".join(
                    f"--column accel_{axis}='{column}*{fitting[0]}'"
                    for axis, column in zip("xyz", columns, strict=True)
                ),
            )
            return UNKNOWN_UNIT
        return stated
    if fitting:
        return UnitChoice(fitting[0], "likely", f"gravity is {norm:.3g} of it")
    pair = _horizontal_accelerations_of_track_and_sensor_or_none(meaning, values, track)
    fits = [] if pair is None else [abs(complex_correlation(pair[0], each)) for each in (pair[1], pair[1].conj())]
    if (
        pair is not None
        and max(fits) > MIN_CORRELATION_TO_SHOW_ACCEL_UNIT
        and not _does_z_follow_way(meaning, values, track)
    ):
        ratio = float(pair[1].std() / pair[0].std())
        for each in ("mps2", "g"):
            if abs(math.log(ratio * FACTOR_BY_KIND_AND_UNIT["acceleration"][each])) < MAX_LOG_RATIO_OF_ACCEL_UNIT:
                return UnitChoice(each, "likely", f"{ratio:.3g} of it make 1 m/s^2 between the positions")
    meaning.add_question(
        f"{columns[0]!r} has no unit, and its size ({norm:.3g}) is not that of gravity",
        " ".join(f"--column accel_{axis}='{column}*mps2'" for axis, column in zip("xyz", columns, strict=True))
        + ", or *g; --column accel_x= leaves them out",
    )
    return UNKNOWN_UNIT


def _does_z_follow_way(meaning: Meaning, values: FloatArray, track: TrackSpans | None) -> bool:
    """Tell whether the accelerations along z are those along or across the way: the sensor does not stand upright."""
    pair = _horizontal_accelerations_of_track_and_sensor_or_none(meaning, values[:, [2, 2]] * [1.0, 0.0], track)
    if pair is None or not pair[1].real.any():
        return False
    fits = (abs(float(np.corrcoef(pair[1].real, part)[0, 1])) for part in (pair[0].real, pair[0].imag))
    return max(fits) > MIN_CORRELATION_TO_SHOW_AXIS


def _choose_gyro_unit_or_ask(
    meaning: Meaning,
    columns: list[str],
    values: FloatArray,
    track: TrackSpans | None,
    specific_force: FloatArray | None,
) -> UnitChoice:
    stated = meaning.stated_unit("gyro_x", columns[0])
    if stated.unit:
        return stated
    size = float(np.nanpercentile(np.abs(values), 99.9))
    if size > MAX_CAR_TURN_RATE_RADPS:
        return UnitChoice("degps", "likely", f"values up to {size:.3g} are beyond any car in rad/s")
    axes = np.eye(3)
    if specific_force is not None:
        upward = np.nanmean(specific_force, axis=0)
        if float(np.linalg.norm(upward)) > 0.5 * STANDARD_GRAVITY_MPS2:
            axes = upward[np.newaxis] / np.linalg.norm(upward)
    best = max(
        (turn_rate_units_per_radps_and_correlation(track, meaning.stamp_ns, values @ axis) for axis in axes),
        key=lambda each: abs(each[1]),
    )
    if abs(best[1]) > MIN_CORRELATION_TO_SHOW_AXIS:
        for each in ("radps", "degps"):
            if 0.6 < abs(best[0]) * FACTOR_BY_KIND_AND_UNIT["turn rate"][each] < 1.6:
                return UnitChoice(each, "likely", f"{abs(best[0]):.3g} of it make 1 rad/s of the course")
    meaning.add_question(
        f"{columns[0]!r} has no unit, and its size ({size:.3g}) fits rad/s and deg/s",
        " ".join(f"--column gyro_{axis}='{column}*degps'" for axis, column in zip("xyz", columns, strict=True))
        + ", or *radps",
    )
    return UNKNOWN_UNIT


def _rotate_into_car_axes_and_store(
    meaning: Meaning, specific_force: FloatArray | None, turn_rate: FloatArray | None, track: TrackSpans | None
) -> None:
    """Turn both vectors into x forward, y left, z up; leave out what can't be turned."""
    rotation = car_from_sensor_rotation_by_user_or_none(meaning)
    if rotation is None:
        level = _levelling_rotation_and_if_x_is_forward(meaning, specific_force, turn_rate, track)
        if level is None:
            return
        rotation, knows_forward = level
        rotation, specific_force, turn_rate = _with_signs_of_course(
            meaning, rotation, (specific_force, turn_rate), track, knows_forward=knows_forward
        )
        if meaning.questions:
            return
        rotation, knows_forward = _turn_rotation_forward_and_tell_if_known(
            meaning, rotation, specific_force, track, knows_forward
        )
        if not knows_forward and specific_force is not None:
            meaning.notes.append(
                "accelerations are left out: nothing shows which way the device points (--axes FORWARD,UP)"
            )
            specific_force = None
            if turn_rate is not None:
                turn_rate = turn_rate @ rotation.T
                turn_rate = turn_rate * np.array([0.0, 0.0, 1.0])
                meaning.notes.append("of the turn rates only the one about the vertical is used")
                _store_imu_quantities(meaning, None, turn_rate)
            return
    _store_imu_quantities(
        meaning,
        None if specific_force is None else specific_force @ rotation.T,
        None if turn_rate is None else turn_rate @ rotation.T,
    )


def _store_imu_quantities(meaning: Meaning, specific_force: FloatArray | None, turn_rate: FloatArray | None) -> None:
    for name, values in (("accel", specific_force), ("gyro", turn_rate)):
        for k, axis in enumerate("xyz") if values is not None else ():
            assert values is not None
            meaning.values[f"{name}_{axis}"] = values[:, k]


def car_from_sensor_rotation_by_user_or_none(meaning: Meaning) -> FloatArray | None:
    """Return the rotation of `--axes FORWARD,UP`; None where it is not given."""
    text = meaning.answers.axes
    if not text:
        return None
    forward, _, up = text.partition(",")
    rows = [_unit_vector_of_axis_or_none(forward.strip()), _unit_vector_of_axis_or_none(up.strip())]
    if any(row is None for row in rows) or abs(float(rows[0] @ rows[1])) > 0.5:  # type: ignore[operator]
        meaning.add_question(
            f"--axes {text}: it is not a pair of axes", "--axes x,z or --axes -y,z: the sensor's axes forward and up"
        )
        return None
    ahead, upward = rows
    assert ahead is not None
    assert upward is not None
    return np.stack([ahead, np.cross(upward, ahead), upward])


def _unit_vector_of_axis_or_none(text: str) -> FloatArray | None:
    sign = -1.0 if text.startswith("-") else 1.0
    name = text.lstrip("+-")
    return sign * np.eye(3)["xyz".index(name)] if name in {"x", "y", "z"} else None


def _levelling_rotation_and_if_x_is_forward(
    meaning: Meaning, specific_force: FloatArray | None, turn_rate: FloatArray | None, track: TrackSpans | None
) -> tuple[FloatArray, bool] | None:
    """Return the rotation that makes gravity point along z, and whether x is then forward; None if neither is known."""
    is_device = meaning.table.source.is_device_frame
    if specific_force is None and is_device:
        meaning.notes.append("turn rates are left out: without accelerations nothing shows the device's vertical")
        return None
    if specific_force is None:
        return _rotation_of_axis_turning_with_course(meaning, turn_rate, track), True
    mean = np.nanmean(specific_force, axis=0)
    size = float(np.linalg.norm(mean))
    if size < 0.5 * STANDARD_GRAVITY_MPS2:
        if is_device:
            meaning.notes.append("the accelerations are without gravity: nothing shows the device's vertical; left out")
            return None
        meaning.notes.append("the accelerations are without gravity; the axes are taken as x forward, z up")
        return np.eye(3), True
    upward = mean / size
    return _gravity_rotation_and_if_x_is_forward(meaning, upward)


def _rotation_of_axis_turning_with_course(
    meaning: Meaning, turn_rate: FloatArray | None, track: TrackSpans | None
) -> FloatArray:
    """Return the rotation that makes the axis vertical whose turn rate is that of the course; z where none shows it."""
    if turn_rate is None:
        return np.eye(3)
    fits = [turn_rate_units_per_radps_and_correlation(track, meaning.stamp_ns, turn_rate[:, k])[1] for k in range(3)]
    best = int(np.argmax(np.abs(fits)))
    if best == 2 or abs(fits[best]) < MIN_CORRELATION_TO_SHOW_AXIS or abs(fits[2]) > MIN_CORRELATION_TO_SHOW_AXIS:
        return np.eye(3)
    meaning.notes.append(f"the course turns with the turn rate about {'xyz'[best]}: that axis is taken as vertical")
    return _rotation_turning_vector_to_z(np.sign(fits[best]) * np.eye(3)[best])


def _gravity_rotation_and_if_x_is_forward(meaning: Meaning, upward: FloatArray) -> tuple[FloatArray, bool]:
    """Return the rotation for a unit vector of gravity, and whether x is then forward."""
    if abs(upward[2]) <= MIN_GRAVITY_COSINE_OF_VERTICAL_AXIS or meaning.table.source.is_device_frame:
        return _rotation_turning_vector_to_z(upward), False
    if upward[2] > 0:
        return np.eye(3), True
    meaning.notes.append("gravity points up along z: the axes are taken as x forward, y right, z down")
    return np.diag([1.0, -1.0, -1.0]), True


def _rotation_turning_vector_to_z(upward: FloatArray) -> FloatArray:
    """Return the smallest rotation (3, 3) that turns a unit vector to z."""
    axis = np.cross(upward, [0.0, 0.0, 1.0])
    cosine = float(upward[2])
    if np.linalg.norm(axis) < 1e-9:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + cosine))


def _with_signs_of_course(
    meaning: Meaning,
    rotation: FloatArray,
    measured: tuple[FloatArray | None, FloatArray | None],
    track: TrackSpans | None,
    *,
    knows_forward: bool,
) -> tuple[FloatArray, FloatArray | None, FloatArray | None]:
    """Return the rotation, the specific force and the turn rate, with the signs that fit the course.

    Where the course turns the other way than the turn rate, the accelerations have the other sign, as Apple's phones
    have them, or of the vertical one alone; or the turn rates have. The accelerations along and across the way show
    which, also where there are no turn rates: only in the first case they are mirrored.
    """
    specific_force, turn_rate = measured
    as_is, mirrored = _correlations_with_way_as_is_and_mirrored(meaning, rotation, specific_force, track)
    turns = [0.0, 0.0]
    if turn_rate is not None:
        turns[:] = turn_rate_units_per_radps_and_correlation(track, meaning.stamp_ns, turn_rate @ rotation[2])
    if abs(turns[1]) <= MIN_CORRELATION_TO_SHOW_AXIS:
        is_mirrored = abs(mirrored) > max(abs(as_is) + MIN_ADVANTAGE_OF_MIRRORED_AXES, MIN_CORRELATION_TO_SHOW_AXIS)
        if not is_mirrored and turn_rate is not None and rotation[2, 2] < 0 and not np.allclose(rotation, np.eye(3)):
            meaning.add_question(
                "gravity points up along z, and no turn of the course shows which side of the sensor is up",
                "--axes x,-z if z is down, --axes x,z if z is up",
            )
    else:
        is_mirrored = turns[0] < 0 and abs(mirrored) >= abs(as_is)
    if turns[0] < 0 and not is_mirrored and turn_rate is not None and abs(turns[1]) > MIN_CORRELATION_TO_SHOW_AXIS:
        meaning.notes.append("the course turns the other way than the turn rates say: their signs are exchanged")
        return rotation, specific_force, -turn_rate
    if not is_mirrored:
        return rotation, specific_force, turn_rate
    flipped = np.diag([1.0, -1.0, -1.0]) @ rotation
    meaning.notes.append("the course turns the other way than the axes say: up and down are exchanged")
    if specific_force is None:
        return flipped, None, turn_rate
    if not knows_forward or mirrored.real < 0.0:
        return flipped, -specific_force, turn_rate
    upward = rotation[2]
    has_gravity = np.nanmean(specific_force @ upward) > 0.5 * STANDARD_GRAVITY_MPS2
    vertical = np.outer(specific_force @ upward, upward) if has_gravity else 0.0
    return flipped, specific_force - 2.0 * vertical, turn_rate


def _correlations_with_way_as_is_and_mirrored(
    meaning: Meaning, rotation: FloatArray, specific_force: FloatArray | None, track: TrackSpans | None
) -> tuple[complex, complex]:
    """Return how the horizontal accelerations fit those of the track, as they are and mirrored; 0 where unknown."""
    pair = (
        None
        if specific_force is None
        else _horizontal_accelerations_of_track_and_sensor_or_none(meaning, specific_force @ rotation.T, track)
    )
    return (0j, 0j) if pair is None else (complex_correlation(*pair), complex_correlation(pair[0], pair[1].conj()))


def complex_correlation(first: ComplexArray, second: ComplexArray) -> complex:
    """Return the correlation of horizontal vectors (n,): its size, and the turn from the second to the first; or 0."""
    strength = float(np.sqrt((np.abs(first) ** 2).sum() * (np.abs(second) ** 2).sum()))
    return complex((first * np.conj(second)).sum()) / strength if strength > 0.0 else 0j


def _horizontal_accelerations_of_track_and_sensor_or_none(
    meaning: Meaning, level: FloatArray, track: TrackSpans | None
) -> tuple[ComplexArray, ComplexArray] | None:
    """Return the horizontal accelerations that the track shows and those of the sensor, means removed, both (m,).

    Args:
        level: Specific force (n, 3) with z up.
    """
    if track is None or not track.can_show_units_and_directions:
        return None
    along = _forward_left_accelerations_of_track_or_nan(track)
    middle = track.span_middles_ns
    spans = TrackSpans(middle[:-1], middle[1:], np.ones(len(middle) - 1), np.zeros(len(middle) - 1))
    mean_level_accel = mean_over_spans(spans, meaning.stamp_ns, level[:, 0]) + 1j * mean_over_spans(
        spans, meaning.stamp_ns, level[:, 1]
    )
    use = np.isfinite(along) & np.isfinite(mean_level_accel)
    if np.count_nonzero(use) < MIN_SPANS_TO_COMPARE_ACCELERATIONS:
        return None
    return along[use] - along[use].mean(), mean_level_accel[use] - mean_level_accel[use].mean()


def _turn_rotation_forward_and_tell_if_known(
    meaning: Meaning,
    rotation: FloatArray,
    specific_force: FloatArray | None,
    track: TrackSpans | None,
    knows_forward: bool,
) -> tuple[FloatArray, bool]:
    """Return the rotation turned about the vertical as the changes of speed and course show, and whether they do."""
    pair = (
        None
        if specific_force is None
        else _horizontal_accelerations_of_track_and_sensor_or_none(meaning, specific_force @ rotation.T, track)
    )
    if pair is None:
        return rotation, knows_forward
    both = complex_correlation(*pair)
    if abs(both) < MIN_CORRELATION_TO_SHOW_AXIS:
        is_shown = min(pair[0].std(), pair[1].std()) > MIN_ACCEL_SCATTER_TO_REFUTE_AXES_MPS2
        return rotation, knows_forward and not is_shown
    angle = float(np.angle(both))
    if knows_forward and abs(angle) < MIN_CORRECTED_MOUNTING_YAW_RAD:
        return rotation, True
    turned = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    meaning.notes.append(
        f"inertial axes are turned by {np.degrees(angle):.0f} deg about the vertical, "
        f"as speed and course show (correlation {abs(both):.2f})"
    )
    return turned @ rotation, True


def _forward_left_accelerations_of_track_or_nan(track: TrackSpans) -> ComplexArray:
    """Return acceleration forward (real) and to the left (imaginary) between neighbouring spans, NaN elsewhere."""
    speed, course = track.speed_mps, track.course_rad
    step_s = np.diff(track.span_middles_ns) / NS_PER_S
    turn_rate = np.angle(np.exp(1j * np.diff(course)))
    mean_speed = 0.5 * (speed[1:] + speed[:-1])
    found = (np.diff(speed) + 1j * mean_speed * turn_rate) / step_s
    sound = (track.start_ns[1:] == track.end_ns[:-1]) & track.moving_span_mask[1:] & track.moving_span_mask[:-1]
    return np.where(sound, found, np.nan + 0j)
