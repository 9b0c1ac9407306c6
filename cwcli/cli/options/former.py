"""Old options that are stages now; the old spellings are still accepted, with a note on the new ones.

`predict --from observer` is `predict-lane`: on the command line, in `cwcli run` (`--predict-from observer`), in the
environment and in configuration files. The options that moved to the new stage are passed on to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.entries import OptionEntry, config_key_of_flags, option_entries_of_stage
from cwcli.lazy_dataclass import dataclass


@dataclass(frozen=True)
class FormerOption:
    """An old option of which some values are stages now.

    Attributes:
        flag: The old flag.
        stages: Value -> the stage that replaces it.
        usual: The only other value of an option that was removed; "" for an option that still takes a list of names.
    """

    flag: str
    stages: Mapping[str, str]
    usual: str = ""


FORMER_OPTIONS: dict[str, dict[str, FormerOption]] = {
    "predict": {"origin": FormerOption("--from", {"observer": "predict-lane"}, usual="states")},
    "warn": {
        "source": FormerOption("--source", {"targets": "warn-targets"}, usual="v2x"),
        "rules": FormerOption("--rules", {"lane-departure": "warn-lane"}),
    },
}
"""Stage -> key of an old option -> the stages that replace it."""


def former_option_fields(stage: str) -> list[tuple[str, Any, Any]]:
    """List name, annotated type and default of a stage's hidden options: old ones and those moved to new stages."""
    found: dict[str, tuple[str, Any, Any]] = {}
    own = {entry.key for entry in option_entries_of_stage(stage)}
    for key, former in FORMER_OPTIONS.get(stage, {}).items():
        if former.usual:
            kind: Any = Literal.__getitem__((former.usual, *former.stages))
            found[key] = (key, _hidden_option(kind, former.flag), former.usual)
        for moved in former.stages.values():
            for entry in option_entries_of_stage(moved):
                if entry.key not in own:
                    found.setdefault(
                        entry.key, (entry.key, _hidden_option(entry.kind, entry.option.flags), entry.default)
                    )
    for key, entry in entries_by_former_key(stage).items():
        found[key] = (key, _hidden_option(entry.kind, entry.option.former), entry.default)
    return list(found.values())


def entries_by_former_key(stage: str) -> dict[str, OptionEntry]:
    """Former key -> option, for renamed options of the stage and of the stages that were split from it."""
    moved = (name for former in FORMER_OPTIONS.get(stage, {}).values() for name in former.stages.values())
    every = (entry for name in (stage, *moved) for entry in option_entries_of_stage(name))
    return {config_key_of_flags(entry.option.former): entry for entry in every if entry.option.former}


def _hidden_option(kind: Any, flags: str) -> Any:
    return Annotated[kind, typer.Option(flags, hidden=True)]
