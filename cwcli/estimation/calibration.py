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
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from cwcli.errors import InputError, UsageError
from cwcli.estimation.measurements import Kind
from cwcli.input import read_file
from cwcli.metrics.student import student_factor
from cwcli.toml_text import parse_toml

FORMAT_KEY, FORMAT = "cwcli_calibration", 1
"""Key of the format version in a calibration file, and the version that this code reads and writes."""
MOTION = "motion"
"""Name of the table with the constants of the driver and the car, which belong to no sensor."""


@dataclass(frozen=True)
class Name:
    """Specification of a constant that a calibration may hold.

    Attributes:
        low, high: Least and greatest permitted value.
        unit: Unit, for messages.
        of: Names of the quantities that may have the constant.
    """

    low: float
    high: float
    unit: str
    of: tuple[str, ...]


RATES = ("accel", "yaw_rate")
"""Names of the quantities that may have a bias."""
MEASURED = ("position", "velocity", "speed", "heading", *RATES)
"""Names of the quantities that the filter measures."""
QUANTITIES = (*MEASURED, "imu", "camera")
"""Names of all quantities that a source may have in a calibration file."""
NAMES: Mapping[str, Name] = {
    "latency_s": Name(-3600.0, 3600.0, "s, positive is late", MEASURED),
    "noise_sigma": Name(0.0, 1e4, "one sigma in the unit of the quantity", MEASURED),
    "stamp_sigma_s": Name(0.0, 10.0, "s, one sigma from row to row", ("position",)),
    "interval_s": Name(0.0, 3600.0, "s between two rows", MEASURED),
    "noise_scale": Name(0.0, 1e8, "factor on the variance that the messages state", MEASURED),
    "slow_sigma": Name(0.0, 1e4, "one sigma in the unit of the quantity", ("position", "accel")),
    "slow_time_s": Name(0.0, 1e6, "s", ("position", "accel")),
    "bias": Name(-1e3, 1e3, "in the unit of the quantity", RATES),
    "scale": Name(0.5, 2.0, "read for a true 1", ("speed",)),
    "lever_arm_m": Name(-20.0, 20.0, "m", ("speed",)),
    "ahead_m": Name(-20.0, 20.0, "m", ("position", "velocity", "accel")),
    "nose_up_rad": Name(-1.0, 1.0, "rad", ("imu",)),
    "left_up_rad": Name(-1.0, 1.0, "rad", ("imu",)),
    "pitch_rad": Name(-0.785, 0.785, "rad, nose down positive", ("camera",)),
    "jerk_sigma_mps3": Name(0.0, 1e3, "m/s^3", (MOTION,)),
    "yaw_accel_sigma_radps2": Name(0.0, 1e3, "rad/s^2", (MOTION,)),
}
"""Name of each constant -> its permitted range, its unit and the quantities that may have it; chosen by hand."""
EVIDENCE = ("distance_km", "accel_rms_mps2", "yaw_rate_rms_radps")
"""Keys that tell how much driving a calibration comes from."""
CLEAR_SIGMAS = 3.0
"""A constant on which drives disagree is used only if it is more than this many sigmas of their scatter from zero.

Chosen as for the significance of a latency; not fitted."""
FIELDS = ("status", "value", "sigma", "spread", "interval", "chi_square", "logs", "minutes")
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
    def is_known(self) -> bool:
        """Whether it has a value."""
        return math.isfinite(self.value)

    @property
    def drive_sigma(self) -> float:
        """One sigma of the constant in another drive: 1.96 of them hold 95 %.

        The variance is that of the mean plus that between drives (Higgins, Thompson and Spiegelhalter, 2009). With few
        drives the spread is uncertain, so Student's quantile with one degree of freedom less than drives is used.
        """
        both = math.hypot(self.sigma, self.spread)
        return both * student_factor(self.n_logs - 1) if self.spread > 0.0 and self.n_logs > 1 else both

    @property
    def is_clear_in_any_drive(self) -> bool:
        """Whether it may be used in a drive that does not show it.

        That is so where the drives agree on it, or where it is farther from zero than they scatter.
        """
        if self.status is not ConstantStatus.DISAGREE:
            return self.is_known
        return abs(self.value) > CLEAR_SIGMAS * math.hypot(self.sigma, self.spread)

    @property
    def between_drives(self) -> float:
        """I^2 (Higgins and Thompson, 2002): share of the scatter that the sigmas of the drives do not explain.

        NaN with one log.
        """
        return max(0.0, 1.0 - 1.0 / self.chi_square) if self.chi_square > 0.0 else self.chi_square

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper bound of the value in 95 % of other drives."""
        return self.value - 1.96 * self.drive_sigma, self.value + 1.96 * self.drive_sigma


UNKNOWN = Constant()
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
        evidence: Key of `EVIDENCE` -> value.
    """

    name: str
    sensors: Mapping[str, Mapping[str, Constants]]
    motion: Constants = field(default_factory=dict)
    logs: tuple[str, ...] = ()
    minutes: float = 0.0
    evidence: Mapping[str, float] = field(default_factory=dict)

    def of(self, source: str, kind: Kind | str, name: str) -> Constant:
        """Return a constant of a quantity of a source; `UNKNOWN` where there is none."""
        quantity = kind if isinstance(kind, str) else kind.name.lower()
        return self.sensors.get(source, {}).get(quantity, {}).get(name, UNKNOWN)

    def knows(self, source: str, kind: Kind) -> bool:
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
    except (ValueError, RecursionError) as error:
        raise UsageError(f"not TOML: {error}", where=where) from None
    return calibration_from_table(table, where)


def calibration_from_table(table: Mapping[str, Any], where: str) -> Calibration:
    """Convert the parsed TOML of a calibration file to a calibration.

    Raises:
        UsageError: An unknown key, a wrong type, a value outside its range, or another format.
    """
    if FORMAT_KEY not in table:
        hint = "make one with `cwcli calibrate LOG... -o car.toml`"
        raise UsageError(f"this is no calibration: {FORMAT_KEY} is missing", where=where, hint=hint)
    if table[FORMAT_KEY] != FORMAT or isinstance(table[FORMAT_KEY], bool):
        raise _bad(where, FORMAT_KEY, f"is {table[FORMAT_KEY]!r}", str(FORMAT))
    logs = table.get("logs", [])
    if not isinstance(logs, list) or not all(isinstance(log, str) for log in logs):
        raise _bad(where, "logs", f"is {logs!r}", "a list of names")
    numbers = {key: _number(table[key], 0.0, 1e9, where, key, "") for key in ("minutes", *EVIDENCE) if key in table}
    sensors: dict[str, dict[str, Constants]] = {}
    for source, quantities in table.items():
        if source in (FORMAT_KEY, "logs", MOTION, *numbers):
            continue
        if not isinstance(quantities, Mapping):
            known = ", ".join((FORMAT_KEY, "logs", "minutes", *EVIDENCE, MOTION))
            raise _bad(where, source, "is unknown", f"{known}, and a table of each source")
        for quantity in quantities:
            if quantity not in QUANTITIES:
                raise _bad(where, f"{source}.{quantity}", "is unknown", ", ".join(QUANTITIES))
        sensors[source] = {
            quantity: _constants(constants, quantity, where, f"{source}.{quantity}")
            for quantity, constants in quantities.items()
        }
    if not sensors:
        raise UsageError("the calibration has no source", where=where)
    return Calibration(
        name=where,
        sensors=sensors,
        motion=_constants(table.get(MOTION, {}), MOTION, where, MOTION),
        logs=tuple(logs),
        minutes=numbers.pop("minutes", 0.0),
        evidence=numbers,
    )


def _constants(table: Any, quantity: str, where: str, key: str) -> dict[str, Constant]:
    if not isinstance(table, Mapping):
        raise _bad(where, key, f"is {table!r}", "a table")
    permitted = [name for name, each in NAMES.items() if quantity in each.of]
    for name in table:
        if name not in permitted:
            raise _bad(where, f"{key}.{name}", "is unknown", ", ".join(permitted))
    return {name: _constant(value, NAMES[name], where, f"{key}.{name}") for name, value in table.items()}


def _constant(table: Any, name: Name, where: str, key: str) -> Constant:
    if not isinstance(table, Mapping):
        raise _bad(where, key, f"is {table!r}", "a table, as { value = 0.1, sigma = 0.01 }")
    for each in table:
        if each not in FIELDS:
            raise _bad(where, f"{key}.{each}", "is unknown", ", ".join(FIELDS))
    status = table.get("status", ConstantStatus.FOUND.value)
    if status not in list(ConstantStatus):
        raise _bad(where, f"{key}.status", f"is {status!r}", ", ".join(ConstantStatus))
    most = name.high - name.low
    bounds = {
        "value": (name.low, name.high, name.unit),
        "sigma": (0.0, most, name.unit),
        "spread": (0.0, most, name.unit),
        "chi_square": (0.0, math.inf, ""),
        "logs": (0, 1_000_000_000, "logs"),
        "minutes": (0.0, 1e9, "minutes"),
    }
    numbers = {each: _number(table[each], *bounds[each][:2], where, f"{key}.{each}", bounds[each][2])
               for each in bounds if each in table}  # fmt: skip
    if status == ConstantStatus.NOT_OBSERVABLE:
        return Constant(n_logs=int(numbers.get("logs", 0)), minutes=numbers.get("minutes", 0.0))
    if "value" not in numbers:
        raise _bad(where, f"{key}.value", "is missing", f"{name.low:g} to {name.high:g} {name.unit}".strip())
    return Constant(
        status=ConstantStatus(status),
        value=numbers["value"],
        sigma=numbers.get("sigma", 0.0),
        spread=numbers.get("spread", 0.0),
        chi_square=numbers.get("chi_square", math.nan),
        n_logs=int(numbers.get("logs", 0)),
        minutes=numbers.get("minutes", 0.0),
    )


def _number(value: Any, low: float, high: float, where: str, key: str, unit: str) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not low <= value <= high:  # not a number is out of range too
        raise _bad(where, key, f"is {value!r}", f"{low:g} to {high:g} {unit}".strip())
    return float(value)


def _bad(where: str, key: str, what: str, permitted: str) -> UsageError:
    return UsageError(f"{key} {what}; permitted: {permitted}", where=where)


def calibration_text(calibration: Calibration) -> str:
    """Return a calibration as TOML; `calibration_from_table` reads it back."""
    lines = [
        "# Constants of a car's sensors, found by `cwcli calibrate`. `interval` holds 95 % of drives; `spread` is how",
        "# much a drive differs from the next beyond what each tells of itself, `chi_square` whether the logs agree.",
        f"{FORMAT_KEY} = {FORMAT}",
        f"logs = [{', '.join(map(_text, calibration.logs))}]",
        f"minutes = {_digits(calibration.minutes)}",
        *(f"{key} = {_digits(value)}" for key, value in calibration.evidence.items()),
    ]
    for source, quantities in calibration.sensors.items():
        for quantity, constants in quantities.items():
            lines += ["", f"[{_text(source)}.{quantity}]", *_constant_lines(constants)]
    if calibration.motion:
        lines += ["", f"[{MOTION}]", *_constant_lines(calibration.motion)]
    return "\n".join(lines) + "\n"


def calibration_entry(calibration: Calibration | None) -> dict[str, str]:
    """Return the entry of a run's record with the content of the calibration file; empty without a calibration."""
    return {} if calibration is None else {"calibration": calibration_text(calibration)}


def _constant_lines(constants: Constants) -> list[str]:
    return [f"{name} = {{ {', '.join(_entries(constant))} }}" for name, constant in constants.items()]


def _entries(constant: Constant) -> Sequence[str]:
    entries = [f'status = "{constant.status.value}"']
    if constant.is_known:
        low, high = constant.interval
        entries += [
            f"value = {_digits(constant.value)}",
            f"sigma = {_digits(constant.sigma)}",
            f"interval = [{_digits(low)}, {_digits(high)}]",
            f"spread = {_digits(constant.spread)}",
        ]
        if math.isfinite(constant.chi_square):
            entries.append(f"chi_square = {_digits(constant.chi_square)}")
    return [*entries, f"logs = {constant.n_logs}", f"minutes = {_digits(constant.minutes)}"]


def _digits(value: float) -> str:
    """Return a number with six digits as a TOML float."""
    text = f"{value:.6g}"
    return text if any(mark in text for mark in ".en") else f"{text}.0"


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
