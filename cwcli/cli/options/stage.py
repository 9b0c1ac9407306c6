"""Converts a stage's annotated configuration (`cwcli.option`) to options of a command, and options to a stage call."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from cwcli.cli.options.lazy_typer import Declaration
from cwcli.cli.options.shared import SensorOptions
from cwcli.pipeline.call import StageCall
from cwcli.pipeline.stage import Stage
from cwcli.pipeline.stage_options import OptionEntry, SensorReading, configure_stage, option_entries_of_stage
from cwcli.registry import import_module_attribute
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
        (entry.key, Annotated[entry.kind, _make_typer_option(entry)], _copying_field_if_list(entry.default))
        for entry in option_entries_of_stage(STAGES[name])
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


def _copying_field_if_list(default: Any) -> Any:
    return dataclasses.field(default_factory=default.copy) if isinstance(default, list) else default


def _make_typer_option(entry: OptionEntry) -> Any:
    def settings() -> dict[str, Any]:
        option = entry.option
        registry = import_module_attribute(option.choices) if option.choices else None
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
    entries = option_entries_of_stage(stage)
    values = {entry.key: getattr(options, entry.key) for entry in entries}
    return configure_stage(stage, entries, values, SensorReading(sensors.clock, sensors.ego_station, calibration))


def uses_calibration(stage: Stage) -> bool:
    """Whether the stage, or one that its command runs first, uses a calibration."""
    return any(hasattr(STAGES[name].configuration_class(), "calibration") for name in (stage.name, *stage.first))


def command_reads_sensor_messages(stage: Stage) -> bool:
    """Whether the stage, or one that its command runs first, reads sensor messages."""
    return any(hasattr(STAGES[name].configuration_class(), "sources") for name in (stage.name, *stage.first))
