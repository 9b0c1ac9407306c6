"""Motion profiles: the segments of a scenario file as polynomial pieces of speed and of curvature or yaw rate.

A segment goes from the present value to its target at the given rate, and holds it to its end. So the acceleration,
curvature and yaw rate are continuous, and jerk and yaw acceleration are bounded; where a segment is `smooth`, jerk and
yaw acceleration are continuous too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeVar

from numpy.polynomial.polynomial import polyder, polyroots, polyval

from cwcli.lazy_dataclass import dataclass
from cwcli.simulation.spec import LATERAL_KEYS, LONGITUDINAL_KEYS, check_scenario_table
from cwcli.toml_text import toml_value_error

SEGMENT_EDGE_TOLERANCE_S = 1e-9
"""Difference of the times of neighbouring segments that counts as none, s, against rounding."""
ZERO_SPEED_TOLERANCE_MPS = 1e-9
"""Speed that counts as standstill, m/s, against rounding."""
SMOOTH_RAMP_PEAK_TO_MEAN = 1.5
"""Ratio of the largest to the mean rate of a smooth ramp: the slope of 3 u^2 - 2 u^3 at u = 1/2."""

Piece = TypeVar("Piece", bound="SpeedPiece | TurnPiece")


@dataclass(frozen=True)
class SpeedPiece:
    """The speed (m/s) from `start_s` on: a polynomial in ascending powers of the time since then."""

    start_s: float
    coefficients: tuple[float, ...]

    def speed_and_accel_at(self, time_s: float) -> tuple[float, float]:
        """Speed (m/s) and acceleration (m/s^2) at a time of the run."""
        t = time_s - self.start_s
        return float(polyval(t, self.coefficients)), float(polyval(t, polyder(self.coefficients)))


@dataclass(frozen=True)
class TurnPiece:
    """The curvature (1/m, if `is_curvature`) or yaw rate (rad/s) from `start_s` on: a polynomial like the speed's."""

    start_s: float
    is_curvature: bool
    coefficients: tuple[float, ...]

    def curvature_or_yaw_rate_at(self, time_s: float) -> float:
        """Curvature (1/m) or yaw rate (rad/s) at a time of the run."""
        return float(polyval(time_s - self.start_s, self.coefficients))


@dataclass(frozen=True)
class MotionProfile:
    """The motion that a scenario prescribes for a vehicle.

    Attributes:
        speed: Pieces in time order; the last one holds a constant speed or acceleration to `end_s`.
        turn: Pieces in time order.
        end_s: End of the run.
    """

    speed: tuple[SpeedPiece, ...]
    turn: tuple[TurnPiece, ...]
    end_s: float


def read_motion_profile(
    longitudinal: Any, lateral: Any, *, speed_mps: float, end_s: float, path: str, source: str
) -> MotionProfile:
    """Turn the lists `longitudinal` and `lateral` of one vehicle into a profile.

    Args:
        longitudinal, lateral: What the file holds; None means constant speed, straight on.
        path, source: Place of the vehicle in the file, and the file, for messages.

    Raises:
        UsageError: A gap or an overlap, a segment too short for its target, a negative speed, a wrong key or value.
    """
    speed: list[SpeedPiece] = [SpeedPiece(0.0, (speed_mps,))]
    for place, segment, end in _checked_segments(
        longitudinal, LONGITUDINAL_KEYS, end_s, f"{path}.longitudinal", source
    ):
        _require_exactly_one_key(segment, ("accel_mps2", "speed_mps"), place, source)
        speed += _speed_pieces_of_segment(speed[-1], segment, end, place, source)
    turn: list[TurnPiece] = [TurnPiece(0.0, True, (0.0,))]
    for place, segment, end in _checked_segments(lateral, LATERAL_KEYS, end_s, f"{path}.lateral", source):
        _require_exactly_one_key(segment, ("curvature_1pm", "yaw_rate_dps"), place, source)
        turn += _turn_pieces_of_segment(turn[-1], speed, segment, end, place, source)
    _require_forward_speed(speed, end_s, path, source)
    return MotionProfile(tuple(speed), tuple(turn), end_s)


def _checked_segments(
    entries: Any, keys: Any, end_s: float, path: str, source: str
) -> list[tuple[str, dict[str, Any], float]]:
    """Check the segments of one list: place in the file, keys and end of each, without gap from 0 to `end_s`."""
    if entries is None:
        return []
    if not isinstance(entries, list | tuple) or not entries:
        raise toml_value_error(source, path, f"is {entries!r}", "a list of segments")
    tables = [check_scenario_table(entry, keys, path=f"{path}.{i}", source=source) for i, entry in enumerate(entries)]
    if tables[0]["from_s"] != 0:
        raise toml_value_error(source, f"{path}.0.from_s", f"is {tables[0]['from_s']:g}: the profile has a gap", "0 s")
    segments = []
    for i, table in enumerate(tables):
        place = f"{path}.{i}"
        is_last = i + 1 == len(tables)
        end = end_s if is_last else tables[i + 1]["from_s"]
        stated = table["to_s"]
        if stated is not None:
            _check_segment_end(stated, end, is_last=is_last, place=place, source=source)
        if end <= table["from_s"]:
            raise toml_value_error(
                source, f"{place}.from_s", f"is {table['from_s']:g}: the segment ends at {end:g} s", "below its end"
            )
        segments.append((place, table, float(end)))
    return segments


def _check_segment_end(stated: float, end: float, *, is_last: bool, place: str, source: str) -> None:
    """Refuse a stated end of a segment that leaves a gap or an overlap."""
    if is_last:
        if stated < end - SEGMENT_EDGE_TOLERANCE_S:
            raise toml_value_error(
                source, f"{place}.to_s", f"is {stated:g}: the profile has a gap", f"at least {end:g} s"
            )
    elif abs(stated - end) > SEGMENT_EDGE_TOLERANCE_S:
        fault = "a gap" if stated < end else "an overlap"
        raise toml_value_error(
            source, f"{place}.to_s", f"is {stated:g}: the profile has {fault}", f"{end:g} s, where the next one starts"
        )


def _require_exactly_one_key(segment: dict[str, Any], names: tuple[str, str], place: str, source: str) -> None:
    """Refuse a segment that has both of two keys, or neither."""
    if (segment[names[0]] is None) == (segment[names[1]] is None):
        which = "both" if segment[names[0]] is not None else "neither"
        raise toml_value_error(source, place, f"has {which} of {names[0]} and {names[1]}", "exactly one of them")


def _speed_pieces_of_segment(
    last: SpeedPiece, segment: dict[str, Any], end_s: float, place: str, source: str
) -> list[SpeedPiece]:
    """The pieces of speed of one segment, which goes on from the last piece."""
    start = segment["from_s"]
    speed, accel = last.speed_and_accel_at(start)
    mean_jerk = segment["jerk_mps3"] / (SMOOTH_RAMP_PEAK_TO_MEAN if segment["smooth"] else 1.0)
    if segment["accel_mps2"] is not None:
        phases = [(abs(segment["accel_mps2"] - accel) / mean_jerk, segment["accel_mps2"])]
    else:
        phases = _plan_speed_change_phases(speed, accel, segment["speed_mps"], segment["limit_mps2"], mean_jerk)
    _require_long_enough_segment(start, sum(duration for duration, _ in phases), end_s, place, source)
    pieces = []
    for duration, next_accel in phases:
        if duration > 0:
            ramp = _ramp_polynomial_coefficients(accel, next_accel, duration, is_smooth=segment["smooth"])
            pieces.append(SpeedPiece(start, (speed, *(c / (k + 1) for k, c in enumerate(ramp)))))
            start += duration
            speed, accel = pieces[-1].speed_and_accel_at(start)[0], next_accel
    if segment["accel_mps2"] is not None:
        pieces.append(SpeedPiece(start, (speed, segment["accel_mps2"])))
    else:
        pieces.append(SpeedPiece(start, (segment["speed_mps"],)))  # exact: no drift by rounding
    return pieces


def _ramp_polynomial_coefficients(start: float, end: float, duration_s: float, *, is_smooth: bool) -> tuple[float, ...]:
    """Polynomial of time from `start` to `end`, ascending: linear, or 3 u^2 - 2 u^3 with u = t / duration."""
    change = end - start
    if is_smooth:
        return (start, 0.0, 3 * change / duration_s**2, -2 * change / duration_s**3)
    return (start, change / duration_s)


def _plan_speed_change_phases(
    speed_mps: float, accel_mps2: float, target_mps: float, limit_mps2: float, mean_jerk: float
) -> list[tuple[float, float]]:
    """Phases (duration, acceleration at its end) of the fastest change to (target, 0) with |accel| <= limit.

    The acceleration goes to a peak, holds if the peak is the limit, and returns to 0. The peak p follows from the
    change of speed over both ramps, s (p^2 - a^2) / 2 J + s p^2 / 2 J = v1 - v0, with s the sign of the peak and J the
    mean jerk of a ramp. (A ramp, smooth or not, is symmetric: it changes the speed by its duration times the mean of
    its two accelerations.)
    """
    if accel_mps2 == 0 and speed_mps == target_mps:
        return []
    speed_if_released = speed_mps + accel_mps2 * abs(accel_mps2) / (2 * mean_jerk)
    sign = 1.0 if target_mps >= speed_if_released else -1.0
    peak = math.sqrt(max(0.0, sign * mean_jerk * (target_mps - speed_mps) + accel_mps2 * accel_mps2 / 2))
    hold = 0.0
    if peak > limit_mps2:
        ramps = sign * (2 * limit_mps2 * limit_mps2 - accel_mps2 * accel_mps2) / (2 * mean_jerk)
        hold = sign * (target_mps - speed_mps - ramps) / limit_mps2
        peak = limit_mps2
    rise = abs(sign * peak - accel_mps2)
    return [(rise / mean_jerk, sign * peak), (hold, sign * peak), (peak / mean_jerk, 0.0)]


def _turn_pieces_of_segment(
    last: TurnPiece, speed: Sequence[SpeedPiece], segment: dict[str, Any], end_s: float, place: str, source: str
) -> list[TurnPiece]:
    """The pieces of curvature or yaw rate of one segment, which goes on from the last piece."""
    start = segment["from_s"]
    is_curvature = segment["curvature_1pm"] is not None
    if is_curvature:
        target, rate = segment["curvature_1pm"], segment["curvature_rate_1pmps"]
    else:
        target, rate = math.radians(segment["yaw_rate_dps"]), math.radians(segment["yaw_accel_dps2"])
    value = last.curvature_or_yaw_rate_at(start)
    if last.is_curvature != is_curvature and value != 0:
        speed_mps = find_piece_at(speed, start).speed_and_accel_at(start)[0]
        if speed_mps <= ZERO_SPEED_TOLERANCE_MPS:
            raise toml_value_error(
                source,
                place,
                "starts at rest with another kind of turn than before",
                "the same kind, or a moving vehicle",
            )
        value = value / speed_mps if is_curvature else value * speed_mps
    duration = abs(target - value) / rate * (SMOOTH_RAMP_PEAK_TO_MEAN if segment["smooth"] else 1.0)
    _require_long_enough_segment(start, duration, end_s, place, source)
    held = TurnPiece(start + duration, is_curvature, (target,))
    if duration == 0:
        return [held]
    return [
        TurnPiece(
            start, is_curvature, _ramp_polynomial_coefficients(value, target, duration, is_smooth=segment["smooth"])
        ),
        held,
    ]


def _require_long_enough_segment(start_s: float, needed_s: float, end_s: float, place: str, source: str) -> None:
    """Refuse a segment that is too short to reach its target."""
    if start_s + needed_s > end_s + SEGMENT_EDGE_TOLERANCE_S:
        raise toml_value_error(
            source, place, f"lasts {end_s - start_s:g} s: too short to reach its target", f"at least {needed_s:.3f} s"
        )


def _require_forward_speed(pieces: Sequence[SpeedPiece], end_s: float, path: str, source: str) -> None:
    """Refuse a negative speed; a speed's minimum lies at the edge of a piece or where the acceleration is zero."""
    for i, piece in enumerate(pieces):
        end = pieces[i + 1].start_s if i + 1 < len(pieces) else end_s
        inner = [piece.start_s + root.real for root in polyroots(polyder(piece.coefficients)) if root.imag == 0]
        for time_s in (piece.start_s, end, *(time_s for time_s in inner if piece.start_s < time_s < end)):
            speed = piece.speed_and_accel_at(time_s)[0]
            if speed < -ZERO_SPEED_TOLERANCE_MPS:
                what = f"reaches {speed:.2f} m/s at {time_s:.2f} s"
                raise toml_value_error(source, f"{path}.longitudinal", what, "a speed of 0 m/s or more")


def find_piece_at(pieces: Sequence[Piece], time_s: float) -> Piece:
    """The piece that applies at a time; the first one before its start."""
    found = pieces[0]
    for piece in pieces[1:]:
        if piece.start_s > time_s:
            break
        found = piece
    return found
