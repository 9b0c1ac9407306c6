"""The options of each stage, listed once (`cwcli.pipeline.stage_options`)."""

from __future__ import annotations

import functools

from cwcli.pipeline.stage_options import OptionEntry, iter_option_entries
from cwcli.stages import STAGES


@functools.cache
def option_entries_of_stage(name: str) -> tuple[OptionEntry, ...]:
    """List the options of a stage.

    Raises:
        UsageError: The stage's module is missing.
    """
    return tuple(iter_option_entries(STAGES[name].configuration_class()))
