"""Converts a stage's annotated configuration (`cwcli.option`) to options of a command, and options to a stage call."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from cwcli.cli.options.entries import OptionEntry, option_entries_of_stage
from cwcli.cli.options.lazy_typer import Declaration
from cwcli.cli.options.shared import SensorOptions
from cwcli.errors import UsageError
from cwcli.option import Option
from cwcli.pipeline.call import StageCall
from cwcli.pipeline.stage import Stage
from cwcli.registry import import_target
from cwcli.stages import STAGES

if TYPE_CHECKING:
    from cwcli.estimation.calibration import Calibration


class StageOptions:
    """Base class of the options of one stage; the classes are generated.

    Their environment variables and their table in the configuration file carry the stage's name. In a command that
    runs several stages their flags do too: `--model` of `cwcli estimate` is `--estimate-model` of `cwcli run`.
    There they stand under a heading of their own.

    Attributes:
        stage: Name of the stage.
    """

    stage: ClassVar[str]

    def option_values(self) -> dict[str, Any]:
        """All options and their values, in the form of a configuration file."""
        return dict(vars(self))


@functools.cache
def make_stage_options_class(name: str) -> type[StageOptions]:
    """Make a dataclass of a stage's options; its instances are not validated."""
    fields: list[Any] = [
        (entry.key, Annotated[entry.kind, _make_typer_option(entry)], _field_default(entry.default))
        for entry in option_entries_of_stage(name)
    ]
    return dataclasses.make_dataclass(
        f"{STAGES[name].python_name}_options",
        fields,
        bases=(StageOptions,),
        frozen=True,
        namespace={"stage": name},
    )


def make_all_stage_options_classes() -> tuple[type[StageOptions], ...]:
    """Make the option classes of all stages, in the order in which they run."""
    return tuple(map(make_stage_options_class, STAGES))


def _field_default(default: Any) -> Any:
    return dataclasses.field(default_factory=default.copy) if isinstance(default, list) else default


def _make_typer_option(entry: OptionEntry) -> Any:
    def settings() -> dict[str, Any]:
        option = entry.option
        registry = import_target(option.choices) if option.choices else None
        text = option.help if isinstance(option.help, str) else option.help()
        if registry is not None:
            text = text.replace("{choices}", registry.format_help()).replace("{names}", ", ".join(registry))
        return {
            "metavar": option.metavar,
            "help": text,
            "show_default": option.default or (entry.default is not None and entry.default != []),
            "autocompletion": None if registry is None else registry.completions,
        }

    return Declaration("Option", (entry.option.flags,), settings)


def stage_call_from_options(
    options: StageOptions, sensors: SensorOptions, calibration: Calibration | None = None
) -> StageCall:
    """Make the call of a stage from its options, the sensor options and a calibration.

    Raises:
        UsageError: A value is invalid.
    """
    stage = STAGES[options.stage]
    given = {
        entry.path: _parse_value(entry.option, value)
        for entry in option_entries_of_stage(stage.name)
        if (value := getattr(options, entry.key)) != entry.default
    }
    config = _replace_nested_fields(stage.configuration_class(), given)
    if hasattr(config, "sources"):
        sources = dataclasses.replace(config.sources, clock=sensors.clock, ego_station=sensors.ego_station)
        config = dataclasses.replace(config, sources=sources)
    if calibration is not None and hasattr(config, "calibration"):
        config = dataclasses.replace(config, calibration=calibration)
    return StageCall(stage, config)


def _parse_value(option: Option, value: Any) -> Any:
    low, high = option.above, option.at_most
    if value is not None and ((low is not None and not value > low) or (high is not None and not value <= high)):
        bounds = [f"above {low:g}"] if low is not None else []
        bounds += [f"at most {high:g}"] if high is not None else []
        raise UsageError(f"{option.flags} {value:g} must be {' and '.join(bounds)}")
    return option.parse(value) if option.parse else value


def _replace_nested_fields(default: Any, given: Mapping[tuple[str, ...], Any]) -> Any:
    """Replace fields of a configuration, also nested ones, by the values at their paths."""
    changes = {path[0]: value for path, value in given.items() if len(path) == 1}
    for name in dict.fromkeys(path[0] for path in given if len(path) > 1):
        inside = {path[1:]: value for path, value in given.items() if len(path) > 1 and path[0] == name}
        changes[name] = _replace_nested_fields(getattr(default, name), inside)
    return dataclasses.replace(default, **changes) if changes else default


def uses_calibration(stage: Stage) -> bool:
    """Whether the stage, or one that its command runs first, uses a calibration."""
    return any(hasattr(STAGES[name].configuration_class(), "calibration") for name in (stage.name, *stage.first))


def command_reads_sensor_messages(stage: Stage) -> bool:
    """Whether the stage, or one that its command runs first, reads sensor messages."""
    return any(hasattr(STAGES[name].configuration_class(), "sources") for name in (stage.name, *stage.first))
