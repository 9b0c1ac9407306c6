"""Imports the one command that is run, as a function with a keyword for each option."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from cwcli.cli.options.expand import expand_dataclass_parameters
from cwcli.cli.options.stage import make_all_stage_options_classes
from cwcli.pipeline.stage import import_named_module
from cwcli.stages import STAGES


def load_command_function_and_examples(name: str) -> tuple[Callable[..., Any], tuple[str, ...]]:
    """Import one command's module and make its function; returns it with its examples.

    Raises:
        UsageError: Its module is missing.
    """
    if name in STAGES:
        from cwcli.cli.stage_command import make_stage_command

        return make_stage_command(STAGES[name])
    module = import_named_module(f"cwcli.cli.commands.{name}", f"the command {name}")
    stages = make_all_stage_options_classes() if "stages" in inspect.signature(module.command).parameters else ()
    return expand_dataclass_parameters(module.command, name, stages=stages), module.EXAMPLES
