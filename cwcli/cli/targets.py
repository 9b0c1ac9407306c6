"""What the commands that look at runs write: a table, and summaries."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.cli.options.shared import TalkOptions
from cwcli.errors import UsageError


def check_targets(talk: TalkOptions, *, metrics: str | None, texts: Sequence[str | None], force: bool) -> list[str]:
    """Refuse what can't be written before the work; returns the files that will be.

    Raises:
        UsageError: Two of them, or --json, want the same place.
        OutputError: A file exists or can't be made.
    """
    from cwcli.metrics.table import check_table_target
    from cwcli.output import check_target

    named = [name for name in (metrics, *texts) if name is not None]
    if len(set(named)) < len(named):
        raise UsageError("two outputs have the same name", where=next(name for name in named if named.count(name) > 1))
    if talk.json and "-" in named:
        raise UsageError("--json and --markdown - both want standard output", hint="write the summary to a file")
    if metrics is not None:
        check_table_target(metrics, force=force)
    for name in texts:
        if name is not None:
            check_target(name, force=force)
    return [name for name in named if name != "-"]
