"""What a field of a configuration is called on the command line; an annotation of the field.

    horizon_s: Annotated[float, Option("--horizon", metavar="SECONDS", help="How far ahead to predict.")] = 2.5

`cwcli.cli.options.stage` makes the command's options from it: name and default of a value stand once. This knows of no
command line library.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cwcli.lazy_dataclass import dataclass


@dataclass(frozen=True)
class Option:
    """A command-line option that sets a field of a configuration.

    Attributes:
        flags: `--horizon`, or `--tune/--no-tune`.
        help: Help text, or a function that returns it; `{choices}` stands for names and summaries of the registry
            `choices`, `{names}` for its names.
        metavar: Placeholder of the value in the help; None: derived from the type.
        default: Default in the help, where the value itself does not show it.
        choices: `module:NAME` of the registry whose keys are valid values, "" for none; a shell completes them.
        above, at_most: Bounds of the value, the lower one exclusive; None for no bound.
        kind: Type of the option's value, where it is not the field's.
        parse: Converts the option's value to the field's; called only if the option was given.
    """

    flags: str
    help: str | Callable[[], str]
    metavar: str | None = None
    default: str | None = None
    choices: str = ""
    above: float | None = None
    at_most: float | None = None
    kind: Any = None
    parse: Callable[[Any], Any] | None = None
