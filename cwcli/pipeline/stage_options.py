"""The options of a stage: the annotated fields of its configuration (`cwcli.option`), and the call that they make."""

from __future__ import annotations

import dataclasses
import functools
import keyword
import typing
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass
from cwcli.option import Option
from cwcli.pipeline.call import StageCall
from cwcli.pipeline.stage import Stage

if TYPE_CHECKING:
    from cwcli.estimation.calibration import Calibration

NAME_BY_OPTION_TYPE = {bool: "True or False", int: "an integer", float: "a number", str: "a text"}
"""Type of an option's value -> its name in error messages."""


@dataclass(frozen=True)
class OptionEntry:
    """An option of a stage and the field of the configuration that holds its value.

    Attributes:
        key: Name of the option in a configuration file and in Python.
        path: Names of the nested fields that lead to the value.
    """

    key: str
    path: tuple[str, ...]
    option: Option
    kind: Any
    default: Any


@dataclass(frozen=True)
class SensorReading:
    """How the stages of a run read sensor messages.

    Attributes:
        clock: Time of a measurement: "stamp", its header stamp, or "log", when it was logged.
        ego_station: The ego's own id in V2X messages, or None.
        calibration: Constants of the car's sensors from earlier drives, or None.
    """

    clock: str = "stamp"
    ego_station: str | None = None
    calibration: Calibration | None = None


@functools.cache
def option_entries_of_stage(stage: Stage) -> tuple[OptionEntry, ...]:
    """List the options of a stage.

    Raises:
        UsageError: The stage's module is missing.
    """
    return tuple(iter_option_entries(stage.configuration_class()))


def iter_option_entries(default: Any, path: tuple[str, ...] = ()) -> Iterator[OptionEntry]:
    """Yield the options of a stage's default configuration, nested ones included."""
    hints = typing.get_type_hints(type(default), include_extras=True)
    for field in dataclasses.fields(default):
        value, place = getattr(default, field.name), (*path, field.name)
        kind, *extras = typing.get_args(hints[field.name]) or (hints[field.name],)
        option = next((extra for extra in extras if isinstance(extra, Option)), None)
        if option is not None:
            kind = option.kind or kind
            shown_value = _empty_list_false_or_none_of_type(kind) if option.parse else value
            yield OptionEntry(configuration_key_of_option_flags(option.flags), place, option, kind, shown_value)
        elif dataclasses.is_dataclass(value):
            yield from iter_option_entries(value, place)


def configuration_key_of_option_flags(flags: str) -> str:
    """Name of an option in a configuration file: `tune` of `--tune/--no-tune`; `as_` of `--as`, a word of Python."""
    name = flags.partition("/")[0].removeprefix("--").replace("-", "_")
    return f"{name}_" if keyword.iskeyword(name) else name


def configure_stage(
    stage: Stage, entries: Iterable[OptionEntry], values: Mapping[str, Any], reading: SensorReading
) -> StageCall:
    """Make the call of a stage from the values of its options.

    Args:
        values: Key -> value of the options that are given, of their types; others keep their defaults.
        reading: How it reads sensor messages.

    Raises:
        UsageError: A value is invalid.
    """
    given_values = {
        entry.path: _parse_option_value_within_bounds(entry.option, values[entry.key])
        for entry in entries
        if entry.key in values and values[entry.key] != entry.default
    }
    config = _replace_nested_fields(stage.configuration_class(), given_values)
    if hasattr(config, "sources"):
        sources = dataclasses.replace(config.sources, clock=reading.clock, ego_station=reading.ego_station)
        config = dataclasses.replace(config, sources=sources)
    if reading.calibration is not None and hasattr(config, "calibration"):
        config = dataclasses.replace(config, calibration=reading.calibration)
    return StageCall(stage, config)


def check_option_values_from_python(
    stage: str, entries: Iterable[OptionEntry], values: Mapping[str, Any]
) -> dict[str, Any]:
    """Check names and types of options that a Python program gives.

    Args:
        stage: Name of the stage, for messages.
        values: Key -> value; a hyphen in a key counts as an underscore.

    Returns:
        Key -> value of its option's type.

    Raises:
        UsageError: There is no such option, or the value has another type.
    """
    known = {entry.key: entry for entry in entries}
    checked: dict[str, Any] = {}
    for option_name, value in values.items():
        key = str(option_name).replace("-", "_")
        if key not in known:
            raise UsageError(
                f"the stage {stage} has no option {option_name}",
                hint=hint_at_closest_or_all_known_names(key, known, "options"),
            )
        entry = known[key]
        is_default = value is None and entry.default is None
        checked[key] = None if is_default else _require_type(f"{stage}: {key}", entry.kind, value)
    return checked


def _require_type(name: str, kind: Any, value: Any) -> Any:
    """Return the value as the type of its option; raise `UsageError` if it has another type."""
    if typing.get_origin(kind) is typing.Literal:
        choices = typing.get_args(kind)
        if value not in choices:
            raise UsageError(
                f"{name} = {value!r} is not one of its values",
                hint=hint_at_closest_or_all_known_names(str(value), choices),
            )
        return value
    if typing.get_origin(kind) is list:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise UsageError(f"{name} = {value!r} must be a list")
        return [_require_type(name, typing.get_args(kind)[0], item) for item in value]
    kinds = [each for each in typing.get_args(kind) or (kind,) if each is not type(None)]
    if value is None and (len(typing.get_args(kind)) > len(kinds)):
        return None
    if float in kinds and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if str in kinds and hasattr(value, "__fspath__"):
        return str(value)
    is_bool = isinstance(value, bool)
    if any(isinstance(value, each) and (is_bool == (each is bool)) for each in kinds):
        return value
    raise UsageError(f"{name} = {value!r} must be {NAME_BY_OPTION_TYPE.get(kinds[0], str(kinds[0]))}")


def _empty_list_false_or_none_of_type(kind: Any) -> Any:
    """Default of an option whose text is parsed: an empty list, False or None."""
    return [] if typing.get_origin(kind) is list else False if kind is bool else None


def _parse_option_value_within_bounds(option: Option, value: Any) -> Any:
    """Return an option's value as the configuration takes it; raise `UsageError` if it is out of bounds."""
    low, high = option.above, option.at_most
    if value is not None and ((low is not None and not value > low) or (high is not None and not value <= high)):
        bounds = [f"above {low:g}"] if low is not None else []
        bounds += [f"at most {high:g}"] if high is not None else []
        raise UsageError(f"{option.flags} {value:g} must be {' and '.join(bounds)}")
    return option.parse(value) if option.parse else value


def _replace_nested_fields(default: Any, value_by_path: Mapping[tuple[str, ...], Any]) -> Any:
    """Replace fields of a configuration, also nested ones, by the values at their paths."""
    changes = {path[0]: value for path, value in value_by_path.items() if len(path) == 1}
    for name in dict.fromkeys(path[0] for path in value_by_path if len(path) > 1):
        inside = {path[1:]: value for path, value in value_by_path.items() if len(path) > 1 and path[0] == name}
        changes[name] = _replace_nested_fields(getattr(default, name), inside)
    return dataclasses.replace(default, **changes) if changes else default
