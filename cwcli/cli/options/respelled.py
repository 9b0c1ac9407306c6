"""Replaces old spellings of options by the current stages and options (`former`)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from cwcli.cli.console import Console
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.former import FORMER_OPTIONS, entries_by_former_key
from cwcli.cli.options.stage import StageOptions, make_stage_options_class


def replace_former_options(
    options: Mapping[str, StageOptions], wanted: Sequence[str]
) -> tuple[dict[str, StageOptions], tuple[str, ...], tuple[str, ...]]:
    """Replace old spellings of options.

    Args:
        options: Stage -> its options, for all stages to run.
        wanted: Names of the stages to run.

    Returns:
        The options by stage, the names of the stages, and notes on the replacements.
    """
    result, names, notes = dict(options), list[str](), list[str]()
    for name in wanted:
        usual = make_stage_options_class(name)()
        given = {key: value for key, value in vars(options[name]).items() if value != getattr(usual, key)}
        for key, entry in entries_by_former_key(name).items():
            if key in given:
                given[entry.key] = given.pop(key)
                notes.append(f"`{name} {entry.option.former}` is `{entry.option.flags}` now")
        base, places = name, [name]
        for key, former in FORMER_OPTIONS.get(name, {}).items():
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
            result.setdefault(place, make_stage_options_class(place)())
            fitting = {key: value for key, value in given.items() if key in result[place].option_values()}
            result[place] = dataclasses.replace(result[place], **fitting)  # type: ignore[type-var]
        notes += [
            f"{key} of `{name}` is an option of another stage now, and is not used"
            for key in given
            if not any(key in result[place].option_values() for place in places)
        ]
        names += places
    return result, tuple(dict.fromkeys(names)), tuple(notes)


def print_former_option_notes(talk: TalkOptions, notes: Sequence[str]) -> None:
    """Print one note on the old spellings that were replaced."""
    if notes:
        Console(quiet=talk.quiet).print_note("; ".join(notes))
