"""The user's settings of sensors, `--sensor TOPIC:KEY=VALUE,..`: their mounting and their accuracy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.tracking.detections import Axes

NUMBER_OF_SIGMAS_IN_SENSOR_SETTING = 3
"""Number of sigmas of a setting: range, azimuth and range rate."""
SENSOR_OPTION_EXAMPLE = "for example --sensor /radar/scan:x=3.6,y=-0.4,yaw_deg=-30,sigma=0.25/0.01/0.12"
"""Hint of errors in the option."""


@dataclass(frozen=True)
class SensorSetting:
    """The user's settings of one sensor; None: the log or the default decides.

    Attributes:
        x_m, y_m, yaw_rad: Mounting in the body frame, or in the map for one that stands still.
        axes: `body` (x forward, y left) or `paper` (x right, y forward; xiang2019).
        carrier: `body` or `map`; None: `map` where the messages' frame says so.
        frame: Frame id that is accepted; None: the most frequent one.
        sigma: 1-sigma noise of each value where the message gives none.
        max_range_m, field_of_view_rad: Its range, and the full width of its field of view.
        detection_probability: Chance that a scan sees a target in view.
        use_range_rate: False leaves the range rate out.
        is_rate_towards: The range rate is positive for what comes nearer.
    """

    x_m: float | None = None
    y_m: float | None = None
    yaw_rad: float | None = None
    axes: Axes = "body"
    carrier: str | None = None
    frame: str | None = None
    sigma: tuple[float, ...] = ()
    max_range_m: float | None = None
    field_of_view_rad: float | None = None
    detection_probability: float | None = None
    use_range_rate: bool = True
    is_rate_towards: bool = False

    @property
    def has_user_mounting(self) -> bool:
        """Whether the user gave the mounting."""
        return (self.x_m, self.y_m, self.yaw_rad) != (None, None, None)


def _parse_number(text: str) -> float:
    """Parse a finite number; a `ValueError` if it is none."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _parse_positive_number(text: str) -> float:
    """Parse a positive number; a `ValueError` if it is none."""
    value = _parse_number(text)
    if value <= 0.0:
        raise ValueError(text)
    return value


def _parse_probability(text: str) -> float:
    """Parse a number between 0 and 1; a `ValueError` if it is none."""
    value = _parse_number(text)
    if not 0.0 < value < 1.0:
        raise ValueError(text)
    return value


def _parse_sigmas(text: str) -> tuple[float, ...]:
    """Parse up to three positive numbers `A/B/C`; a single one stands for all three."""
    values = tuple(_parse_positive_number(part) for part in text.split("/"))
    if len(values) > NUMBER_OF_SIGMAS_IN_SENSOR_SETTING:
        raise ValueError(text)
    return values * NUMBER_OF_SIGMAS_IN_SENSOR_SETTING if len(values) == 1 else values


def _make_choice_parser(*names: str) -> Callable[[str], str]:
    """Make a parser that accepts these names only."""

    def require_known_name(text: str) -> str:
        if text not in names:
            raise ValueError(text)
        return text

    return require_known_name


_SENSOR_FIELDS_BY_RANGE_RATE_DIRECTION: dict[str, dict[str, bool]] = {
    "away": {},
    "toward": {"is_rate_towards": True},
    "off": {"use_range_rate": False},
}
"""A sensor's setting `rate=` (the sign of its range rate, or off) -> the fields that it sets."""
_SETTING_PARSERS: dict[str, Callable[[str], dict[str, Any]]] = {
    "x": lambda text: {"x_m": _parse_number(text)},
    "y": lambda text: {"y_m": _parse_number(text)},
    "yaw_deg": lambda text: {"yaw_rad": math.radians(_parse_number(text))},
    "axes": lambda text: {"axes": _make_choice_parser("body", "paper")(text)},
    "carrier": lambda text: {"carrier": _make_choice_parser("body", "map")(text)},
    "frame": lambda text: {"frame": text.lstrip("/")},
    "sigma": lambda text: {"sigma": _parse_sigmas(text)},
    "range_m": lambda text: {"max_range_m": _parse_positive_number(text)},
    "fov_deg": lambda text: {"field_of_view_rad": math.radians(_parse_positive_number(text))},
    "detection": lambda text: {"detection_probability": _parse_probability(text)},
    "rate": lambda text: dict(
        _SENSOR_FIELDS_BY_RANGE_RATE_DIRECTION[_make_choice_parser(*_SENSOR_FIELDS_BY_RANGE_RATE_DIRECTION)(text)]
    ),
}
"""Key of the option -> parser of its value to fields of the setting."""


def parse_sensor_settings(entries: Sequence[str]) -> dict[str, SensorSetting]:
    """Parse `TOPIC:KEY=VALUE,..` entries: topic -> setting.

    Raises:
        UsageError: An entry is malformed, or a topic or a key comes twice.
    """
    found: dict[str, SensorSetting] = {}
    for entry in entries:
        topic, _, text = entry.partition(":")
        if not topic or not text:
            raise UsageError(f"--sensor {entry!r} is not TOPIC:KEY=VALUE,..", hint=SENSOR_OPTION_EXAMPLE)
        if topic in found:
            raise UsageError(f"--sensor names {topic} twice")
        found[topic] = SensorSetting(**_parse_setting_values(entry, text))
    return found


def _parse_setting_values(entry: str, text: str) -> dict[str, Any]:
    """Parse the `KEY=VALUE,..` part of an entry to fields of the setting."""
    values: dict[str, Any] = {}
    seen_names: set[str] = set()
    for part in text.split(","):
        key, _, value = part.strip().partition("=")
        if key not in _SETTING_PARSERS:
            raise UsageError(f"--sensor {entry!r}: unknown key {key!r}", hint=f"keys: {', '.join(_SETTING_PARSERS)}")
        if key in seen_names:
            raise UsageError(f"--sensor {entry!r}: {key} comes twice")
        seen_names.add(key)
        try:
            values.update(_SETTING_PARSERS[key](value))
        except ValueError:
            raise UsageError(f"--sensor {entry!r}: {value!r} can't be {key}", hint=SENSOR_OPTION_EXAMPLE) from None
    return values
