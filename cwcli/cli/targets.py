"""What the commands that look at runs write: a table, and summaries."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.cli.options.configfile import TalkOptions
from cwcli.errors import UsageError


def check_outputs(
    sources: Sequence[str], talk: TalkOptions, *, metrics: str | None, texts: Sequence[str | None], force: bool
) -> list[str]:
    """Refuse what can't or must not be written before the work; returns the files that will be.

    Raises:
        UsageError: Two of them, or --json, want the same place.
        OutputError: A file exists, is one of the sources, or can't be made.
    """
    from cwcli.metrics.table import check_table_name
    from cwcli.output import check_targets

    if talk.json and "-" in texts:
        raise UsageError("--json and --markdown - both want standard output", hint="write the summary to a file")
    if metrics is not None:
        check_table_name(metrics)
    check_targets((metrics, *texts), force=force, inputs=sources)
    return [name for name in (metrics, *texts) if name not in (None, "-")]
