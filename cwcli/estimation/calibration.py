"""Calibration of a car: constants of its sensors from earlier drives, in a TOML file that `cwcli calibrate` writes.

    cwcli_calibration = 1
    logs = ["monday.mcap", "tuesday.mcap"]
    minutes = 41.3

    ["/gps/fix".position]
    latency_s = { status = "found", value = 0.103, sigma = 0.004, spread = 0.0, logs = 2, minutes = 41.3, ... }

A value without a sigma is exact, so a file may be written by hand. `interval`, `chi_square` and the evidence are only
information. An error message names the file, the key, the fault and what is permitted.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from enum import StrEnum
from pathlib import Path
from typing import Any

from cwcli.errors import InputError, UsageError
from cwcli.estimation.measurements import Kind
from cwcli.input import read_file
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.student import student_to_normal_quantile_ratio
from cwcli.text import escape_surrogates
from cwcli.toml_text import parse_toml, require_number_in_range, toml_value_error

FORMAT_VERSION_KEY, FORMAT_VERSION = "cwcli_calibration", 1
"""Key of the format version in a calibration file, and the version that this code reads and writes."""
MOTION_TABLE_NAME = "motion"
"""Name of the table with the constants of the driver and the car, which belong to no sensor."""


@dataclass(frozen=True)
class ConstantSpec:
    """Specification of a constant that a calibration may hold.

    Attributes:
        low, high: Least and greatest permitted value.
        unit: Unit, for messages.
        quantities: Names of the quantities that may have the constant.
    """

    low: float
    high: float
    unit: str
    quantities: tuple[str, ...]


NAMES_OF_QUANTITIES_WITH_BIAS = ("accel", "yaw_rate")
"""Names of the quantities that may have a bias."""
MEASURED_QUANTITY_NAMES = ("position", "velocity", "speed", "heading", *NAMES_OF_QUANTITIES_WITH_BIAS)
"""Names of the quantities that the filter measures."""
QUANTITY_NAMES = (*MEASURED_QUANTITY_NAMES, "imu", "camera")
"""Names of all quantities that a source may have in a calibration file."""
RANGE_AND_UNIT_BY_CALIBRATION_CONSTANT: Mapping[str, ConstantSpec] = {
    "latency_s": ConstantSpec(-3600.0, 3600.0, "s, positive is late", MEASURED_QUANTITY_NAMES),
    "noise_sigma": ConstantSpec(0.0, 1e4, "one sigma in the unit of the quantity", MEASURED_QUANTITY_NAMES),
    "stamp_sigma_s": ConstantSpec(0.0, 10.0, "s, one sigma from row to row", ("position",)),
    "interval_s": ConstantSpec(0.0, 3600.0, "s between two rows", MEASURED_QUANTITY_NAMES),
    "noise_scale": ConstantSpec(0.0, 1e8, "factor on the variance that the messages state", MEASURED_QUANTITY_NAMES),
    "slow_sigma": ConstantSpec(0.0, 1e4, "one sigma in the unit of the quantity", ("position", "accel")),
    "slow_time_s": ConstantSpec(0.0, 1e6, "s", ("position", "accel")),
    "bias": ConstantSpec(-1e3, 1e3, "in the unit of the quantity", NAMES_OF_QUANTITIES_WITH_BIAS),
    "scale": ConstantSpec(0.5, 2.0, "read for a true 1", ("speed",)),
    "lever_arm_m": ConstantSpec(-20.0, 20.0, "m", ("speed",)),
    "ahead_m": ConstantSpec(-20.0, 20.0, "m", ("position", "velocity", "accel")),
    "nose_up_rad": ConstantSpec(-1.0, 1.0, "rad", ("imu",)),
    "left_up_rad": ConstantSpec(-1.0, 1.0, "rad", ("imu",)),
    "pitch_rad": ConstantSpec(-0.785, 0.785, "rad, nose down positive", ("camera",)),
    "jerk_sigma_mps3": ConstantSpec(0.0, 1e3, "m/s^3", (MOTION_TABLE_NAME,)),
    "yaw_accel_sigma_radps2": ConstantSpec(0.0, 1e3, "rad/s^2", (MOTION_TABLE_NAME,)),
}
"""Name of each constant -> its permitted range, its unit and the quantities that may have it; chosen by hand."""
DRIVING_AMOUNT_KEYS = ("distance_km", "accel_rms_mps2", "yaw_rate_rms_radps")
"""Keys that tell how much driving a calibration comes from."""
MIN_USED_CONSTANT_OF_DISAGREEING_DRIVES_SIGMAS = 3.0
"""A constant on which drives disagree is used only if it is more than this many sigmas of their scatter from zero.

Chosen as for the significance of a latency; not fitted."""
CONSTANT_TOML_KEYS = ("status", "value", "sigma", "spread", "interval", "chi_square", "logs", "minutes")
"""Keys that the table of one constant may have."""


class ConstantStatus(StrEnum):
    """Whether the logs agree on a constant.

    Attributes:
        REFERENCE: The source is the reference of all latencies; its own latency is zero by definition.
        FOUND: The logs agree.
        DISAGREE: The logs differ by more than their sigmas allow; `spread` is the difference.
        NOT_OBSERVABLE: No log shows the constant.
    """

    REFERENCE = "reference"
    FOUND = "found"
    DISAGREE = "logs disagree"
    NOT_OBSERVABLE = "not observable"


@dataclass(frozen=True)
class Constant:
    """A constant of a sensor, from one log or many.

    Attributes:
        status: Whether the logs agree on it.
        value: The value; NaN where it is not observable.
        sigma: One sigma of the value.
        spread: One sigma of the differences between drives, beyond what the sigmas of the drives explain.
        chi_square: Reduced chi-square of the logs about the value; NaN with one log.
        n_logs, minutes: Number of logs and minutes of driving behind the value.
        of_logs: Name, value and one sigma of each log; () where it was read from a file.
    """

    status: ConstantStatus = ConstantStatus.NOT_OBSERVABLE
    value: float = math.nan
    sigma: float = math.nan
    spread: float = 0.0
    chi_square: float = math.nan
    n_logs: int = 0
    minutes: float = 0.0
    of_logs: tuple[tuple[str, float, float], ...] = field(default=(), compare=False)

    @property
    def has_value(self) -> bool:
        """Whether it has a value."""
        return math.isfinite(self.value)

    @property
    def sigma_in_another_drive(self) -> float:
        """One sigma of the constant in another drive: 1.96 of them hold 95 %.

        The variance is that of the mean plus that between drives (Higgins, Thompson and Spiegelhalter, 2009). With few
        drives the spread is uncertain, so Student's quantile with one degree of freedom less than drives is used.
        """
        both = math.hypot(self.sigma, self.spread)
        return (
            both * student_to_normal_quantile_ratio(self.n_logs - 1) if self.spread > 0.0 and self.n_logs > 1 else both
        )

    @property
    def is_usable_in_any_drive(self) -> bool:
        """Whether it may be used in a drive that does not show it.

        That is so where the drives agree on it, or where it is farther from zero than they scatter.
        """
        if self.status is not ConstantStatus.DISAGREE:
            return self.has_value
        return abs(self.value) > MIN_USED_CONSTANT_OF_DISAGREEING_DRIVES_SIGMAS * math.hypot(self.sigma, self.spread)

    @property
    def i_squared_between_drives(self) -> float:
        """I^2 (Higgins and Thompson, 2002): share of the scatter that the sigmas of the drives do not explain.

        NaN with one log.
        """
        return max(0.0, 1.0 - 1.0 / self.chi_square) if self.chi_square > 0.0 else self.chi_square

    @property
    def interval_of_95_percent_of_drives(self) -> tuple[float, float]:
        """Lower and upper bound of the value in 95 % of other drives."""
        return self.value - 1.96 * self.sigma_in_another_drive, self.value + 1.96 * self.sigma_in_another_drive


UNKNOWN_CONSTANT = Constant()
"""Constant of which nothing is known."""
Constants = Mapping[str, Constant]


@dataclass(frozen=True)
class Calibration:
    """The calibration of a car.

    Attributes:
        name: Name of its file, for messages.
        sensors: Source -> quantity -> constant's name -> the constant.
        motion: Name -> constant of the motion model.
        logs: Names of the logs that it comes from.
        minutes: Minutes of driving in these logs.
        evidence: Key of `DRIVING_AMOUNT_KEYS` -> value.
    """

    name: str
    sensors: Mapping[str, Mapping[str, Constants]]
    motion: Constants = field(default_factory=dict)
    logs: tuple[str, ...] = ()
    minutes: float = 0.0
    evidence: Mapping[str, float] = field(default_factory=dict)

    def find_constant_or_unknown(self, source: str, kind: Kind | str, name: str) -> Constant:
        """Return a constant of a quantity of a source; `UNKNOWN_CONSTANT` where there is none."""
        quantity = kind if isinstance(kind, str) else kind.name.lower()
        return self.sensors.get(source, {}).get(quantity, {}).get(name, UNKNOWN_CONSTANT)

    def has_quantity(self, source: str, kind: Kind) -> bool:
        """Whether the calibration has constants of a quantity of a source."""
        return kind.name.lower() in self.sensors.get(source, {})


def load_calibration(source: str | Path) -> Calibration:
    """Read a calibration from its file.

    Raises:
        UsageError: The file's content is wrong.
        InputError: The file can't be read.
    """
    where = str(source)
    try:
        text = read_file(source).decode()
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        reason = "not UTF-8 text" if isinstance(error, UnicodeDecodeError) else getattr(error, "strerror", str(error))
        raise InputError(f"can't be read: {reason}", where=where) from None
    try:
        table = parse_toml(text)
    except ValueError as error:
        raise UsageError(f"not TOML: {error}", where=where) from None
    return parse_calibration_table(table, where)


def parse_calibration_table(table: Mapping[str, Any], where: str) -> Calibration:
    """Convert the parsed TOML of a calibration file to a calibration.

    Raises:
        UsageError: An unknown key, a wrong type, a value outside its range, or another format.
    """
    if FORMAT_VERSION_KEY not in table:
        hint = "make one with `cwcli calibrate LOG... -o car.toml`"
        raise UsageError(f"this is not a calibration file: {FORMAT_VERSION_KEY} is missing", where=where, hint=hint)
    if table[FORMAT_VERSION_KEY] != FORMAT_VERSION or isinstance(table[FORMAT_VERSION_KEY], bool):
        raise toml_value_error(where, FORMAT_VERSION_KEY, f"is {table[FORMAT_VERSION_KEY]!r}", str(FORMAT_VERSION))
    logs = table.get("logs", [])
    if not isinstance(logs, list) or not all(isinstance(log, str) for log in logs):
        raise toml_value_error(where, "logs", f"is {logs!r}", "a list of names")
    numbers = {
        key: _parse_number_in_range(table[key], 0.0, 1e9, where, key, "")
        for key in ("minutes", *DRIVING_AMOUNT_KEYS)
        if key in table
    }
    sensors: dict[str, dict[str, Constants]] = {}
    for source, quantities in table.items():
        if source in (FORMAT_VERSION_KEY, "logs", MOTION_TABLE_NAME, *numbers):
            continue
        if not isinstance(quantities, Mapping):
            known = ", ".join((FORMAT_VERSION_KEY, "logs", "minutes", *DRIVING_AMOUNT_KEYS, MOTION_TABLE_NAME))
            raise toml_value_error(where, source, "is unknown", f"{known}, and a table of each source")
        for quantity in quantities:
            if quantity not in QUANTITY_NAMES:
                raise toml_value_error(where, f"{source}.{quantity}", "is unknown", ", ".join(QUANTITY_NAMES))
        sensors[source] = {
            quantity: _parse_constants(constants, quantity, where, f"{source}.{quantity}")
            for quantity, constants in quantities.items()
        }
    if not sensors:
        raise UsageError("the calibration has no source", where=where)
    return Calibration(
        name=where,
        sensors=sensors,
        motion=_parse_constants(table.get(MOTION_TABLE_NAME, {}), MOTION_TABLE_NAME, where, MOTION_TABLE_NAME),
        logs=tuple(logs),
        minutes=numbers.pop("minutes", 0.0),
        evidence=numbers,
    )


def _parse_constants(toml_table: Any, quantity: str, where: str, key: str) -> dict[str, Constant]:
    if not isinstance(toml_table, Mapping):
        raise toml_value_error(where, key, f"is {toml_table!r}", "a table")
    permitted = [name for name, each in RANGE_AND_UNIT_BY_CALIBRATION_CONSTANT.items() if quantity in each.quantities]
    for name in toml_table:
        if name not in permitted:
            raise toml_value_error(where, f"{key}.{name}", "is unknown", ", ".join(permitted))
    return {
        name: _parse_constant(value, RANGE_AND_UNIT_BY_CALIBRATION_CONSTANT[name], where, f"{key}.{name}")
        for name, value in toml_table.items()
    }


def _parse_constant(toml_table: Any, spec: ConstantSpec, where: str, key: str) -> Constant:
    if not isinstance(toml_table, Mapping):
        raise toml_value_error(where, key, f"is {toml_table!r}", "a table, as { value = 0.1, sigma = 0.01 }")
    for each in toml_table:
        if each not in CONSTANT_TOML_KEYS:
            raise toml_value_error(where, f"{key}.{each}", "is unknown", ", ".join(CONSTANT_TOML_KEYS))
    status = toml_table.get("status", ConstantStatus.FOUND.value)
    if status not in list(ConstantStatus):
        raise toml_value_error(where, f"{key}.status", f"is {status!r}", ", ".join(ConstantStatus))
    most = spec.high - spec.low
    bounds = {
        "value": (spec.low, spec.high, spec.unit),
        "sigma": (0.0, most, spec.unit),
        "spread": (0.0, most, spec.unit),
        "chi_square": (0.0, math.inf, ""),
        "logs": (0, 1_000_000_000, "logs"),
        "minutes": (0.0, 1e9, "minutes"),
    }
    numbers = {each: _parse_number_in_range(toml_table[each], *bounds[each][:2], where, f"{key}.{each}",
    bounds[each][2])
               for each in bounds if each in toml_table}  # fmt: skip
    if status == ConstantStatus.NOT_OBSERVABLE:
        return Constant(n_logs=int(numbers.get("logs", 0)), minutes=numbers.get("minutes", 0.0))
    if "value" not in numbers:
        raise toml_value_error(
            where, f"{key}.value", "is missing", f"{spec.low:g} to {spec.high:g} {spec.unit}".strip()
        )
    return Constant(
        status=ConstantStatus(status),
        value=numbers["value"],
        sigma=numbers.get("sigma", 0.0),
        spread=numbers.get("spread", 0.0),
        chi_square=numbers.get("chi_square", math.nan),
        n_logs=int(numbers.get("logs", 0)),
        minutes=numbers.get("minutes", 0.0),
    )


def _parse_number_in_range(value: Any, low: float, high: float, where: str, key: str, unit: str) -> float:
    return require_number_in_range(value, low, high, where, key, f"{low:g} to {high:g} {unit}".strip())


def format_calibration_toml(calibration: Calibration) -> str:
    """Return a calibration as TOML; `parse_calibration_table` reads it back."""
    lines = [
        "# Constants of a car's sensors, found by `cwcli calibrate`. `interval` holds 95 % of drives; `spread` is how",
        "# much a drive differs from the next beyond what each tells of itself, `chi_square` whether the logs agree.",
        f"{FORMAT_VERSION_KEY} = {FORMAT_VERSION}",
        f"logs = [{', '.join(map(_quote_toml_string, calibration.logs))}]",
        f"minutes = {_format_toml_float_to_six_digits(calibration.minutes)}",
        *(f"{key} = {_format_toml_float_to_six_digits(value)}" for key, value in calibration.evidence.items()),
    ]
    for source, quantities in calibration.sensors.items():
        for quantity, constants in quantities.items():
            lines += ["", f"[{_quote_toml_string(source)}.{quantity}]", *_format_constant_lines(constants)]
    if calibration.motion:
        lines += ["", f"[{MOTION_TABLE_NAME}]", *_format_constant_lines(calibration.motion)]
    return "\n".join(lines) + "\n"


def run_record_entry_of_calibration_file(calibration: Calibration | None) -> dict[str, str]:
    """Return the entry of a run's record with the content of the calibration file; empty without a calibration."""
    return {} if calibration is None else {"calibration": format_calibration_toml(calibration)}


def _format_constant_lines(constants: Constants) -> list[str]:
    return [f"{name} = {{ {', '.join(_format_constant_entries(constant))} }}" for name, constant in constants.items()]


def _format_constant_entries(constant: Constant) -> Sequence[str]:
    entries = [f'status = "{constant.status.value}"']
    if constant.has_value:
        low, high = constant.interval_of_95_percent_of_drives
        entries += [
            f"value = {_format_toml_float_to_six_digits(constant.value)}",
            f"sigma = {_format_toml_float_to_six_digits(constant.sigma)}",
            f"interval = [{_format_toml_float_to_six_digits(low)}, {_format_toml_float_to_six_digits(high)}]",
            f"spread = {_format_toml_float_to_six_digits(constant.spread)}",
        ]
        if math.isfinite(constant.chi_square):
            entries.append(f"chi_square = {_format_toml_float_to_six_digits(constant.chi_square)}")
    return [*entries, f"logs = {constant.n_logs}", f"minutes = {_format_toml_float_to_six_digits(constant.minutes)}"]


def _format_toml_float_to_six_digits(value: float) -> str:
    """Return a number with six digits as a TOML float."""
    text = f"{value:.6g}"
    return text if any(mark in text for mark in ".en") else f"{text}.0"


def _quote_toml_string(value: str) -> str:
    return json.dumps(escape_surrogates(value), ensure_ascii=False).replace("\x7f", "\\u007f")
