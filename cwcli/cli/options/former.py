"""Stages that were once an option of another: the old spellings go on, and say what replaces them.

`predict --from observer` is `predict-lane`: on the command line, in `cwcli run` (`--predict-from observer`), in the
environment and in configuration files. The options that were the new stage's then go to it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import typer

from cwcli.cli.console import Console
from cwcli.cli.options.shared import TalkOptions
from cwcli.cli.options.stage import StageOptions, entries, stage_options


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
    return list(found.values())


def _hidden(kind: Any, flags: str) -> Any:
    return Annotated[kind, typer.Option(flags, hidden=True)]


def resolved(
    options: Mapping[str, StageOptions], wanted: Sequence[str]
) -> tuple[dict[str, StageOptions], tuple[str, ...], tuple[str, ...]]:
    """Replace old spellings.

    Args:
        options: Stage -> its options, at least of those that are wanted.
        wanted: The stages that are to run.

    Returns:
        The options, the stages, and notes on what replaces what was given.
    """
    result, names, notes = dict(options), list[str](), list[str]()
    for name in wanted:
        usual = stage_options(name)()
        given = {key: value for key, value in vars(options[name]).items() if value != getattr(usual, key)}
        base, places = name, [name]
        for key, former in FORMER.get(name, {}).items():
            values = [part.strip() for part in (given.pop(key, None) or "").split(",") if part.strip()]
            notes += [
                f"`{name} {former.flag} {value}` is the stage `{former.stages[value]}` now"
                for value in values
                if value in former.stages
            ]
            if former.usual:
                base = next((former.stages[value] for value in values if value in former.stages), base)
            elif values:
                places = list(dict.fromkeys(former.stages.get(value, name) for value in values))
                if kept := [value for value in values if value not in former.stages]:
                    given[key] = ",".join(kept)
        places = [base if place == name else place for place in places]
        for place in places:
            result.setdefault(place, stage_options(place)())
            fitting = {key: value for key, value in given.items() if key in result[place].values()}
            result[place] = dataclasses.replace(result[place], **fitting)  # type: ignore[type-var]
        notes += [
            f"{key} of `{name}` is an option of another stage now, and is not used"
            for key in given
            if not any(key in result[place].values() for place in places)
        ]
        names += places
    return result, tuple(dict.fromkeys(names)), tuple(notes)


def say_notes(talk: TalkOptions, notes: Sequence[str]) -> None:
    """Say what replaces old spellings, in one note."""
    if notes:
        Console(quiet=talk.quiet).note("; ".join(notes))
