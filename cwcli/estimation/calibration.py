"""What is known of a car's sensors from earlier drives: one TOML file a car, written by `cwcli calibrate`.

    cwcli_calibration = 1
    logs = ["monday.mcap", "tuesday.mcap"]
    minutes = 41.3

    ["/gps/fix".position]
    latency_s = { status = "found", value = 0.103, sigma = 0.004, spread = 0.0, logs = 2, minutes = 41.3, ... }

A value without a sigma is exact, so a file may be written by hand. `interval`, `chi_square` and the evidence are for
people.
Errors are one line: file, key, what is wrong, what is permitted.
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
MOTION = "motion"
"""The table of what belongs to the driver and the car and not to a sensor."""


@dataclass(frozen=True)
class Name:
    """A constant that a calibration may hold.

    Attributes:
        low, high: Where its value lies.
        unit: For messages.
        of: The quantities that have it.
    """

    low: float
    high: float
    unit: str
    of: tuple[str, ...]


RATES = ("accel", "yaw_rate")
MEASURED = ("position", "velocity", "speed", "heading", *RATES)
QUANTITIES = (*MEASURED, "imu", "camera")
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
"""Constant -> its range and the quantities that have it."""
EVIDENCE = ("distance_km", "accel_rms_mps2", "yaw_rate_rms_radps")
CLEAR_SIGMAS = 3.0
"""What drives disagree on is clear of zero by so many sigmas of their scatter."""
FIELDS = ("status", "value", "sigma", "spread", "interval", "chi_square", "logs", "minutes")


class ConstantStatus(StrEnum):
    """What the logs say of a constant.

    Attributes:
        REFERENCE: The latencies of the others are against this source; its own is zero by definition.
        FOUND: They agree.
        DISAGREE: They differ by more than their sigmas allow; `spread` says by how much.
        NOT_OBSERVABLE: No log shows it.
    """

    REFERENCE = "reference"
    FOUND = "found"
    DISAGREE = "logs disagree"
    NOT_OBSERVABLE = "not observable"


@dataclass(frozen=True)
class Constant:
    """A constant of a sensor, from one log or many.

    Attributes:
        status: What the logs say of it.
        value: NaN where it is not observable.
        sigma: One sigma of the value.
        spread: One sigma by which a drive differs from the next, beyond what the sigmas of the drives explain.
        chi_square: Reduced, of the logs about the value; NaN with one log.
        n_logs, minutes: The evidence.
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
        """It has a value."""
        return math.isfinite(self.value)

    @property
    def drive_sigma(self) -> float:
        """One sigma of it in another drive: 1.96 of them hold 95 %.

        The mean's variance plus that between drives (Higgins, Thompson and Spiegelhalter, 2009). A spread that few
        drives show is itself uncertain: Student's quantile of one degree of freedom less than drives counts.
        """
        both = math.hypot(self.sigma, self.spread)
        return both * student_factor(self.n_logs - 1) if self.spread > 0.0 and self.n_logs > 1 else both

    @property
    def is_clear_in_any_drive(self) -> bool:
        """Whether it may be taken as it is for a drive that does not show it: the drives agree on it, or it is clear of
        zero by more than they scatter."""
        if self.status is not ConstantStatus.DISAGREE:
            return self.is_known
        return abs(self.value) > CLEAR_SIGMAS * math.hypot(self.sigma, self.spread)

    @property
    def between_drives(self) -> float:
        """I^2: the part of the scatter that is between the drives and not in their sigmas (Higgins and Thompson, 2002);
        NaN with one log."""
        return max(0.0, 1.0 - 1.0 / self.chi_square) if self.chi_square > 0.0 else self.chi_square

    @property
    def interval(self) -> tuple[float, float]:
        """95 % of the value in another drive."""
        return self.value - 1.96 * self.drive_sigma, self.value + 1.96 * self.drive_sigma


UNKNOWN = Constant()
Constants = Mapping[str, Constant]


@dataclass(frozen=True)
class Calibration:
    """A car's constants.

    Attributes:
        name: Of its file, for messages.
        sensors: Source -> quantity -> constant's name -> the constant.
        motion: Name -> constant of the motion model.
        logs: Names of the logs that it comes from.
        minutes: Of driving.
        evidence: `EVIDENCE` -> value.
    """

    name: str
    sensors: Mapping[str, Mapping[str, Constants]]
    motion: Constants = field(default_factory=dict)
    logs: tuple[str, ...] = ()
    minutes: float = 0.0
    evidence: Mapping[str, float] = field(default_factory=dict)

    def of(self, source: str, kind: Kind | str, name: str) -> Constant:
        """A constant of a source's quantity; `UNKNOWN` where it has none."""
        quantity = kind if isinstance(kind, str) else kind.name.lower()
        return self.sensors.get(source, {}).get(quantity, {}).get(name, UNKNOWN)

    def knows(self, source: str, kind: Kind) -> bool:
        """Whether it says anything of a source's quantity."""
        return kind.name.lower() in self.sensors.get(source, {})


def load_calibration(source: str | Path) -> Calibration:
    """A calibration from its file.

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
    """A calibration from the content of its file.

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
    """The content of a calibration's file; `calibration_from_table` reads it back."""
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
    """What a run's record keeps of the calibration that it used: the file's content."""
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
    """Six digits, as a TOML float."""
    text = f"{value:.6g}"
    return text if any(mark in text for mark in ".en") else f"{text}.0"


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
