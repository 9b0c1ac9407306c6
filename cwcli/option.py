"""What a field of a configuration is called on the command line; it stands beside the field, as an annotation.

    horizon_s: Annotated[float, Option("--horizon", metavar="SECONDS", help="How far ahead.")] = 2.5

`cwcli.cli.options.stage` makes the command's options from it: name and default of a value stand once. This knows of no
command line library.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Option:
    """An option.

    Attributes:
        flags: `--horizon`, or `--tune/--no-tune`.
        help: What it means, or what makes the text; `{choices}` stands for names and summaries of the registry
            `choices`, `{names}` for its names.
        metavar: What the help shows as its value; None: made from its type.
        default: What the help shows as its default, where the value itself does not say it.
        choices: `module:NAME` of the registry whose keys are its values, "" for none; a shell completes them.
        above, at_most: Where its value lies, None for no bound.
        kind: Its type, where that is not the field's.
        parse: Makes the field's value from the option's; called only if the option was given.
        former: As it was once spelled: `--lane-speed`, "" if it never was.
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
    former: str = ""
