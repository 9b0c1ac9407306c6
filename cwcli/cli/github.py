"""Annotations of GitHub Actions: workflow commands that a job prints, and that the pull request then shows.

Escaping as in GitHub's own toolkit (actions/toolkit, packages/core/src/command.ts) and its page "Workflow commands for
GitHub Actions": in a message %, CR and LF, in a property also : and ,.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cwcli.cli.text import escape_control_characters, format_count
from cwcli.url import redact_urls

if TYPE_CHECKING:
    from cwcli.fleet.results import RunMetrics
    from cwcli.metrics.gates import GateResult

MAX_ANNOTATIONS_PER_KIND = 10
"""Greatest number of annotations of one kind that GitHub shows of a step; further ones are lost (GitHub's limits of
annotations)."""
MAX_FAILED_CHECKS_LISTED_PER_ANNOTATION = 20
"""Greatest number of failed checks that the message of one annotation lists. Chosen by hand."""
MAX_ANNOTATION_CHARACTERS = 4000
"""Longest message in characters; GitHub cuts what is longer than 4096 bytes in places. Chosen by hand."""


def format_error_command(message: str, *, title: str, file: str = "") -> str:
    """Format the workflow command `::error file=...,title=...::message`.

    Args:
        message: Lines of text. Other control characters than their ends are escaped as `\\x1b`.
        title: One line.
        file: Path in the repository, "" for none.
    """
    properties = {"file": file, "title": redact_urls(title)}
    named = ",".join(f"{name}={escape_property(text)}" for name, text in properties.items() if text)
    lines = [escape_control_characters(line) for line in redact_urls(message)[:MAX_ANNOTATION_CHARACTERS].split("\n")]
    return f"::error {named}::{escape_message(chr(10).join(lines))}"


def escape_message(text: str) -> str:
    """Escape the message of a workflow command."""
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def escape_property(text: str) -> str:
    """Escape the value of a property of a workflow command; control characters become `\\x1b` first."""
    return escape_message(escape_control_characters(text)).replace(":", "%3A").replace(",", "%2C")


def annotations_of_gates(run: RunMetrics, results: Sequence[GateResult]) -> list[str]:
    """Make one workflow command for each failed gate; its file is the first log on which the gate failed.

    Args:
        run: The run with the names of its logs' files.
    """
    sources = {log.id: log.source for log in run.logs}
    failed = [result for result in results if result.failed_checks]
    commands = []
    for result in failed[
        : MAX_ANNOTATIONS_PER_KIND if len(failed) <= MAX_ANNOTATIONS_PER_KIND else MAX_ANNOTATIONS_PER_KIND - 1
    ]:
        checks = result.failed_checks
        lines = [
            f"{check.log}: {check.detail}" if check.log else check.detail
            for check in checks[:MAX_FAILED_CHECKS_LISTED_PER_ANNOTATION]
        ]
        if len(checks) > MAX_FAILED_CHECKS_LISTED_PER_ANNOTATION:
            lines.append(f"and {len(checks) - MAX_FAILED_CHECKS_LISTED_PER_ANNOTATION} more")
        file = next((sources.get(check.log, "") for check in checks if check.log), "")
        commands.append(
            format_error_command(
                "\n".join(lines), title=f"gate failed: {result.gate}", file=path_in_repository_or_empty(file)
            )
        )
    more = failed[len(commands) :]
    if more:
        title = f"{format_count(len(more), 'more gate')} failed"
        commands.append(format_error_command("\n".join(result.gate for result in more), title=title))
    return commands


def annotations_of_changes(failed: Sequence[str]) -> list[str]:
    """Make workflow commands for the findings that `--fail-on` asks for; the last one holds those that are too many."""
    listed_alone = failed if len(failed) <= MAX_ANNOTATIONS_PER_KIND else failed[: MAX_ANNOTATIONS_PER_KIND - 1]
    together = ["\n".join(failed[len(listed_alone) :])] if len(failed) > len(listed_alone) else []
    return [format_error_command(line, title="cwcli compare") for line in (*listed_alone, *together)]


def path_in_repository_or_empty(name: str) -> str:
    """Return a file's path as GitHub takes it, relative to the checkout; "" for a URL or a file outside of it."""
    if not name or name == "-" or "://" in name:
        return ""
    root = Path(os.path.abspath(os.environ.get("GITHUB_WORKSPACE") or "."))  # noqa: PTH100 - links stay as they are
    path = Path(os.path.abspath(name))  # noqa: PTH100
    return path.relative_to(root).as_posix() if path.is_relative_to(root) else ""
