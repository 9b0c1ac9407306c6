"""What a clause's trials came to: at most 12 lines of 80 columns, the same for the terminal and Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.conformance.clause import NUMBERS_AS_PUBLISHED_TEXT, format_unchecked_numbers
from cwcli.conformance.results import FAILED, NOT_JUDGED, NOT_VALID, PASSED, ClauseResult
from cwcli.text import format_count

MAX_DIGEST_LINES = 12
"""Largest number of lines of a digest."""
MAX_DIGEST_LINE_CHARACTERS = 80
"""Largest number of characters of a line."""
NAME_COLUMN_WIDTH_CHARACTERS = 40
"""Width of the column of names, characters."""
KEPT_NAME_END_CHARACTERS = 22
"""Width of the end of a long name that is kept, characters."""
_DIGEST_RANK_BY_OUTCOME = {FAILED: 0, NOT_VALID: 1, PASSED: 2, NOT_JUDGED: 3}
"""Outcome -> its place in the digest: what needs attention comes first."""


def format_digest(results: Sequence[ClauseResult]) -> list[str]:
    """Format the digest of one clause (a line a trial) or of several (a line a clause)."""
    if len(results) == 1:
        return _digest_of_clause(results[0])
    ordered = sorted(results, key=lambda result: _DIGEST_RANK_BY_OUTCOME[result.outcome])
    rows = [(result.clause.name, result.outcome, result.passed_text, result.worst_margin_text) for result in ordered]
    counts = ", ".join(
        f"{sum(result.outcome == outcome for result in results)} {outcome}"
        for outcome in _DIGEST_RANK_BY_OUTCOME
        if any(result.outcome == outcome for result in results)
    )
    heading = f"{format_count(len(results), 'clause')}: {counts} ({NUMBERS_AS_PUBLISHED_TEXT})"
    clauses = [result.clause for result in results]
    unchecked = format_unchecked_numbers(
        sum(clause.n_unchecked_numbers for clause in clauses), sum(clause.n_chosen_numbers for clause in clauses)
    )
    lines = [unchecked] if unchecked else []
    table = _format_rows(rows, MAX_DIGEST_LINES - 2 - len(lines), "clauses")
    return _cut_to_digest_size([heading, *table, *lines], "`cwcli conform NAME` shows the trials")


def _digest_of_clause(result: ClauseResult) -> list[str]:
    """The digest of one clause."""
    clause = result.clause
    driven = sorted(result.trials_with_repetitions, key=lambda trial: _DIGEST_RANK_BY_OUTCOME[trial.outcome])
    rows = [(trial.trial.name, trial.outcome, trial.passed_text, trial.margin_text) for trial in driven]
    settings = ", ".join(value if name == "grade" else f"{name} {value}" for name, value in result.settings.items())
    lines = []
    n_idle = len(result.trials) - len(driven)
    if n_idle or ("log" in result.settings and clause.n_required > 1):
        demand_text = f"{clause.n_required} of {clause.n_repetitions} repetitions" if clause.n_required > 1 else "each"
        lines.append(f"one trial of one log: the clause asks for {demand_text} of its {len(result.trials)} trials")
    trial = result.worst_trial
    repetition = None if trial is None else trial.worst_repetition
    if trial is not None and trial.outcome == FAILED and repetition is not None and repetition.verdict is not None:
        lines.append(f"worst: {trial.trial.name}: {repetition.verdict.text}")
    invalid = next((each for trial in driven for each in trial.repetitions if each.breaches), None)
    if invalid is not None:
        lines.append(f"not valid: {invalid.breaches[0]}")
    if clause.unchecked_text:
        lines.append(clause.unchecked_text)
    lines += result.notes
    heading = f"{clause.name}: {result.outcome} ({clause.basis_text}; {settings})"
    if len(heading) > MAX_DIGEST_LINE_CHARACTERS:
        heading = f"{clause.name}: {result.outcome} ({clause.basis_text})"
        lines.append(settings)
    table = _format_rows(rows, MAX_DIGEST_LINES - 2 - len(lines), "trials")
    return _cut_to_digest_size([heading, *table, *lines], "--details shows repetitions, numbers and sources")


def _cut_to_digest_size(lines: Sequence[str], last: str) -> list[str]:
    """The lines, cut to the digest's size, and a last one."""
    cut = [
        line if len(line) <= MAX_DIGEST_LINE_CHARACTERS else line[: MAX_DIGEST_LINE_CHARACTERS - 3] + "..."
        for line in lines
    ]
    return [*cut[: MAX_DIGEST_LINES - 1], last]


def _format_rows(rows: Sequence[tuple[str, str, str, str]], n_lines: int, words: str) -> list[str]:
    """Format headings and rows in columns, the first ones, and how many more there are."""
    n_rows = n_lines - 1  # without the line of the headings
    shown = list(rows[: n_rows if len(rows) <= n_rows else n_rows - 1])
    table = [(words.removesuffix("s"), "outcome", "passed", "margin"), *shown]
    lines = [
        f"  {_shorten_to_column(name):{NAME_COLUMN_WIDTH_CHARACTERS}} {outcome:10} {share:>9} {margin:>14}".rstrip()
        for name, outcome, share, margin in table
    ]
    if len(shown) < len(rows):
        left = rows[len(shown) :]
        failed = sum(row[1] == FAILED for row in left)
        lines.append(f"  and {len(left)} more {words}, {failed} of which fail")
    return lines


def _shorten_to_column(name: str) -> str:
    """A name that fits its column."""
    if len(name) <= NAME_COLUMN_WIDTH_CHARACTERS:
        return name
    last = name.rpartition(", ")[2][-KEPT_NAME_END_CHARACTERS:]  # the numbers, which tell the trials apart
    return f"{name[: NAME_COLUMN_WIDTH_CHARACTERS - len(last) - 3]}...{last}"
