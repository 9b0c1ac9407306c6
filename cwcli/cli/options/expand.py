"""Lets a command take its options as dataclasses.

`def command(log: LogArgument, reading: ReadingOptions)` becomes a function with one keyword per field of
`ReadingOptions`, which is what Typer reads. So an option is declared once, and a command's signature stays short.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import typing
from collections.abc import Callable, Collection, Sequence
from typing import Any

from cwcli.cli.options.configfile import STAGE_SEPARATOR
from cwcli.cli.options.lazy_typer import Declaration, change_declaration
from cwcli.cli.options.stage import StageOptions

ENVIRONMENT_PREFIX = "CWCLI"
"""Beginning of the names of environment variables that set options."""
STAGES_PARAMETER = "stages"
"""Name of the parameter that receives the options of all stages, by stage."""
_OptionChange = Callable[[Declaration], Declaration]


def expand_dataclass_parameters(
    function: Callable[..., Any],
    command: str,
    *,
    stages: Sequence[type[StageOptions]] = (),
    without: Collection[str] = (),
) -> Callable[..., Any]:
    """Wrap a function so that its dataclass parameters are replaced by their fields.

    Args:
        stages: The stages whose options the command has.
        without: Parameters that the command does not offer; they take their defaults.
    """
    hints = typing.get_type_hints(function, include_extras=True)
    hints.pop("return", None)
    of_stages = {kind.stage: kind for kind in stages}
    named = [
        item for name in hints for item in (of_stages.items() if name == STAGES_PARAMETER else [(name, hints[name])])
    ]
    parameters: list[inspect.Parameter] = []
    groups: dict[str, tuple[type[Any], dict[str, str]]] = {}
    plain: list[str] = []
    for name, hint in named:
        if not dataclasses.is_dataclass(hint):
            default = inspect.signature(function).parameters[name].default
            parameters.append(
                _keyword_parameter(
                    name,
                    _hint_with_changed_option(hint, [_change_that_sets_environment_variable(ENVIRONMENT_PREFIX, name)]),
                    default,
                )
            )
            plain.append(name)
            continue
        assert isinstance(hint, type)
        fields = {} if name in without else dict(_fields_as_parameters(hint, command))
        parameters += fields.values()
        groups[name] = (hint, {field: parameter.name for field, parameter in fields.items()})

    @functools.wraps(function)
    def call_with_dataclasses(**values: Any) -> Any:
        arguments = {name: values[name] for name in plain}
        dataclasses_by_name = {
            name: kind(**{of: values[at] for of, at in fields.items()}) for name, (kind, fields) in groups.items()
        }
        arguments |= {name: options for name, options in dataclasses_by_name.items() if name not in of_stages}
        if of_stages:
            arguments[STAGES_PARAMETER] = {name: dataclasses_by_name[name] for name in of_stages}
        return function(**arguments)

    signature = inspect.Signature(sorted(parameters, key=lambda parameter: parameter.kind))
    call_with_dataclasses.__dict__["__signature__"] = signature
    call_with_dataclasses.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return call_with_dataclasses


def _fields_as_parameters(kind: type[Any], command: str) -> list[tuple[str, inspect.Parameter]]:
    """Convert the fields of a dataclass to parameters, by field name."""
    stage = kind.stage if issubclass(kind, StageOptions) else None
    hints = typing.get_type_hints(kind, include_extras=True)
    found = []
    for field in dataclasses.fields(kind):
        hint = hints[field.name]
        default = field.default
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        changes: list[_OptionChange] = []
        if stage is None:
            if hasattr(kind, "heading"):
                changes.append(_change_that_sets_help_heading(kind.heading))
            name = field.name
            changes.append(_change_that_sets_environment_variable(ENVIRONMENT_PREFIX, field.name))
        else:
            changes.append(_change_that_sets_help_heading("Options" if stage == command else f"Stage {stage}"))
            prefix = stage.replace("-", "_")
            changes.append(_change_that_sets_environment_variable(f"{ENVIRONMENT_PREFIX}_{prefix}", field.name))
            name = field.name if stage == command else f"{prefix}{STAGE_SEPARATOR}{field.name}"
            if stage != command:
                changes.append(_change_that_adds_stage_to_flags(stage))
        hint = _hint_with_changed_option(hint, changes)
        found.append((field.name, _keyword_parameter(name, hint, default)))
    return found


def _keyword_parameter(name: str, hint: Any, default: Any) -> inspect.Parameter:
    if default is dataclasses.MISSING:
        default = inspect.Parameter.empty
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint)


def _change_that_sets_environment_variable(prefix: str, name: str) -> _OptionChange:
    """Return the change that gives an option its environment variable: `CWCLI_START`, `CWCLI_ESTIMATE_MODEL`."""
    return lambda option: option.change(envvar=f"{prefix}_{name}".upper(), show_envvar=False)


def _change_that_sets_help_heading(heading: str | None) -> _OptionChange:
    """Return the change that puts an option under a heading of the help."""
    return lambda option: option.change(rich_help_panel=heading)


def _change_that_adds_stage_to_flags(stage: str) -> _OptionChange:
    """Return the change that adds the stage's name to an option's flags."""

    def add_stage_to_flags(option: Declaration) -> Declaration:
        long = [flag for part in option.flags for flag in part.split("/") if flag.startswith("--")]
        renamed = [f"--no-{stage}-{flag[5:]}" if flag.startswith("--no-") else f"--{stage}-{flag[2:]}" for flag in long]
        return option.change(flags=("/".join(renamed),))

    return add_stage_to_flags


def _hint_with_changed_option(hint: Any, changes: Sequence[_OptionChange]) -> Any:
    """Change the option in a type hint, once, because `typing` takes long for each hint; an argument stays."""

    def change_all_flag_names_of_declaration(found: Declaration) -> Declaration:
        for change in changes if found.kind == "Option" else ():
            found = change(found)
        return found

    return change_declaration(hint, change_all_flag_names_of_declaration)
