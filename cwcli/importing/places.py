"""Positions of a table: latitude and longitude, or x and y; which vehicle, and which rows are new."""

from __future__ import annotations

import numpy as np

from cwcli.errors import DataError
from cwcli.importing.cells import distinct_names_and_row_indices
from cwcli.importing.meaning import Meaning
from cwcli.importing.motion import (
    METRES_PER_DEGREE_OF_LATITUDE,
    heading_minus_course_of_moving_spans_rad,
    spans_of_geographic_places,
    spans_of_map_points,
)
from cwcli.importing.tables import UNKNOWN_UNIT, Guess, UnitChoice
from cwcli.importing.units import FACTOR_BY_KIND_AND_UNIT
from cwcli.importing.utm import geographic_of_utm_deg, parse_utm_zone_or_none
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S
from cwcli.text import format_count

MAX_LATITUDE_DEG, MAX_LONGITUDE_DEG = 90.0, 180.0
"""Greatest size of a latitude and a longitude."""
MAX_SHARE_OF_DAMAGED_PLACES = 0.05
"""Largest share of rows whose place is no place on Earth that are taken for damaged rows. Chosen by hand: in another
unit, or with latitude and longitude exchanged, nearly all rows are such."""
MIN_DEGREES_BEYOND_RANGE_OF_DAMAGED_PLACE = 1.0
"""Degrees beyond 90 or 180 from which a place is damaged. A drive over a line of 90 or 180 degrees with latitude and
longitude exchanged, or counted up to 360, goes a little beyond."""
UNAVAILABLE_PLACES_DEG = ((91.0, 181.0), (90.0000001, 180.0000001))
"""Latitude and longitude that stand for no position: in AIS (ITU-R M.1371) and the radio of ETSI and SAE (TS 102 894-2,
J2735: 900000001 and 1800000001)."""
MAX_ROAD_LATITUDE_DEG = 75.0
"""Greatest size of the latitude of a road. The northernmost, at the North Cape, lies at 71."""
MAX_DEGREES_THAT_MAY_BE_RADIANS = 3.15
"""Size of latitudes and longitudes, degrees, below which they may be radians: a little more than pi."""
MAX_PATH_LENGTH_RATIO_OF_ROW_STEPS_TO_SECOND_STEPS = 1.5
"""Largest ratio of the path length from row to row to that from second to second at which x and y are those of a car.
Chosen by hand."""
MAX_ROAD_ALTITUDE_M = 9000.0
"""Greatest altitude of a road, m; larger numbers are in another unit. No public road lies above 6,000 m."""
MIN_GRID_COORDINATE_M = 100_000.0
"""Size of x or y, m, from which they count from the origin of a national or UTM grid, not from a place of the drive.
Chosen by hand: a square of MGRS, which local frames count in, is as long."""
MIN_XY_EXTENT_OF_METRES_M = 0.5
"""Least extent of x and y, m, within a minute or more; columns of a smaller one may hold degrees. Chosen by hand."""
MAX_COURSE_ERROR_OF_SWAPPED_POSITIONS_DEG, MIN_COURSE_ERROR_OF_UNSWAPPED_POSITIONS_DEG = 10.0, 30.0
"""Median angles to the stated course, with latitude and longitude swapped and as they are, that show a swap. Chosen by
hand; not fitted."""
MIN_MOVING_SPANS_TO_COMPARE_ANGLES = 10
"""Least number of spans in motion for a comparison of angles. Chosen by hand; not fitted."""
MAX_STEP_SPEED_MPS, MIN_JUMP_M = 150.0, 100.0
"""Speed in m/s and way in m beyond which the step to the next position is a jump. Chosen by hand: faster than cars, and
more than a receiver's reflections."""
MAX_JUMP_SHARE_OF_ONE_TRACK = 0.2
"""Largest share of jumps in a track of one vehicle. Chosen by hand: two tracks in turns have a half or more, and
a receiver with bad view has single ones."""
MAX_TRACK_NAMES = 100
"""Largest number of different texts in a column that may name the tracks. Chosen by hand."""
MIN_REPEATED_SHARE_OF_HELD_POSITION = 0.3
"""Least share of rows that repeat the position before for the position to be one that is held between fixes. Chosen by
hand; not fitted."""


def keep_rows_of_one_vehicle(meaning: Meaning) -> None:
    """Keep the rows of one vehicle, where a table holds several; ask which one."""
    table = meaning.table
    if not (meaning.candidate_columns("latitude") or meaning.candidate_columns("x")):
        return
    for column in table.candidates.get("vehicle_id", ()):
        if column not in table.codes:
            continue
        codes, names = table.codes[column]
        codes = codes[meaning.rows]
        present = [names[code] for code in np.unique(codes)]
        if len(present) < 2 or len(present) > 0.5 * len(codes):
            continue
        wanted_vehicle = meaning.answers.vehicle
        if wanted_vehicle in present:
            keep = codes == names.index(wanted_vehicle)
            meaning.rows, meaning.stamp_ns = meaning.rows[keep], meaning.stamp_ns[keep]
            meaning.notes.append(f"only the rows with {column} {wanted_vehicle}, of {len(present)}")
        else:
            shown = ", ".join(present[:10]) + (f" and {len(present) - 10} more" if len(present) > 10 else "")
            meaning.add_question(f"{column!r} names {len(present)} vehicles: {shown}", f"--id {present[0]}")


def find_positions_and_track(meaning: Meaning) -> None:
    """Find latitude and longitude, else x and y; and the track of both."""
    latitude, longitude = meaning.choose_column_or_ask("latitude"), meaning.choose_column_or_ask("longitude")
    if (latitude is None) != (longitude is None) and not meaning.questions:
        single_column = latitude or longitude
        meaning.add_question(f"{single_column!r} has no companion", "--column latitude=NAME --column longitude=NAME")
        return
    if latitude is not None and longitude is not None:
        _find_geographic_positions(meaning, latitude, longitude)
        _find_altitude(meaning)
        return
    if not meaning.questions:
        _find_local_positions(meaning)


def _find_geographic_positions(meaning: Meaning, latitude: str, longitude: str) -> None:
    values = {"latitude": meaning.numbers_in_file_unit(latitude), "longitude": meaning.numbers_in_file_unit(longitude)}
    _drop_damaged_places(meaning, values)
    _require_position(meaning, values)
    unscaled, units = dict(values), {}
    for quantity, column in (("latitude", latitude), ("longitude", longitude)):
        choice = meaning.stated_unit(quantity, column)
        if not choice.unit:
            choice = _choose_place_unit_or_ask(meaning, unscaled, quantity, column)
            if not choice.unit:
                return
        if choice.unit == "ddmm":
            whole = np.trunc(values[quantity] / 100.0)
            values[quantity] = whole + (values[quantity] - 100.0 * whole) / 60.0
        elif (factor := FACTOR_BY_KIND_AND_UNIT["place"][choice.unit]) != 1.0:
            values[quantity] = values[quantity] * factor
        values[quantity] = _apply_hemisphere_sign(meaning, values[quantity], f"{quantity}_half")
        units[quantity] = choice
    _drop_invalid_fixes(meaning, values)
    _drop_damaged_places(meaning, values)
    _require_position(meaning, values)
    for quantity, limit in (("latitude", MAX_LATITUDE_DEG), ("longitude", MAX_LONGITUDE_DEG)):
        beyond = np.abs(values[quantity]) > limit
        if beyond.any():
            _ask_if_positions_out_of_range(meaning, quantity, latitude, longitude, values)
            return
    _ask_if_degrees_or_radians(meaning, values, units, latitude)
    for quantity, column in (("latitude", latitude), ("longitude", longitude)):
        meaning.add_quantity(quantity, values[quantity], Guess(quantity, column, *units[quantity]))
    meaning.track = spans_of_geographic_places(meaning.stamp_ns, values["latitude"], values["longitude"])
    _ask_if_positions_alternate(meaning, values)


def _ask_if_positions_alternate(meaning: Meaning, values: dict[str, FloatArray]) -> None:
    """Ask where positions go to and fro between places that no car can change between: two tracks in one table."""
    keep = np.isfinite(values["latitude"]) & np.isfinite(values["longitude"])
    north_m = values["latitude"][keep] * METRES_PER_DEGREE_OF_LATITUDE
    east_m = (
        values["longitude"][keep]
        * METRES_PER_DEGREE_OF_LATITUDE
        * np.cos(np.deg2rad(np.median(values["latitude"][keep]) if keep.any() else 0.0))
    )
    if len(north_m) < MIN_MOVING_SPANS_TO_COMPARE_ANGLES:
        return
    way_m = np.hypot(np.diff(east_m), np.diff(north_m))
    step_s = np.diff(meaning.stamp_ns[keep]) / NS_PER_S
    is_jump = way_m > np.maximum(MAX_STEP_SPEED_MPS * step_s, MIN_JUMP_M)
    if np.count_nonzero(is_jump) <= MAX_JUMP_SHARE_OF_ONE_TRACK * len(way_m):
        return
    usual_m = np.median(way_m[is_jump])
    what = f"{np.count_nonzero(is_jump)} of {len(way_m)} positions are {usual_m:,.0f} m from the one before"
    columns = [name for name in meaning.table.unused if len(_few_names_of_column(meaning, name)) > 1]
    hint = "split the file, one vehicle or receiver each"
    if columns:
        names = _few_names_of_column(meaning, columns[0])
        what += f": two tracks in one table? {columns[0]!r} has {', '.join(names[:10])}"
        hint = f"--column vehicle_id='{columns[0]}' --id '{names[0]}'"
    meaning.add_question(what, hint)


def _few_names_of_column(meaning: Meaning, column: str) -> list[str]:
    """Return the texts of a column's first rows if they are few and no numbers; else none."""
    batch = next(iter(meaning.table.source.read_batches([column])), {})
    if column not in batch:
        return []
    names, rows = distinct_names_and_row_indices(batch[column])
    is_few = len(names) <= min(MAX_TRACK_NAMES, 0.5 * len(rows))
    return sorted(name for name in names if name) if is_few else []


def _take_degrees_and_minutes_or_ask(meaning: Meaning, size: float, quantity: str, column: str) -> UnitChoice:
    """Return the unit of numbers such as 4807.038, 48 degrees and 7.038 minutes, if a hemisphere stands beside them."""
    if any(name in meaning.table.codes for name in meaning.table.candidates.get(f"{quantity}_half", ())):
        return UnitChoice("ddmm", "likely", "degrees and minutes as in NMEA, with the hemisphere beside them")
    meaning.add_question(
        f"{column!r}: values up to {size:g} look like degrees and minutes (ddmm.mmmm)",
        f"give the original NMEA file, or --column {quantity}='{column}*arcmin' for minutes alone",
    )
    return UNKNOWN_UNIT


def _choose_unit_of_whole_numbers_or_ask(
    meaning: Meaning, values_by_quantity: dict[str, FloatArray], size: float, column: str
) -> UnitChoice:
    """Return the unit of places in whole numbers of millions and more."""
    is_in_range_as_e6 = all(
        np.nanmax(np.abs(values_by_quantity[name])) * 1e-6 <= limit
        for name, limit in (("latitude", MAX_LATITUDE_DEG), ("longitude", MAX_LONGITUDE_DEG))
    )
    largest_mas = {name: np.nanmax(np.abs(values)) / 3.6e6 for name, values in values_by_quantity.items()}
    if "position" in meaning.words_of_column(column):  # of Garmin's FIT, whose places are semicircles unless converted
        other = "semicircles"
    elif is_in_range_as_e6:
        other = "1e-6deg"
    elif largest_mas["latitude"] <= MAX_ROAD_LATITUDE_DEG and largest_mas["longitude"] <= MAX_LONGITUDE_DEG:
        other = "mas"
    else:
        return UnitChoice("1e-7deg", "likely", "whole numbers of this size are 1e-7 degrees")
    name = "milliarcseconds" if other == "mas" else other.replace("deg", " degrees")
    meaning.add_question(
        f"{column!r}: whole numbers up to {size:g} may be {name} or 1e-7 degrees",
        f"--column latitude=NAME*{other}, or *1e-7deg; longitude alike",
    )
    return UNKNOWN_UNIT


def _choose_place_unit_or_ask(
    meaning: Meaning, values_by_quantity: dict[str, FloatArray], quantity: str, column: str
) -> UnitChoice:
    values = values_by_quantity[quantity]
    size = float(np.nanmax(np.abs(values)))
    limit = MAX_LATITUDE_DEG if quantity == "latitude" else MAX_LONGITUDE_DEG
    if size <= limit:
        return UnitChoice("deg", "certain", "the name, and the range of the values")
    if size > 1e6 and size * 1e-7 <= limit and not (values[np.isfinite(values)] % 1.0).any():
        return _choose_unit_of_whole_numbers_or_ask(meaning, values_by_quantity, size, column)
    if size <= MAX_LONGITUDE_DEG:
        return UnitChoice("deg", "certain", "the name")
    if size < 100.0 * limit + 60.0 and (np.nan_to_num(np.abs(values)) % 100.0 < 60.0).all():
        return _take_degrees_and_minutes_or_ask(meaning, size, quantity, column)
    meaning.add_question(f"{column!r}: values up to {size:g} are no {quantity}", f"--column {quantity}='{column}*UNIT'")
    return UNKNOWN_UNIT


def _apply_hemisphere_sign(meaning: Meaning, values: FloatArray, quantity: str) -> FloatArray:
    """Make southern and western values negative, by a column that says N, S, E or W."""
    column = next((name for name in meaning.table.candidates.get(quantity, ()) if name in meaning.table.codes), None)
    if column is None:
        return values
    codes, names = meaning.table.codes[column]
    upper = np.array([name.upper()[:1] for name in names] or [""])[codes[meaning.rows]]
    if not np.isin(upper, ["N", "S", "E", "W", ""]).all():
        return values
    meaning.notes.append(f"{column}: S and W make the values negative")
    return np.where(np.isin(upper, ["S", "W"]), -np.abs(values), values)


def _require_position(meaning: Meaning, values: dict[str, FloatArray]) -> None:
    if not np.isfinite(values["latitude"] * values["longitude"]).any():
        raise DataError("no row has a position", where=meaning.name)


def _drop_unavailable_places(meaning: Meaning, values: dict[str, FloatArray]) -> None:
    for place in UNAVAILABLE_PLACES_DEG:
        is_unavailable = np.all(
            [np.abs(values[name] - at) < 1e-9 for name, at in zip(values, place, strict=True)], axis=0
        )
        if is_unavailable.any():
            for each in values.values():
                each[is_unavailable] = np.nan
            rows = format_count(int(is_unavailable.sum()), "row")
            code = f"latitude {place[0]:.10g} and longitude {place[1]:.10g}"
            meaning.notes.append(f"{rows} at {code}, which stand for no position: left out")


def _drop_damaged_places(meaning: Meaning, values: dict[str, FloatArray]) -> None:
    """Leave out the places of few rows that lie beyond 90 or 180 degrees, where all others lie within."""
    _drop_unavailable_places(meaning, values)
    size = {name: np.abs(values[name]) for name in ("latitude", "longitude")}
    limit = {"latitude": MAX_LATITUDE_DEG, "longitude": MAX_LONGITUDE_DEG}
    is_damaged = np.any(
        [size[name] >= limit[name] + MIN_DEGREES_BEYOND_RANGE_OF_DAMAGED_PLACE for name in size], axis=0
    )
    n_damaged, n_places = int(is_damaged.sum()), int(np.isfinite(size["latitude"] + size["longitude"]).sum())
    if not 0 < n_damaged <= MAX_SHARE_OF_DAMAGED_PLACES * n_places:
        return
    for each in values.values():
        each[is_damaged] = np.nan
    rows = format_count(n_damaged, "row")
    meaning.notes.append(f"{rows} with a latitude beyond 90 or a longitude beyond 180 degrees: left out")


def _drop_invalid_fixes(meaning: Meaning, values: dict[str, FloatArray]) -> None:
    for column in meaning.candidate_columns("fix"):
        fix = meaning.numbers_in_file_unit(column)
        is_none = fix == 0
        if is_none.any() and (fix > 0).any():
            for each in values.values():
                each[is_none] = np.nan
            meaning.notes.append(f"{int(is_none.sum())} rows with {column} 0 have no fix and are left out")
    is_origin = (values["latitude"] == 0.0) & (values["longitude"] == 0.0)  # what loggers write without a fix
    if is_origin.any():
        for each in values.values():
            each[is_origin] = np.nan
        rows = format_count(int(is_origin.sum()), "row")
        meaning.notes.append(f"{rows} at latitude 0 and longitude 0: without a fix, and left out")


def _ask_if_positions_out_of_range(
    meaning: Meaning, quantity: str, latitude: str, longitude: str, values: dict[str, FloatArray]
) -> None:
    swapped = (
        np.nanmax(np.abs(values["latitude"])) > MAX_LATITUDE_DEG and np.nanmax(np.abs(values["longitude"])) <= 90.0
    )
    if quantity == "latitude" and swapped and np.nanmax(np.abs(values["latitude"])) <= MAX_LONGITUDE_DEG:
        meaning.add_question(
            f"{latitude!r} has values beyond 90 degrees: latitude and longitude may be swapped",
            f"--column latitude='{longitude}' --column longitude='{latitude}'",
        )
        return
    column = latitude if quantity == "latitude" else longitude
    size = float(np.nanmax(np.abs(values[quantity])))
    meaning.add_question(f"{column!r}: values up to {size:g} are no {quantity}", f"--column {quantity}=NAME*UNIT")


def _ask_if_degrees_or_radians(
    meaning: Meaning, values: dict[str, FloatArray], units: dict[str, UnitChoice], latitude: str
) -> None:
    stated = units["latitude"]
    if stated.confidence == "given" or "header" in stated.why or meaning.table.source.presets.get(latitude):
        return
    finite = np.isfinite(values["latitude"]) & np.isfinite(values["longitude"])
    size = max(float(np.abs(values[name][finite]).max()) for name in values)
    if 0.0 < size < MAX_DEGREES_THAT_MAY_BE_RADIANS and np.abs(values["latitude"][finite]).max() < np.pi / 2:
        meaning.add_question(
            f"{latitude!r}: the values may be degrees or radians",
            "--column latitude=NAME*rad, or *deg; longitude alike",
        )


def _find_altitude(meaning: Meaning) -> None:
    columns = meaning.candidate_columns("altitude")
    words = {name: meaning.words_of_column(name) for name in meaning.table.source.columns}
    of_boxes = [name for name in columns if "height" in words[name] and _words_of_width(words[name]) in words.values()]
    if of_boxes and not meaning.is_decided_by_user("altitude"):
        meaning.notes.append(f"{', '.join(map(repr, of_boxes))} left out: beside a width, of a picture or a box")
        columns = [name for name in columns if name not in of_boxes]
    if not columns:
        return
    column = columns[0]
    choice = meaning.stated_unit("altitude", column).usual_unit_where_unknown("m", "heights are usually in m")
    meaning.chosen["altitude"] = column
    if len(columns) > 1:
        meaning.notes.append(f"height is {column!r}; {', '.join(map(repr, columns[1:]))} left out")
    scale = FACTOR_BY_KIND_AND_UNIT["length"][choice.unit]
    if float(np.nanmax(np.abs(meaning.numbers_in_file_unit(column)))) * scale > MAX_ROAD_ALTITUDE_M:
        meaning.notes.append(
            f"{column!r} is left out: {np.nanmax(np.abs(meaning.numbers_in_file_unit(column))):g} is not a height in m"
        )
        return
    meaning.add_scaled_quantity("altitude", column, choice)


def _words_of_width(words_of_height: tuple[str, ...]) -> tuple[str, ...]:
    return tuple("width" if word == "height" else word for word in words_of_height)


def _find_local_positions(meaning: Meaning) -> None:
    x, y = meaning.choose_column_or_ask("x"), meaning.choose_column_or_ask("y")
    if x is None or y is None:
        return
    if grid := parse_utm_zone_or_none(meaning.stated_unit("x", x).unit):
        _find_positions_in_utm_grid(meaning, x, y, grid)
        return
    if _ask_for_zone_if_grid(meaning, x, y):
        return
    for quantity, column in (("x", x), ("y", y)):
        choice = meaning.stated_unit(quantity, column).usual_unit_where_unknown("m", "positions are usually in m")
        meaning.add_scaled_quantity(quantity, column, choice)
    if _may_be_vectors_not_path(meaning, x, y):
        what = f"{x!r}, {y!r} and 'z' may be positions, accelerations or turn rates"
        meaning.add_question(what, f"--column x='{x}*m' --column y='{y}*m', or --column accel_x='{x}*mps2' and so on")
        return
    z = meaning.choose_column_or_ask("z")
    if z is not None:
        meaning.add_scaled_quantity("z", z, meaning.stated_unit("z", z).usual_unit_where_unknown("m", "as x and y"))
    values = meaning.values
    finite = np.isfinite(values["x"]) & np.isfinite(values["y"])
    if not finite.any():
        raise DataError("no row has a position", where=meaning.name)
    extent_m = max(float(np.ptp(values[name][finite])) for name in "xy")
    is_unit_known = all(guess.confidence != "assumed" for guess in meaning.guesses if guess.quantity in {"x", "y"})
    span_s = float(np.ptp(meaning.stamp_ns)) / 1e9
    if not is_unit_known and 0.0 < extent_m < MIN_XY_EXTENT_OF_METRES_M and span_s > 10.0:
        meaning.add_question(
            f"{x!r} and {y!r} change by less than {extent_m:.3g}: they may be degrees",
            f"--column longitude='{x}' --column latitude='{y}', or --column x='{x}*m' --column y='{y}*m'",
        )
        return
    meaning.track = spans_of_map_points(meaning.stamp_ns[finite], values["x"][finite], values["y"][finite])


def _ask_for_zone_if_grid(meaning: Meaning, x: str, y: str) -> bool:
    """Ask for the zone where x and y count from the origin of a grid, and nobody said that they may stay so."""
    if meaning.stated_unit("x", x).confidence == "given":
        return False
    sizes = [
        float(np.nanmedian(np.abs(meaning.numbers_in_file_unit(column))))
        * FACTOR_BY_KIND_AND_UNIT["length"].get(meaning.stated_unit(axis, column).unit, 1.0)
        for axis, column in (("x", x), ("y", y))
    ]
    if max(sizes) < MIN_GRID_COORDINATE_M:
        return False
    if meaning.table.source.presets and meaning.table.source.kind != "ros message":
        meaning.notes.append(
            f"{x!r} and {y!r} up to {max(sizes):.0f} m count from the origin of a grid: its north may be 3 degrees "
            "beside the true one; latitudes and longitudes are not known"
        )
        return False
    meaning.add_question(
        f"{x!r} and {y!r} up to {max(sizes):.0f} m are of a grid, whose zone is not known",
        f"--column x='{x}*utm33n' (or utm56s, EPSG:32633), --column x='{x}*m' keeps the grid's x and y",
    )
    return True


def _find_positions_in_utm_grid(meaning: Meaning, x: str, y: str, grid: tuple[int, bool]) -> None:
    """Take x and y of a zone of UTM as latitudes and longitudes."""
    places = geographic_of_utm_deg(meaning.numbers_in_file_unit(x), meaning.numbers_in_file_unit(y), *grid)
    for quantity, column, values in zip(("latitude", "longitude"), (y, x), places, strict=True):
        meaning.values[quantity] = values
        axis = "y" if quantity == "latitude" else "x"
        meaning.guesses.append(Guess(axis, column, *meaning.stated_unit("x", x)))
    if not np.isfinite(places[0] + places[1]).any():
        raise DataError("no row has a position", where=meaning.name)
    meaning.notes.append("angles beside the grid are taken as from true north")
    meaning.track = spans_of_geographic_places(meaning.stamp_ns, *places)
    _find_altitude(meaning)


def _may_be_vectors_not_path(meaning: Meaning, x_column: str, y_column: str) -> bool:
    """Tell whether columns called x, y and z, without a unit and beside nothing else, do not look like a path."""
    table = meaning.table.source
    bare = all(
        meaning.words_of_column(column) == (axis,) for axis, column in zip("xy", (x_column, y_column), strict=True)
    )
    has_unit = meaning.stated_unit("x", x_column).unit or meaning.is_decided_by_user("x") or table.presets
    companions = {"z", "speed", "heading", "course", "quaternion_w"} & set(meaning.table.candidates)
    if not bare or has_unit or companions != {"z"}:
        return False
    track = spans_of_map_points(meaning.stamp_ns, meaning.values["x"], meaning.values["y"])
    if track is None or not track.can_show_units_and_directions:
        return True
    steps = np.hypot(np.diff(meaning.values["x"]), np.diff(meaning.values["y"]))
    return float(np.nansum(steps)) > MAX_PATH_LENGTH_RATIO_OF_ROW_STEPS_TO_SECOND_STEPS * float(
        track.span_lengths_m.sum()
    )


def ask_if_latitude_longitude_swapped(meaning: Meaning, course_deg: FloatArray) -> None:
    """Ask where a course agrees with the places only if latitude and longitude are swapped."""
    if "latitude" not in meaning.values or meaning.track is None or meaning.is_decided_by_user("latitude"):
        return
    as_is = np.abs(
        heading_minus_course_of_moving_spans_rad(meaning.track, meaning.stamp_ns, np.deg2rad(90.0 - course_deg))
    )
    if (
        len(as_is) < MIN_MOVING_SPANS_TO_COMPARE_ANGLES
        or np.degrees(np.median(as_is)) < MIN_COURSE_ERROR_OF_UNSWAPPED_POSITIONS_DEG
    ):
        return
    if swapped_course_error_deg(meaning, course_deg) < MAX_COURSE_ERROR_OF_SWAPPED_POSITIONS_DEG:
        columns = [meaning.chosen[name] for name in ("latitude", "longitude")]
        meaning.add_question(
            "the course fits the positions only with latitude and longitude swapped",
            f"--column latitude='{columns[1]}' --column longitude='{columns[0]}'",
        )


def swapped_course_error_deg(meaning: Meaning, course_deg: FloatArray) -> float:
    """Return the median angle of a compass course to the way if latitude and longitude are swapped; NaN if unknown."""
    latitude, longitude = meaning.values["latitude"], meaning.values["longitude"]
    if (
        np.nanmax(np.abs(longitude)) > MAX_LATITUDE_DEG
        or meaning.track is None
        or not meaning.track.can_show_units_and_directions
    ):
        return float("nan")
    other = spans_of_geographic_places(meaning.stamp_ns, longitude, latitude)
    if other is None:
        return float("nan")
    errors = np.abs(heading_minus_course_of_moving_spans_rad(other, meaning.stamp_ns, np.deg2rad(90.0 - course_deg)))
    return float(np.degrees(np.median(errors))) if len(errors) >= MIN_MOVING_SPANS_TO_COMPARE_ANGLES else float("nan")


def new_position_mask(meaning: Meaning, names: tuple[str, ...]) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which rows hold a position that is not the one of the row before, repeated until the next fix."""
    values = [meaning.values[name] for name in names if name in meaning.values]
    finite = np.logical_and.reduce([np.isfinite(values[0]), np.isfinite(values[1])])
    rows = np.flatnonzero(finite)
    if len(rows) < 3:
        return np.asarray(finite)
    same = np.logical_and.reduce([np.diff(each[rows]) == 0.0 for each in values[:2]])
    n_moving = np.count_nonzero(~same)
    if np.count_nonzero(same) < MIN_REPEATED_SHARE_OF_HELD_POSITION * len(same) or n_moving < 3:
        return np.asarray(finite)
    step_s = np.diff(meaning.stamp_ns[rows]) / 1e9
    changes = np.flatnonzero(~same)
    usual_s = float(np.median(np.diff(meaning.stamp_ns[rows[changes]]))) / 1e9
    if usual_s < 1.5 * float(np.median(step_s)):
        return np.asarray(finite)  # the car stands
    is_new = np.concatenate([[True], ~same])
    since = np.maximum.accumulate(np.where(is_new, np.arange(len(rows)), 0))
    age_s = (meaning.stamp_ns[rows] - meaning.stamp_ns[rows[since]]) / 1e9
    is_kept = is_new | (age_s > 3.0 * usual_s)
    meaning.notes.append(
        f"{int(np.count_nonzero(~is_kept))} rows repeat the position before; a fix is the row where it changes"
    )
    keep = np.zeros(len(finite), np.bool_)
    keep[rows[is_kept]] = True
    return keep
