"""Checks the names of output files before any work is done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cwcli.cli.options.configfile import TalkOptions
from cwcli.errors import UsageError


def check_file_suffix(output: str, suffixes: Sequence[str], *, what: str, required: bool = True) -> str:
    """Check that the suffix of a file name fits the format that is written.

    Args:
        output: Name of the file, or `-` for standard output, which has no suffix.
        suffixes: Those of the formats, in lower case, with their dots; the first is the usual one.
        what: What is written, with its article: "an image".
        required: Refuse a name without a suffix, too; else it may be a device or a pipe.

    Returns:
        The suffix in lower case, or "".

    Raises:
        UsageError: The name has another suffix, or none where one is required.
    """
    suffix = "" if output == "-" else Path(output).suffix.lower()
    if suffix not in suffixes and (suffix or required):
        *others, last = suffixes
        known = f"{', '.join(others)} or {last}" if others else last
        raise UsageError(
            f"-o {output}: {what} ends in {known}",
            hint=f"-o {Path(output).stem or 'output'}{suffixes[0]}",
        )
    return suffix


def check_outputs_and_list_file_names(
    sources: Sequence[str], talk: TalkOptions, *, metrics: str | None, texts: Sequence[str | None], force: bool
) -> list[str]:
    """Check before the work that outputs can be written; returns their names without standard output.

    Raises:
        UsageError: Two of them, or --json, want the same place.
        OutputError: A file exists, is one of the sources, or can't be made.
    """
    from cwcli.metrics.table import check_table_file_name
    from cwcli.output import refuse_unwritable_targets

    if talk.json and "-" in texts:
        raise UsageError("--json and the output - both want standard output", hint="write the summary to a file")
    if metrics is not None:
        check_table_file_name(metrics)
    refuse_unwritable_targets((metrics, *texts), force=force, inputs=sources)
    return [name for name in (metrics, *texts) if name not in (None, "-")]
