"""The keys of a scenario file with their types, units, ranges and defaults, and the check of a table.

`docs/scenarios.md` shows these tables; a test compares the two.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cwcli.dynamics.friction import PEAK_FRICTION_COEFFICIENT
from cwcli.lazy_dataclass import dataclass
from cwcli.toml_text import toml_value_error

REQUIRED_KEY_DEFAULT = object()
"""Default that marks a key as required."""


@dataclass(frozen=True)
class NumberKey:
    """A real number inside a closed range; booleans and text are refused."""

    default: Any
    low: float
    high: float
    unit: str
    doc: str

    def check_value(self, value: Any, *, key: str, source: str) -> float:
        """Return the checked value of a key; refuse another type or a value outside the range."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise toml_value_error(source, key, f"is {value!r}", f"a number, {self.permitted_text()}")
        if not math.isfinite(value) or not self.low <= value <= self.high:
            raise toml_value_error(source, key, f"is {value!r}", self.permitted_text())
        return float(value)

    def permitted_text(self) -> str:
        """Text for messages that says what is permitted."""
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip()


@dataclass(frozen=True)
class IntegerKey:
    """A whole number inside a closed range."""

    default: Any
    low: int
    high: int
    doc: str
    unit: str = ""

    def check_value(self, value: Any, *, key: str, source: str) -> int:
        """Return the checked value of a key; refuse another type or a value outside the range."""
        if isinstance(value, bool) or not isinstance(value, int) or not self.low <= value <= self.high:
            raise toml_value_error(source, key, f"is {value!r}", f"a whole number, {self.permitted_text()}")
        return value

    def permitted_text(self) -> str:
        """Text for messages that says what is permitted."""
        return f"{self.low} to {self.high}"


@dataclass(frozen=True)
class TextKey:
    """A string, one of `choices` when they are given."""

    default: Any
    doc: str
    choices: tuple[str, ...] = ()
    unit: str = ""

    def check_value(self, value: Any, *, key: str, source: str) -> str:
        """Return the checked value of a key; refuse another type or a value outside the range."""
        if not isinstance(value, str) or (self.choices and value not in self.choices):
            raise toml_value_error(source, key, f"is {value!r}", self.permitted_text())
        return value

    def permitted_text(self) -> str:
        """Text for messages that says what is permitted."""
        return ", ".join(f'"{choice}"' for choice in self.choices) or "text"


@dataclass(frozen=True)
class FlagKey:
    """A truth value: true or false."""

    default: Any
    doc: str
    unit: str = ""

    def check_value(self, value: Any, *, key: str, source: str) -> bool:
        """Return the checked value of a key; refuse another type or a value outside the range."""
        if not isinstance(value, bool):
            raise toml_value_error(source, key, f"is {value!r}", self.permitted_text())
        return value

    def permitted_text(self) -> str:
        """Text for messages that says what is permitted."""
        return "true, false"


@dataclass(frozen=True)
class IntervalsKey:
    """A list of [from, to] pairs in seconds of the run, each with from < to."""

    default: Any
    doc: str
    unit: str = "s"

    def check_value(self, value: Any, *, key: str, source: str) -> tuple[tuple[float, float], ...]:
        """Return the checked value of a key; refuse another type or a value outside the range."""
        if not isinstance(value, list | tuple):
            raise toml_value_error(source, key, f"is {value!r}", self.permitted_text())
        pairs: list[tuple[float, float]] = []
        for index, pair in enumerate(value):
            is_pair = isinstance(pair, list | tuple) and len(pair) == 2
            if not is_pair or not all(_is_finite_number(edge) for edge in pair) or not 0 <= pair[0] < pair[1]:
                raise toml_value_error(source, f"{key}.{index}", f"is {pair!r}", "[from, to] with 0 <= from < to, in s")
            pairs.append((float(pair[0]), float(pair[1])))
        return tuple(pairs)

    def permitted_text(self) -> str:
        """Text for messages that says what is permitted."""
        return "[[from, to], ...]"


Key = NumberKey | IntegerKey | TextKey | FlagKey | IntervalsKey
Keys = Mapping[str, Key]

SCENARIO_TOP_LEVEL_KEYS: Keys = {
    "description": TextKey("", "What happens, in a sentence."),
    "duration_s": NumberKey(REQUIRED_KEY_DEFAULT, 0.1, 3600, "s", "Length of the run."),
    "seed": IntegerKey(1, 0, 2**63 - 1, "Seed of every random draw; `--seed` overrides it."),
    "friction": NumberKey(
        PEAK_FRICTION_COEFFICIENT,
        0.05,
        1.5,
        "",
        "Road friction: no vehicle may need more than friction * 9.80665 m/s^2.",
    ),
    "truth_rate_hz": NumberKey(20, 1, 1000, "Hz", "Rate of the truth channels."),
}
"""Keys of the top level, which also holds `start_time` and the tables `origin`, `vehicles`, `sensors` and `v2x`."""

ORIGIN_KEYS: Keys = {
    "latitude_deg": NumberKey(28.1795, -85, 85, "deg", "WGS84 latitude of the map's origin."),
    "longitude_deg": NumberKey(112.9388, -180, 180, "deg", "WGS84 longitude of the map's origin."),
    "altitude_m": NumberKey(50, -400, 8000, "m", "Height above the ellipsoid."),
}
"""Keys of the table `origin`."""

VEHICLE_KEYS: Keys = {
    "x_m": NumberKey(0, -1e5, 1e5, "m", "Start position east of the origin (centre of the car)."),
    "y_m": NumberKey(0, -1e5, 1e5, "m", "Start position north of the origin."),
    "heading_deg": NumberKey(0, -360, 360, "deg", "Start heading, counter-clockwise from east."),
    "speed_mps": NumberKey(REQUIRED_KEY_DEFAULT, 0, 70, "m/s", "Start speed."),
    "length_m": NumberKey(4.5, 0.5, 30, "m", "Length."),
    "width_m": NumberKey(1.8, 0.3, 5, "m", "Width."),
    "turning_radius_m": NumberKey(5, 1, 50, "m", "Tightest radius that the vehicle can drive."),
    "slope_deg": NumberKey(0, 0, 10, "deg", "Slope of the road that it drives on, in any direction, 1 sigma."),
    "bounce_deg": NumberKey(0, 0, 5, "deg", "Pitching of the body on its springs (1 to 2 Hz), 1 sigma."),
    "squat_degpmps2": NumberKey(0, 0, 2, "deg/(m/s^2)", "Pitch of the body per acceleration, nose up."),
    "v2x": FlagKey(True, "Whether it sends V2X messages (the host's own are not in its log)."),
    "station_id": TextKey(
        "", "J2735 temporary id, eight hexadecimal digits; derived from the vehicle's name if empty."
    ),
}
"""Keys of a vehicle, which also holds the lists `longitudinal` and `lateral`."""

SEGMENT_START_TIME_KEY = NumberKey(REQUIRED_KEY_DEFAULT, 0, 3600, "s", "Start of the segment; the first is 0.")
"""The key `from_s` of segments."""
SEGMENT_SMOOTHNESS_KEY = FlagKey(
    False, "Whether the rate itself rises and falls (a cubic ramp): 1.5 times as long at the same largest rate."
)
"""The key `smooth` of segments."""
SEGMENT_END_TIME_KEY = NumberKey(
    None, 0, 3600, "s", "End; if given it must be the next segment's start. Last one: the run's end or later."
)
"""The key `to_s` of segments."""

LONGITUDINAL_KEYS: Keys = {
    "from_s": SEGMENT_START_TIME_KEY,
    "to_s": SEGMENT_END_TIME_KEY,
    "accel_mps2": NumberKey(None, -15, 15, "m/s^2", "Acceleration to reach and hold."),
    "speed_mps": NumberKey(
        None, 0, 70, "m/s", "Or: the speed to reach and hold, in the shortest time that the limits allow."
    ),
    "limit_mps2": NumberKey(2, 0.01, 15, "m/s^2", "With speed_mps: largest acceleration or deceleration on the way."),
    "jerk_mps3": NumberKey(2, 0.01, 100, "m/s^3", "Largest rate at which the acceleration changes."),
    "smooth": SEGMENT_SMOOTHNESS_KEY,
}
"""Keys of a segment of `longitudinal`."""

LATERAL_KEYS: Keys = {
    "from_s": SEGMENT_START_TIME_KEY,
    "to_s": SEGMENT_END_TIME_KEY,
    "curvature_1pm": NumberKey(None, -1, 1, "1/m", "Path curvature to reach and hold; positive = left."),
    "curvature_rate_1pmps": NumberKey(
        0.01, 1e-5, 10, "1/m/s", "Largest rate at which the curvature changes (a clothoid if not smooth)."
    ),
    "yaw_rate_dps": NumberKey(None, -90, 90, "deg/s", "Or: the yaw rate to reach and hold; positive = left."),
    "yaw_accel_dps2": NumberKey(20, 0.01, 500, "deg/s^2", "Largest rate at which the yaw rate changes."),
    "smooth": SEGMENT_SMOOTHNESS_KEY,
}
"""Keys of a segment of `lateral`."""

COMMON_SENSOR_KEYS: Keys = {
    "rate_hz": NumberKey(20, 0.1, 1000, "Hz", "Measurement rate."),
    "phase_s": NumberKey(0, 0, 10, "s", "Stamp of the first measurement."),
    "latency_s": NumberKey(0, -1, 5, "s", "Undeclared lag: the value stamped t is the truth at t - latency_s."),
    "delay_s": NumberKey(0.005, 0, 5, "s", "Declared transport: log time = stamp + delay_s + jitter."),
    "jitter_s": NumberKey(0, 0, 1, "s", "Further delay of each message, uniform between 0 and this."),
    "drop_probability": NumberKey(0, 0, 1, "", "Chance that a message is lost."),
    "outages": IntervalsKey((), "Intervals in which nothing is sent."),
}
"""Keys that all sensors have."""

_MOUNTING_PLACE_KEYS: Keys = {
    "ahead_m": NumberKey(None, -20, 20, "m", "Place of the sensor ahead of the host's point; 0 if not given."),
    "left_m": NumberKey(None, -5, 5, "m", "Place of the sensor to the left of the host's point; 0 if not given."),
}
"""Keys of a sensor's place in the vehicle."""

SENSOR_KEYS: Mapping[str, Keys] = {
    "gnss": {
        **COMMON_SENSOR_KEYS,
        "sigma_m": NumberKey(0.6, 0, 100, "m", "Noise of east, north and up, each, 1 sigma."),
        "bias_east_m": NumberKey(0, -100, 100, "m", "Constant error, east."),
        "bias_north_m": NumberKey(0, -100, 100, "m", "Constant error, north."),
        "slow_sigma_m": NumberKey(None, 0, 100, "m", "Slow error of east and north, each, 1 sigma (Gauss-Markov)."),
        "slow_time_s": NumberKey(
            None, 0.1, 3600, "s", "Time constant of the slow error; 20 s if only its sigma is given."
        ),
        **_MOUNTING_PLACE_KEYS,
    },
    "gnss_heading": {
        **COMMON_SENSOR_KEYS,
        "sigma_deg": NumberKey(1.0, 0, 180, "deg", "Noise, 1 sigma."),
        "bias_deg": NumberKey(0, -180, 180, "deg", "Constant error, counter-clockwise positive."),
    },
    "speed": {
        **COMMON_SENSOR_KEYS,
        "sigma_mps": NumberKey(0.5, 0, 20, "m/s", "Noise, 1 sigma."),
        "bias_mps": NumberKey(0, -20, 20, "m/s", "Constant error."),
        "scale": NumberKey(None, 0.5, 2, "", "Ratio of the reading to the true speed; 1 if not given."),
        "lever_arm_m": NumberKey(
            None, -5, 5, "m", "Height of the host's point above the measured wheels; 0 if not given."
        ),
    },
    "imu": {
        **COMMON_SENSOR_KEYS,
        "accel_sigma_mps2": NumberKey(0.049, 0, 10, "m/s^2", "Noise of each axis, 1 sigma (0.5 % of g)."),
        "accel_bias_mps2": NumberKey(0, -5, 5, "m/s^2", "Constant error of the forward axis."),
        "yaw_rate_sigma_dps": NumberKey(0.1, 0, 50, "deg/s", "Noise of each axis, 1 sigma."),
        "yaw_rate_bias_dps": NumberKey(0, -20, 20, "deg/s", "Constant error of the up axis."),
        "mount_pitch_deg": NumberKey(0, -30, 30, "deg", "Mounting error: positive = nose down."),
        "pitch_rate_bias_dps": NumberKey(None, -20, 20, "deg/s", "Constant error of the left axis; 0 if not given."),
        **_MOUNTING_PLACE_KEYS,
    },
}
"""Keys of each sensor; default noise is song2016's (docs/papers/song2016-scenarios.md)."""

_KEYS_COMMON_TO_LIDAR_AND_RADAR: Keys = {
    "detection_probability": NumberKey(1, 0, 1, "", "Chance that a scan detects a vehicle in view."),
    "fov_deg": NumberKey(360, 1, 360, "deg", "Field of view, centred ahead."),
}
"""Keys that lidar and radar have. Both stand at the host's point and look ahead."""

DETECTOR_KEYS: Mapping[str, Keys] = {
    "lidar": {
        **COMMON_SENSOR_KEYS,
        "sigma_m": NumberKey(0.1, 0, 10, "m", "Noise of x and y, each, 1 sigma."),
        "max_range_m": NumberKey(200, 1, 1000, "m", "Largest range of a detection."),
        **_KEYS_COMMON_TO_LIDAR_AND_RADAR,
    },
    "radar": {
        **COMMON_SENSOR_KEYS,
        "range_sigma_m": NumberKey(0.25, 0, 10, "m", "Noise of the range, 1 sigma."),
        "azimuth_sigma_deg": NumberKey(0.5, 0, 45, "deg", "Noise of the azimuth, 1 sigma."),
        "rate_sigma_mps": NumberKey(0.12, 0, 10, "m/s", "Noise of the range rate, 1 sigma."),
        "max_range_m": NumberKey(100, 1, 1000, "m", "Largest range of a detection."),
        **_KEYS_COMMON_TO_LIDAR_AND_RADAR,
    },
}
"""Keys of the sensors that detect other vehicles; default noise and range are xiang2019's (its two sensors' data
sheets)."""

V2X_FORMATS = ("bsm-json", "ode-json")
"""Names of the encodings of V2X messages."""

V2X_KEYS: Keys = {
    "rate_hz": NumberKey(20, 0.1, 100, "Hz", "Messages of each vehicle per second."),
    "phase_s": NumberKey(0, 0, 10, "s", "Generation time of each vehicle's first message."),
    "latency_s": NumberKey(0, -1, 5, "s", "Undeclared lag of the sender's own estimate, as for a sensor."),
    "delay_s": NumberKey(0.005, 0, 5, "s", "Link latency: reception = generation + delay_s + jitter."),
    "jitter_s": NumberKey(
        0, 0, 1, "s", "Further delay of each message, uniform between 0 and this; may change the order."
    ),
    "drop_probability": NumberKey(0, 0, 1, "", "Chance that a message is lost."),
    "outages": IntervalsKey((), "Intervals (of generation time) in which every message is lost."),
    "format": TextKey("bsm-json", "Encoding of the messages.", V2X_FORMATS),
    "position_sigma_m": NumberKey(0.15, 0, 100, "m", "Noise of the sent east and north position, each, 1 sigma."),
    "speed_sigma_mps": NumberKey(0.1, 0, 20, "m/s", "Noise of the sent speed."),
    "heading_sigma_deg": NumberKey(0.21, 0, 180, "deg", "Noise of the sent heading."),
    "accel_sigma_mps2": NumberKey(0.0265, 0, 10, "m/s^2", "Noise of the sent acceleration (0.27 % of g)."),
    "yaw_rate_sigma_dps": NumberKey(0.043, 0, 50, "deg/s", "Noise of the sent yaw rate."),
    "sender": TextKey(
        None,
        "How a sender changes its motion before sending it: j2945 filters the acceleration (1 Hz) and holds the "
        "heading at standstill, as SAE J2945/1 asks; plain not at all.",
        ("plain", "j2945"),
    ),
}
"""Keys of the table `v2x`; default noise is song2016's (table 1, column "estimated";
docs/papers/song2016-scenarios.md)."""


def check_scenario_table(
    table: Any, keys: Keys, *, path: str, source: str, others: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Check one table of a scenario against its keys.

    Args:
        path: Dotted place of the table in the file, "" for the top level.
        source: File, for messages.
        others: Further keys that the caller reads itself.

    Returns:
        Every key of `keys`, checked, with defaults filled in (None for an optional key without one).

    Raises:
        UsageError: An unknown or missing key, a wrong type, a value outside its range.
    """
    if not isinstance(table, Mapping):
        raise toml_value_error(source, path, f"is {table!r}", "a table")
    prefix = f"{path}." if path else ""
    for name in table:
        if name not in keys and name not in others:
            raise toml_value_error(source, f"{prefix}{name}", "is unknown", ", ".join((*keys, *others)))
    values: dict[str, Any] = {}
    for name, key in keys.items():
        if name in table:
            values[name] = key.check_value(table[name], key=f"{prefix}{name}", source=source)
        elif key.default is REQUIRED_KEY_DEFAULT:
            raise toml_value_error(source, f"{prefix}{name}", "is missing", key.permitted_text())
        elif key.default is None or isinstance(key.default, tuple):
            values[name] = key.default
        else:
            values[name] = key.check_value(key.default, key=f"{prefix}{name}", source=source)
    return values


def _is_finite_number(value: Any) -> bool:
    """Whether a value is a finite number and no truth value."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
