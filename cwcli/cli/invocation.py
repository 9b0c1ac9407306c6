"""The command line as the user typed it, for suggestions that repeat it."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from contextvars import ContextVar

_ARGUMENTS_OF_RUNNING_COMMAND: ContextVar[tuple[str, ...]] = ContextVar("arguments", default=())
"""The arguments of the command that runs, without the program's name; () where there is none, as in Python."""


def remember_arguments(arguments: Sequence[str]) -> None:
    """Remember the arguments of the command that runs."""
    _ARGUMENTS_OF_RUNNING_COMMAND.set(tuple(arguments))


def repeat_command_with(*more: str) -> str:
    """Return the running command with more arguments, to be pasted; "" where that would not do the same again.

    What came out of standard input is gone, and a URL may hold a password.
    """
    arguments = _ARGUMENTS_OF_RUNNING_COMMAND.get()
    if not arguments or any(each in ("-", "--") or "://" in each for each in arguments):
        return ""
    return shlex.join(("cwcli", *arguments, *more))
