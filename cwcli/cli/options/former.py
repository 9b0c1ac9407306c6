"""Stages that were once an option of another: the old spellings go on, and say what replaces them.

`predict --from observer` is `predict-lane`: on the command line, in `cwcli run` (`--predict-from observer`), in the
environment and in configuration files. The options that were the new stage's then go to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import typer

from cwcli.cli.options.entries import Entry, entries, key_of


@dataclass(frozen=True)
class Former:
    """An option some of whose values are stages now.

    Attributes:
        flag: As it was spelled.
        stages: Value -> the stage.
        usual: Its other value, if it had no more and is gone; "" for an option that goes on as a list of names.
    """

    flag: str
    stages: Mapping[str, str]
    usual: str = ""


FORMER: dict[str, dict[str, Former]] = {
    "predict": {"origin": Former("--from", {"observer": "predict-lane"}, usual="states")},
    "warn": {
        "source": Former("--source", {"targets": "warn-targets"}, usual="v2x"),
        "rules": Former("--rules", {"lane-departure": "warn-lane"}),
    },
}
"""Stage -> key of the option -> what became of it."""


def former_fields(stage: str) -> list[tuple[str, Any, Any]]:
    """Name, annotated type and default of the stage's hidden options: the old ones, and those that went with them."""
    found: dict[str, tuple[str, Any, Any]] = {}
    own = {entry.key for entry in entries(stage)}
    for key, former in FORMER.get(stage, {}).items():
        if former.usual:
            kind: Any = Literal.__getitem__((former.usual, *former.stages))
            found[key] = (key, _hidden(kind, former.flag), former.usual)
        for moved in former.stages.values():
            for entry in entries(moved):
                if entry.key not in own:
                    found.setdefault(entry.key, (entry.key, _hidden(entry.kind, entry.option.flags), entry.default))
    for key, entry in respelled(stage).items():
        found[key] = (key, _hidden(entry.kind, entry.option.former), entry.default)
    return list(found.values())


def respelled(stage: str) -> dict[str, Entry]:
    """Key as it was once spelled -> the option, of the stage and of those whose options were once its own."""
    moved = (name for former in FORMER.get(stage, {}).values() for name in former.stages.values())
    every = (entry for name in (stage, *moved) for entry in entries(name))
    return {key_of(entry.option.former): entry for entry in every if entry.option.former}


def _hidden(kind: Any, flags: str) -> Any:
    return Annotated[kind, typer.Option(flags, hidden=True)]
