"""Speeds, courses, headings and yaw rates: units and senses, by the header and by the way between the positions."""

from __future__ import annotations

import math

import numpy as np

from cwcli.importing.meaning import Meaning
from cwcli.importing.motion import (
    MAX_LOG_DEVIATION_OF_SPEED_RATIO_FROM_UNIT_RATIO,
    TrackSpans,
    heading_minus_course_of_moving_spans_rad,
    spans_of_geographic_places,
    speed_ratio_spread,
    speed_units_per_mps,
    turn_rate_units_per_radps_and_correlation,
)
from cwcli.importing.names import COLUMN_WORDS_BY_QUANTITY
from cwcli.importing.places import ask_if_latitude_longitude_swapped, swapped_course_error_deg
from cwcli.importing.tables import Guess, UnitChoice
from cwcli.importing.units import FACTOR_BY_KIND_AND_UNIT
from cwcli.signals.columns import FloatArray

CANDIDATE_SPEED_UNITS = ("mps", "kmh", "mph", "knots", "cmps", "mmps")
"""Units that a speed without one can have."""
MAX_LOG_RATIO_OF_STATED_SPEED_TO_SPEED_OVER_GROUND = 0.25
"""Largest natural logarithm of the ratio of a speed in its stated unit to the speed over ground, above which is asked.
Chosen by hand."""
MIN_SPEED_RATIO_SPREAD_OF_SWAPPED_POSITIONS, MAX_SPREAD_SHARE_AFTER_SWAP = 0.02, 0.4
"""Least spread of the logarithm of the ratio of a speed to the way, and largest share of it with the places swapped,
that show a swap. Chosen by hand; not fitted."""
PERCENTILE_OF_USUAL_TOP_SPEED, MAX_NOISE_OF_SPEED_AT_REST_MPS = 90.0, 1.0
"""Percentile of a speed that tells whether a car moved, and its greatest value, m/s, at rest. Chosen by hand: receivers
at rest show tenths of a metre a second."""
MAX_ANGLE_WITHOUT_FULL_TURNS_DEG = 361.0
"""Greatest size of an angle in degrees that does not count full turns. Larger ones count turns, or are hundredths of a
degree, as MAVLink has them, or hundred thousandths, as u-blox."""
MAX_MEDIAN_ANGLE_OF_FITTING_HEADING_DEG, MIN_MEDIAN_ANGLE_OF_UNFIT_HEADING_DEG = 12.0, 25.0
"""Median angles in degrees between a heading and the direction of motion: below the first its sense fits, above the
second it does not. Chosen by hand."""
MAX_UNASKED_HEADING_OFFSET_DEG = 5.0
"""Greatest angle in degrees by which a heading may lie on one side of the direction of motion all the time. Chosen by
hand: compasses and courses of receivers are as good, and the declination of most of Europe is less."""
MAX_SCATTER_SHARE_OF_CONSTANT_HEADING_OFFSET = 1.0 / 3.0
"""Largest scatter of that angle, as a share of it, at which it is the same all the time. Chosen by hand; not fitted."""
MAX_MISFIT_DIFFERENCE_OF_EQUAL_SENSES_DEG = 3.0
"""Largest difference in degrees of the median angles of two senses that fit equally well. Chosen by hand."""
MIN_CORRELATION_TO_SHOW_YAW_RATE_SENSE = 0.5
"""Least correlation with the turning of the course that shows the sense of a yaw rate. Chosen by hand; not fitted."""
NAME_WORDS_OF_ANGLES_CLOCKWISE_FROM_NORTH = COLUMN_WORDS_BY_QUANTITY["course"].nouns | {
    "heading",
    "hdg",
    "azimuth",
    "compass",
    "headveh",
}
"""Words of angles that are clockwise from north by convention, unlike a yaw."""
MIN_HEADING_FIT_ADVANTAGE_OVER_SWAPPED_POSITIONS_DEG = 2.0
"""Least advantage in degrees with which a sense of a heading must fit better than swapped latitude and longitude.
Chosen by hand."""


def find_speed_and_unit(meaning: Meaning, track: TrackSpans | None) -> None:
    """Find the speed and its unit."""
    _split_gnss_speed(meaning)
    column = meaning.choose_column_or_ask("speed")
    if column is None:
        return
    values = meaning.numbers_in_file_unit(column)
    values = _without_unknown_minus_one(meaning, values)
    if _are_latitude_longitude_swapped(meaning, values):
        columns = [meaning.chosen[name] for name in ("latitude", "longitude")]
        meaning.add_question(
            f"{column!r} fits the way between the positions only with latitude and longitude swapped",
            f"--column latitude='{columns[1]}' --column longitude='{columns[0]}'",
        )
        return
    choice = _choose_speed_unit_or_ask(meaning, column, values, meaning.stated_unit("speed", column), track)
    if choice is not None:
        meaning.add_quantity(
            "speed", values * FACTOR_BY_KIND_AND_UNIT["speed"][choice.unit], Guess("speed", column, *choice)
        )


def _without_unknown_minus_one(meaning: Meaning, values: FloatArray) -> FloatArray:
    """Return speeds or courses without the -1 that phones write where they know none: no other value is negative."""
    is_negative = values < 0.0
    is_of_phone = meaning.table.source.kind in {"sensor logger", "phyphox", "gnsslogger"}
    if is_of_phone or (is_negative.any() and (values[is_negative] == -1.0).all()):
        return np.where(is_negative, np.nan, values)
    return values


def _are_latitude_longitude_swapped(meaning: Meaning, values: FloatArray) -> bool:
    """Tell whether a speed follows the way only if latitude and longitude are swapped: the ratio is even only then.

    A degree of longitude is shorter than one of latitude, so that the ratio changes with the direction where they are
    swapped.
    """
    if "latitude" not in meaning.values or meaning.track is None or meaning.is_decided_by_user("latitude"):
        return False
    latitude, longitude = meaning.values["latitude"], meaning.values["longitude"]
    if np.nanmax(np.abs(longitude)) > 90.0 or not meaning.track.can_show_units_and_directions:
        return False
    other = spans_of_geographic_places(meaning.stamp_ns, longitude, latitude)
    spread = [
        speed_ratio_spread(track, meaning.stamp_ns, values) for track in (meaning.track, other) if track is not None
    ]
    return (
        len(spread) == 2
        and spread[0] > MIN_SPEED_RATIO_SPREAD_OF_SWAPPED_POSITIONS
        and spread[1] < MAX_SPREAD_SHARE_AFTER_SWAP * spread[0]
    )


def _choose_speed_unit_or_ask(
    meaning: Meaning, column: str, values: FloatArray, stated: UnitChoice, track: TrackSpans | None
) -> UnitChoice | None:
    """Return the unit of a speed; None where a question is asked."""
    unit, confidence, why = stated
    ratio = speed_units_per_mps(track, meaning.stamp_ns, values)
    fitting = [
        each
        for each in CANDIDATE_SPEED_UNITS
        if ratio > 0
        and abs(math.log(ratio * FACTOR_BY_KIND_AND_UNIT["speed"][each]))
        < MAX_LOG_DEVIATION_OF_SPEED_RATIO_FROM_UNIT_RATIO
    ]
    if unit:
        if (
            ratio > 0
            and abs(math.log(ratio * FACTOR_BY_KIND_AND_UNIT["speed"][unit]))
            > MAX_LOG_RATIO_OF_STATED_SPEED_TO_SPEED_OVER_GROUND
            and confidence != "given"
        ):
            what = f"{column!r}: the header says {unit}, but the way between the positions says "
            what += fitting[0] if fitting else f"{ratio * FACTOR_BY_KIND_AND_UNIT['speed'][unit]:.2g} times less"
            meaning.add_question(
                what, f"--column speed='{column}*{fitting[0] if fitting else unit}', or --column speed= leaves it out"
            )
            return None
        agrees = ", and the way between the positions agrees" if ratio > 0 else ""
        return UnitChoice(unit, confidence, why + agrees)
    if len(fitting) == 1:
        return UnitChoice(fitting[0], "likely", f"{ratio:.3g} of it make 1 m/s between the positions")
    choices = " or ".join(f"--column speed='{column}*{each}'" for each in ("mps", "kmh", "mph"))
    if ratio > 0:
        meaning.add_question(f"{column!r} has no unit, and {ratio:.3g} of it make 1 m/s between the positions", choices)
    else:
        meaning.add_question(f"{column!r} has no unit, and no motion in the positions shows it", choices)
    return None


def _split_gnss_speed(meaning: Meaning) -> None:
    """Leave out the receiver's speed where the car has one of its own in the same table, and speeds that are 0."""
    columns = meaning.candidate_columns("speed")
    if len(columns) < 2 or meaning.is_decided_by_user("speed"):
        return
    changing = [column for column in columns if np.nan_to_num(meaning.numbers_in_file_unit(column)).any()]
    if len(changing) < len(columns) and any(_shows_motion(meaning, column) for column in changing):
        zeros = ", ".join(repr(column) for column in columns if column not in changing)
        meaning.notes.append(f"{zeros} left out: 0 everywhere, and {changing[0]!r} is not")
        meaning.table.candidates["speed"] = columns = changing
    of_receiver = [
        column
        for column in columns
        if {"gps", "gnss", "sog", "gspeed", "ground"} & set(meaning.words_of_column(column))
    ]
    others = [column for column in columns if column not in of_receiver]
    if of_receiver and len(others) == 1:
        meaning.notes.append(f"{', '.join(map(repr, of_receiver))} left out: {others[0]!r} is the speed of the car")
        meaning.table.candidates["speed"] = others


def _shows_motion(meaning: Meaning, column: str) -> bool:
    """Tell whether a speed is more than the noise of a receiver at rest; one without a unit counts as km/h."""
    factor = FACTOR_BY_KIND_AND_UNIT["speed"][meaning.stated_unit("speed", column).unit or "kmh"]
    usual_top_speed = np.nanpercentile(np.abs(meaning.numbers_in_file_unit(column)), PERCENTILE_OF_USUAL_TOP_SPEED)
    return bool(usual_top_speed * factor > MAX_NOISE_OF_SPEED_AT_REST_MPS)


def find_velocity(meaning: Meaning, track: TrackSpans | None) -> None:
    """Find the velocity to east and north."""
    east, north = meaning.choose_column_or_ask("velocity_east"), meaning.choose_column_or_ask("velocity_north")
    if east is None or north is None:
        return
    size = np.hypot(meaning.numbers_in_file_unit(east), meaning.numbers_in_file_unit(north))
    choice = _choose_speed_unit_or_ask(meaning, east, size, meaning.stated_unit("velocity_east", east), track)
    if choice is not None:
        meaning.add_scaled_quantity("velocity_east", east, choice)
        meaning.add_scaled_quantity("velocity_north", north, choice)


def find_headings(meaning: Meaning, track: TrackSpans | None) -> None:
    """Find course and heading, and their senses."""
    if _is_course_of_receiver(meaning):
        meaning.table.candidates["course"] = meaning.table.candidates.pop("heading")
        meaning.notes.append("the heading beside position and speed is taken as the course over ground")
    headings = meaning.table.candidates.get("heading", [])
    others = [column for column in headings if "theta" not in meaning.words_of_column(column)]
    if others and not meaning.is_decided_by_user("heading"):
        meaning.table.candidates["heading"] = others  # beside another heading, a theta is the pitch
    for quantity in ("course", "heading"):
        if quantity == "heading" and meaning.table.source.attitude_is_of_device:
            continue
        column = meaning.choose_column_or_ask(quantity)
        if column is not None and _may_be_no_heading(meaning, quantity, column):
            _find_heading_only_if_way_shows_it(meaning, quantity, column, track)
        elif column is not None:
            _find_heading(meaning, quantity, column, track)


def _may_be_no_heading(meaning: Meaning, quantity: str, column: str) -> bool:
    """Tell whether a column is called theta, as pitches and angles of wheels are, too, and nothing says more."""
    is_stated = meaning.is_decided_by_user(quantity) or column in meaning.table.source.presets
    return "theta" in meaning.words_of_column(column) and not is_stated


def _find_heading_only_if_way_shows_it(meaning: Meaning, quantity: str, column: str, track: TrackSpans | None) -> None:
    """Read an angle as a heading if it follows a way that turns; else leave it out, without a question."""
    n_questions = len(meaning.questions)
    if track is not None and track.can_show_units_and_directions and _does_way_turn(track):
        _find_heading(meaning, quantity, column, track)
    if quantity not in meaning.values:
        del meaning.questions[n_questions:], meaning.chosen[quantity]
        meaning.notes.append(
            f"{column!r} is left out: no way between positions shows that it is a heading; "
            f"--column {quantity}='{column}' reads it"
        )


def _is_course_of_receiver(meaning: Meaning) -> bool:
    """Tell whether the table is a receiver's: position and speed, one heading, and no attitude or inertial columns."""
    if (
        meaning.candidate_columns("course")
        or not meaning.candidate_columns("heading")
        or meaning.is_decided_by_user("heading")
    ):
        return False
    presets = {preset.quantity for preset in meaning.table.source.presets.values()}
    if (
        "latitude" not in meaning.values
        or not meaning.candidate_columns("speed")
        or presets - {"latitude", "longitude"}
    ):
        return False
    if all({"gps", "gnss"} & set(meaning.words_of_column(name)) for name in meaning.candidate_columns("heading")):
        return True
    words = {word for column in meaning.table.source.columns for word in meaning.words_of_column(column)}
    return not words & {"roll", "pitch", "yaw", "acc", "accel", "gyro", "ax", "yawrate", "qw", "acceleration"}


def _find_heading(meaning: Meaning, quantity: str, column: str, track: TrackSpans | None) -> None:
    values = meaning.numbers_in_file_unit(column)
    if quantity == "course":
        values = _without_unknown_minus_one(meaning, np.where(values < -180.0, np.nan, values))
    if float(np.nanmin(values)) == float(np.nanmax(values)) and _stands_for_no_angle(float(np.nanmax(values)), track):
        meaning.notes.append(
            f"{column!r} is left out: it is {np.nanmax(values):g} everywhere, which stands for no {quantity}"
        )
        return
    unit, sense, confidence, why = _stated_unit_sense_confidence_and_reason(meaning, quantity, column)
    size = float(np.nanmax(np.abs(values)))
    if unit:
        units = [unit]
    elif size > 2.0 * math.pi + 0.01:
        units = ["deg"] if size <= MAX_ANGLE_WITHOUT_FULL_TURNS_DEG else ["deg", "cdeg", "e5deg"]
        why = "beyond 2 pi"
    else:
        units = ["deg", "rad"]
    senses = [sense] if sense else ["cw-north", "ccw-east"]
    options = [f"{u}-{s}" for u in units for s in senses]
    default = f"{units[0]}-cw-north" if len(units) == 1 else ""
    words = set(meaning.words_of_column(column))
    if not sense and not words & NAME_WORDS_OF_ANGLES_CLOCKWISE_FROM_NORTH:
        default = ""
    fits = (
        {}
        if track is None or not track.can_show_units_and_directions
        else _median_misfit_to_course_by_sense_deg(meaning, values, options, track)
    )
    if sense and len(options) == 1:
        _add_question_if_stated_heading_sense_misfits(meaning, quantity, column, options[0], (confidence, why), fits)
        if meaning.questions and column in meaning.questions[-1].what:
            return
        _add_heading_quantity(meaning, quantity, column, values, options[0], confidence, why)
        return
    chosen = _choose_sense_with_least_misfit(fits, default)
    if chosen is None and not fits and default:
        _add_heading_quantity(
            meaning,
            quantity,
            column,
            values,
            default,
            "assumed",
            "a heading is usually clockwise from north; no motion in the positions shows it",
        )
    elif chosen is None:
        _leave_out_unfit_heading_or_ask(meaning, quantity, column, options, fits_none=bool(fits))
    else:
        assert track is not None  # it shows what fits
        may_be_swapped = bool(default) and chosen != default
        if (
            may_be_swapped and _add_question_if_swap_fits_as_well(meaning, quantity, column, fits[chosen])
        ) or _add_question_if_heading_beside_way(meaning, quantity, column, chosen, track):
            return
        _add_heading_quantity(
            meaning,
            quantity,
            column,
            values,
            chosen,
            "likely",
            f"{fits[chosen]:.1f} degrees from the way between the positions",
        )


def _leave_out_unfit_heading_or_ask(
    meaning: Meaning, quantity: str, column: str, options: list[str], *, fits_none: bool
) -> None:
    """Ask about an angle of unknown unit or sense; a yaw that fits none, beside a course, is left out."""
    if (
        fits_none
        and "course" in meaning.values
        and not set(meaning.words_of_column(column)) & NAME_WORDS_OF_ANGLES_CLOCKWISE_FROM_NORTH
    ):
        meaning.notes.append(f"{column!r} is left out: it fits no usual sense of a {quantity}, and there is a course")
        return
    what = (
        f"{column!r} fits no usual sense of a {quantity}"
        if fits_none
        else f"{column!r}: unit or sense of the angle is not known"
    )
    choices = " or ".join(f"--column {quantity}='{column}*{each}'" for each in options[:3])
    meaning.add_question(what, f"{choices}; --column {quantity}= leaves it out")


def _stands_for_no_angle(value: float, track: TrackSpans | None) -> bool:
    """Tell whether a value that a heading has everywhere is none: beyond the full circle, or 0 while the car turns."""
    if value > MAX_ANGLE_WITHOUT_FULL_TURNS_DEG:
        return True
    return value == 0.0 and track is not None and track.can_show_units_and_directions and _does_way_turn(track)


def _does_way_turn(track: TrackSpans) -> bool:
    """Tell whether the way ever turns clearly away from its mean direction."""
    course_rad = track.course_rad[track.moving_span_mask]
    mean_rad = np.angle(np.exp(1j * course_rad).sum())
    turned_deg = np.degrees(np.abs(np.angle(np.exp(1j * (course_rad - mean_rad)))))
    return bool(turned_deg.max() > MIN_MEDIAN_ANGLE_OF_UNFIT_HEADING_DEG)


def _add_question_if_heading_beside_way(
    meaning: Meaning, quantity: str, column: str, sense: str, track: TrackSpans
) -> bool:
    """Ask where a heading lies on one side of the way by the same angle all the time."""
    heading_rad = _angles_to_heading_rad(meaning.numbers_in_file_unit(column), sense)
    errors_deg = np.degrees(heading_minus_course_of_moving_spans_rad(track, meaning.stamp_ns, heading_rad))
    offset_deg = float(np.median(errors_deg))
    scatter_deg = float(np.median(np.abs(errors_deg - offset_deg)))
    if abs(
        offset_deg
    ) < MAX_UNASKED_HEADING_OFFSET_DEG or scatter_deg > MAX_SCATTER_SHARE_OF_CONSTANT_HEADING_OFFSET * abs(offset_deg):
        return False
    meaning.add_question(
        f"{column!r} points {abs(offset_deg):.0f} degrees {'left' if offset_deg > 0.0 else 'right'} of the way between "
        "the positions all the time, as from magnetic north or of a turned sensor",
        f"--column {quantity}= leaves it out; --column {quantity}='{column}*{sense}' reads it as it is",
    )
    return True


def _add_question_if_swap_fits_as_well(meaning: Meaning, quantity: str, column: str, fit_deg: float) -> bool:
    """Ask where swapped latitude and longitude explain a course as well as an unusual sense of its angle."""
    if "latitude" not in meaning.values:
        return False
    swapped_deg = swapped_course_error_deg(meaning, meaning.numbers_in_file_unit(column))
    if not swapped_deg < fit_deg + MIN_HEADING_FIT_ADVANTAGE_OVER_SWAPPED_POSITIONS_DEG:
        return False
    columns = [meaning.chosen[name] for name in ("latitude", "longitude")]
    meaning.add_question(
        f"{column!r} fits the positions only counter-clockwise from east, or with latitude and longitude swapped",
        f"--column {quantity}='{column}*deg-ccw-east', or "
        f"--column latitude='{columns[1]}' --column longitude='{columns[0]}'",
    )
    return True


def _stated_unit_sense_confidence_and_reason(meaning: Meaning, quantity: str, column: str) -> tuple[str, str, str, str]:
    """Return unit, sense, confidence and reason, "" for what neither user, format nor header says."""
    column_and_unit = meaning.answers.column_and_unit_for(meaning.table.source, quantity)
    text = column_and_unit[1] if column_and_unit is not None and column_and_unit[0] == column else ""
    confidence, why = ("given", "as you said") if text else ("certain", "the format says it")
    if not text:
        preset = meaning.table.source.presets.get(column)
        text = preset.unit if preset is not None else ""
    if "-" in text:
        unit, _, sense = text.partition("-")
        return unit, sense, confidence, why
    unit, confidence, why = meaning.stated_unit(quantity, column)
    return unit, "", confidence, why


def _median_misfit_to_course_by_sense_deg(
    meaning: Meaning, values: FloatArray, units_and_senses: list[str], track: TrackSpans
) -> dict[str, float]:
    """Return the median angle to the way, degrees, of each sense; {} where the track can't tell."""
    fits = {}
    for option in units_and_senses:
        errors = heading_minus_course_of_moving_spans_rad(
            track, meaning.stamp_ns, _angles_to_heading_rad(values, option)
        )
        if len(errors) >= 10:
            fits[option] = float(np.degrees(np.median(np.abs(errors))))
    return fits


def _choose_sense_with_least_misfit(misfit_deg_by_sense: dict[str, float], usual_sense: str) -> str | None:
    """Return the sense that fits; the usual one where it fits as well as the best."""
    if not misfit_deg_by_sense:
        return None
    best = min(misfit_deg_by_sense, key=lambda each: misfit_deg_by_sense[each])
    if misfit_deg_by_sense[best] > MIN_MEDIAN_ANGLE_OF_UNFIT_HEADING_DEG:
        return None
    if usual_sense in misfit_deg_by_sense and misfit_deg_by_sense[usual_sense] <= max(
        misfit_deg_by_sense[best] + MAX_MISFIT_DIFFERENCE_OF_EQUAL_SENSES_DEG,
        min(MAX_MEDIAN_ANGLE_OF_FITTING_HEADING_DEG, misfit_deg_by_sense[best] * 1.5),
    ):
        return usual_sense
    rivals = [
        each
        for each in misfit_deg_by_sense
        if each != best
        and misfit_deg_by_sense[each] < misfit_deg_by_sense[best] + MAX_MISFIT_DIFFERENCE_OF_EQUAL_SENSES_DEG
    ]
    return None if rivals else best


def _add_question_if_stated_heading_sense_misfits(
    meaning: Meaning,
    quantity: str,
    column: str,
    unit_and_sense: str,
    confidence_and_reason: tuple[str, str],
    misfit_deg_by_sense: dict[str, float],
) -> None:
    if (
        confidence_and_reason[0] == "given"
        or not misfit_deg_by_sense
        or misfit_deg_by_sense[unit_and_sense] < 2.0 * MIN_MEDIAN_ANGLE_OF_UNFIT_HEADING_DEG
    ):
        return
    meaning.add_question(
        f"{column!r} is {misfit_deg_by_sense[unit_and_sense]:.0f} degrees from the way between the positions",
        f"--column {quantity}='{column}*{unit_and_sense}' if it is right, --column {quantity}= leaves it out",
    )


def _add_heading_quantity(
    meaning: Meaning, quantity: str, column: str, values: FloatArray, unit_and_sense: str, confidence: str, why: str
) -> None:
    meaning.add_quantity(
        quantity,
        _angles_to_heading_rad(values, unit_and_sense),
        Guess(quantity, column, unit_and_sense, confidence, why),
    )
    if unit_and_sense == "deg-cw-north":
        ask_if_latitude_longitude_swapped(meaning, values)


def _angles_to_heading_rad(values: FloatArray, unit_and_sense: str) -> FloatArray:
    """Return angles as rad counter-clockwise from east."""
    unit, _, sense = unit_and_sense.partition("-")
    angle = values * FACTOR_BY_KIND_AND_UNIT["angle"][unit]
    return 0.5 * math.pi - angle if sense == "cw-north" else angle


def find_yaw_rate(meaning: Meaning, track: TrackSpans | None) -> None:
    """Find a yaw rate, its unit and its sense; a turn rate about z alone is one where the course turns with it."""
    column = meaning.choose_column_or_ask("yaw_rate")
    is_lonely = column is None and not meaning.questions and not meaning.candidate_columns("gyro_x")
    if is_lonely:
        column = meaning.choose_column_or_ask("gyro_z")
    if column is None:
        return
    values = meaning.numbers_in_file_unit(column)
    unit, confidence, why = meaning.stated_unit("gyro_z" if is_lonely else "yaw_rate", column)
    ratio, correlation = turn_rate_units_per_radps_and_correlation(track, meaning.stamp_ns, values)
    is_shown = abs(correlation) > MIN_CORRELATION_TO_SHOW_YAW_RATE_SENSE
    if not unit and is_shown:
        fitting = [
            each
            for each in ("radps", "degps")
            if abs(math.log(abs(ratio) * FACTOR_BY_KIND_AND_UNIT["turn rate"][each])) < 0.5
        ]
        if fitting:
            unit, confidence, why = fitting[0], "likely", f"{abs(ratio):.3g} of it make 1 rad/s of the course"
    if is_lonely and not (is_shown and unit):
        meaning.notes.append(
            f"{column!r} is left out: no turn of the course shows its unit and sense (--column "
            f"yaw_rate='{column}*degps', or '{column}*radps', if left is positive)"
        )
        return
    if not unit:
        meaning.add_question(
            f"{column!r}: the unit of the turn rate is not known",
            f"--column yaw_rate='{column}*radps' or '{column}*degps'",
        )
        return
    factor = FACTOR_BY_KIND_AND_UNIT["turn rate"][unit]
    if confidence == "given" or meaning.table.source.presets.get(column):
        sense = 1.0
    elif is_shown:
        sense = 1.0 if ratio > 0 else -1.0
        why += f"; {'left' if sense > 0 else 'right'} is positive, as the course says"
    else:
        sense, confidence = 1.0, "assumed"
        why += "; left is positive in most systems, and no turn of the course shows it"
    meaning.add_quantity(
        "yaw_rate",
        sense * factor * values,
        Guess("yaw_rate", column, unit if sense > 0 else f"-{unit}", confidence, why),
    )
