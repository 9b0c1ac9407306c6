"""Shell completion: of `--topic` roles, then the topics of the log on the command line; names of events."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from cwcli.cli.options import lazy_typer as typer

BASH_COMPLETION_REQUEST_VALUE = "complete_bash"
"""Value of Typer's variable that asks for bash completions."""
MAX_OFFERED_TOPICS = 500
"""Largest number of topics that are offered; chosen by hand."""


def complete_role_topics(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """Complete `ego_position=`, then `ego_position=/gps/fix`; an unreadable log gives no topics and no error."""
    from cwcli.channels.binding import DESCRIPTION_BY_ROLE

    return _matching_choices(ctx, incomplete, DESCRIPTION_BY_ROLE)


def complete_system_topics(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """Complete the roles of another system and their topics: `warning=/adas/fcw`."""
    from cwcli.evaluation.system_topics import ROLE_DESCRIPTIONS

    return _matching_choices(ctx, incomplete, ROLE_DESCRIPTIONS)


def complete_events(incomplete: str) -> list[tuple[str, str]]:
    """Complete the name of an event."""
    from cwcli.events import EVENTS

    return EVENTS.completions(incomplete)


def _matching_choices(ctx: typer.Context, incomplete: str, roles: Mapping[str, str]) -> list[tuple[str, str]]:
    role, sign, topic = incomplete.partition("=")
    matching = [(f"{name}=", words) for name, words in roles.items() if name.startswith(role)]
    if not sign and len(matching) != 1:
        return matching
    found: dict[str, str] = {}
    with contextlib.suppress(Exception):  # a message between two keys would spoil the line that is being typed
        found = {
            name: schema
            for log in _log_files_on_command_line(ctx)
            for name, schema in _iter_topics_and_schemas(log)
            if name.startswith(topic)
        }
    if not sign:  # offer its topics too, because most shells add a space after a single offer
        return [
            (f"{name}{each}", schema) for name, _ in matching for each, schema in _first_sorted_topics(found)
        ] or matching
    return [(f"{role}={each}", schema) for each, schema in _first_sorted_topics(found)]


def _first_sorted_topics(schema_by_topic: Mapping[str, str]) -> list[tuple[str, str]]:
    return sorted(schema_by_topic.items())[:MAX_OFFERED_TOPICS]


def _log_files_on_command_line(ctx: typer.Context) -> list[str]:
    """Names of existing MCAP files among the words before the cursor."""
    words: list[Any] = [*ctx.args]
    for parameter in ctx.command.get_params(ctx):
        if parameter.param_type_name == "argument" and parameter.name:
            value = ctx.params.get(parameter.name)
            words += value if isinstance(value, list | tuple) else [value]
    names = dict.fromkeys(word for word in words if isinstance(word, str))
    return [name for name in names if name.lower().endswith(".mcap") and Path(name).is_file()]


def _iter_topics_and_schemas(log: str) -> Iterator[tuple[str, str]]:
    """Yield topic and schema of each channel in the file's summary; nothing without a summary."""
    from cwcli.input import InputFile
    from cwcli.logs.format.records import MCAP_MAGIC
    from cwcli.logs.format.summary import find_footer_and_its_offset, read_summary_if_present
    from cwcli.logs.read.channels import channel_infos_from_index

    with InputFile.open(log) as file:
        found = find_footer_and_its_offset(file)
        index = None if found is None else read_summary_if_present(file, *found, len(MCAP_MAGIC), verify=False)
        if index is not None:
            for channel in channel_infos_from_index(index):
                if channel.topic.isprintable():
                    yield channel.topic, channel.schema_name if channel.schema_name.isprintable() else ""


def run_completion_with_bash_equals_fix(complete: Callable[[], object]) -> None:
    """Run Typer's completion; for bash, first join `ego_position=/gps`, which bash splits at the `=`.

    Bash then replaces only the text after the `=`, so only that part of each offer is printed.
    """
    if os.environ.get("_CWCLI_COMPLETE") != BASH_COMPLETION_REQUEST_VALUE or not _join_words_split_at_equals():
        complete()
        return
    captured = io.StringIO()
    try:
        with contextlib.redirect_stdout(captured):
            complete()
    finally:
        sys.stdout.writelines(f"{line.partition('=')[2]}\n" for line in captured.getvalue().splitlines())


def _join_words_split_at_equals() -> bool:
    """Join words that bash split at `=` in its variables; returns whether the word at the cursor holds `=`."""
    words, at = os.environ.get("COMP_WORDS", ""), os.environ.get("COMP_CWORD", "")
    if not at.isdecimal():
        return False
    joined_words: list[str] = []
    cursor = int(at)
    sign = "\n" if "\n" in words else " "  # a word may hold spaces
    for k, word in enumerate(words.split(sign)):
        if joined_words and (word == "=" or joined_words[-1].endswith("=")) and k <= int(at):
            joined_words[-1] += word
            cursor -= 1
        else:
            joined_words.append(word)
    os.environ["COMP_WORDS"], os.environ["COMP_CWORD"] = sign.join(joined_words), str(cursor)
    return 0 <= cursor < len(joined_words) and "=" in joined_words[cursor]
