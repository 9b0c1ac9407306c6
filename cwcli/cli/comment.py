"""The comment of `cwcli compare` under a pull request: the worst log first, both sides beside each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from cwcli.cli import markdown
from cwcli.cli.text import format_count, format_number, join_names

if TYPE_CHECKING:
    from cwcli.metrics.log_changes import LogChange

MAX_COMMENT_CHARS = 60_000
"""Longest comment in characters. GitHub refuses a body of more than 65,536; the rest is for what a job adds."""
MAX_METRICS_LISTED_PER_LOG = 20
"""Greatest number of metrics that the table of one log lists. Chosen by hand."""
MAX_LEFT_OUT_LOGS_NAMED = 10
"""Greatest number of left-out logs that the last sentence names. Chosen by hand."""
MAX_LOG_NAME_CHARS = 200
"""Longest log name, in characters, that is shown in full; chosen by hand."""
PARAGRAPH_SEPARATOR = "\n\n"
"""The blank line between two paragraphs of the comment."""
LOG_CHANGES_HEADINGS = ("metric", "unit", "value before", "value after", "change")
"""Headings of the table of a log."""


def format_comment(summary: str, logs: Sequence[LogChange], n_pairs: int) -> str:
    """Format the comment.

    Args:
        summary: Markdown about all logs together; what comes of it is cut at a paragraph.
        logs: The logs that differ, the worst first.
    """
    text, is_cut = _cut_at_paragraph_and_tell_if_cut(summary.rstrip(), MAX_COMMENT_CHARS // 2)
    parts = [text]
    if is_cut:
        parts.append("The rest of this summary is left out; `cwcli compare --markdown` writes all of it.")
    n_same = n_pairs - sum(not log.error for log in logs)
    parts.append(f"#### {format_count(len(logs), 'log')} with changes, {n_same} without")
    length = sum(len(part) + len(PARAGRAPH_SEPARATOR) for part in parts)
    for k, log in enumerate(logs):
        section = format_changes_of_log(log)
        rest = _left_out_sentence(logs[k + 1 :])  # if this section is taken, this must fit behind it
        needed = len(section) + len(PARAGRAPH_SEPARATOR) + len(rest) + len(PARAGRAPH_SEPARATOR)
        if length + needed > MAX_COMMENT_CHARS:
            parts.append(_left_out_sentence(logs[k:]))
            break
        parts.append(section)
        length += len(section) + len(PARAGRAPH_SEPARATOR)
    return PARAGRAPH_SEPARATOR.join(parts) + "\n"


def format_changes_of_log(log: LogChange) -> str:
    """Format what changed on one log."""
    name = markdown.format_code(_shorten_name(log.id))
    if log.error:
        return f"**{name}** failed: {markdown.format_code(_shorten_name(log.error))}"
    rows: list[tuple[str | float | None, ...]] = [
        (
            markdown.format_code(change.metric),
            markdown.format_code(change.unit) if change.unit else "",
            format_number(change.before),
            format_number(change.after),
            _format_change_with_direction(change.direction.value, change.worsening, change.before, change.after),
        )
        for change in log.changes[:MAX_METRICS_LISTED_PER_LOG]
    ]
    more = len(log.changes) - MAX_METRICS_LISTED_PER_LOG
    directions = Counter(change.direction.value for change in log.changes)
    counts_text = ", ".join(
        f"{directions[word]} {word}" for word in ("worse", "gone", "better", "new") if directions[word]
    )
    parts = [f"**{name}**: {counts_text}", markdown.format_markdown_table(LOG_CHANGES_HEADINGS, rows)]
    if more > 0:
        parts.append(f"and {format_count(more, 'more metric')}")
    return "\n\n".join(parts)


def _format_change_with_direction(word: str, worsening: float, before: float, after: float) -> str:
    """Return the direction with the change as a share of the value before, where there is one."""
    if not worsening or not before:
        return word
    return f"{word}, {100.0 * (after - before) / abs(before):+.3g} %"


def _left_out_sentence(logs: Sequence[LogChange]) -> str:
    """Return the last sentence of a comment that is cut."""
    names = [markdown.format_code(_shorten_name(log.id)) for log in logs[:MAX_LEFT_OUT_LOGS_NAMED]]
    more = len(logs) - len(names)
    named = join_names([*names, *([f"{more} more"] if more else [])])
    verb = "is" if len(logs) == 1 else "are"
    return (
        f"{format_count(len(logs), 'log')} with smaller changes {verb} left out, because a comment has at most "
        f"{MAX_COMMENT_CHARS:,} characters: {named}."
    )


def _cut_at_paragraph_and_tell_if_cut(text: str, limit: int) -> tuple[str, bool]:
    """Cut a text behind its last whole paragraph within a length; whether it was cut."""
    if len(text) <= limit:
        return text, False
    return text[: max(text.rfind("\n\n", 0, limit), 0)], True


def _shorten_name(text: str) -> str:
    """Cut a long name."""
    return text if len(text) <= MAX_LOG_NAME_CHARS else f"{text[:MAX_LOG_NAME_CHARS]}..."
