"""Clauses as one HTML page without scripts or network: the verdict, a picture of all margins, tables and sources."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from html import escape

from cwcli.conformance.clause import NUMBERS_AS_PUBLISHED_TEXT
from cwcli.conformance.page import CLAUSE_COLUMNS, clause_rows, detail_tables
from cwcli.conformance.results import FAILED, NOT_JUDGED, NOT_VALID, PASSED, ClauseResult, TrialResult
from cwcli.pipeline.result import SummaryTable
from cwcli.text import format_count
from cwcli.version import __version__

COLOUR_BY_OUTCOME = {PASSED: "#1c6fb8", FAILED: "#c02f2f", NOT_VALID: "#8a6d1a", NOT_JUDGED: "#777777"}
"""Outcome -> its colour; blue and red stay apart for the colour-blind, and marks differ in shape, too."""
(
    MARGIN_PLOT_ROW_HEIGHT_PX,
    NAME_COLUMN_WIDTH_PX,
    PLOT_COLUMN_WIDTH_PX,
    VALUE_COLUMN_WIDTH_PX,
    MARGIN_PLOT_AXIS_HEIGHT_PX,
) = 19, 300, 400, 200, 22
"""Size of the picture of margins, pixels: height of a row, widths of its three columns, height of the axis."""
AXIS_MARGIN_SHARE = 0.06
"""Share of the axis' range that is left free at each end."""
TICK_STEPS_S = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Steps of the axis' labels, s; the least that gives at most seven labels is taken."""
UNFOLDED_TABLE_KEY = "trials"
"""Key of the table that is shown unfolded."""
PAGE_STYLE_SHEET = """
body{font:14px/1.45 system-ui,sans-serif;color:#1b1b1b;max-width:70em;margin:2em auto;padding:0 1em}
h1{font-size:1.5em;margin-bottom:.2em}h2{font-size:1.2em;margin:2em 0 .3em;border-top:1px solid #ddd;padding-top:1em}
table{border-collapse:collapse;margin:.6em 0;font-size:.93em}td,th{text-align:left;padding:.2em .7em .2em 0;
border-bottom:1px solid #e5e5e5;vertical-align:top}th{font-weight:600}td.number{text-align:right;white-space:nowrap}
.badge{color:#fff;border-radius:.3em;padding:.05em .5em;font-weight:600;white-space:nowrap}p.quiet{color:#555}
details{margin:.5em 0}summary{cursor:pointer}svg{max-width:100%;height:auto}
"""


def format_html_page(results: Sequence[ClauseResult]) -> str:
    """Format clauses as a page: all verdicts first, then a section for each clause."""
    links = [
        [f'<a href="#{escape(row[0])}">{escape(row[0])}</a>', _outcome_badge_html(row[1]), *map(escape, row[2:])]
        for row in clause_rows(results)
    ]
    rule = ", ".join(
        dict.fromkeys(result.settings.get("system", result.settings.get("rule", "")) for result in results)
    )
    body = [
        f"<h1>Trials of {escape(rule)}: {_verdict_text(results)}</h1>",
        f'<p class="quiet">cwcli {escape(__version__)}; {NUMBERS_AS_PUBLISHED_TEXT}. '
        "Nothing is certified by this page. A margin is how much later the warning could have come; "
        "a negative one is how much too late or too early it came.</p>",
        _format_rows(CLAUSE_COLUMNS, links) if len(results) > 1 else "",
        *(_clause_section(result) for result in results),
    ]
    head = f'<meta charset="utf-8"><title>cwcli conform</title><style>{PAGE_STYLE_SHEET}</style>'
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body>\n' + "\n".join(body) + "\n</body></html>\n"


def _verdict_text(results: Sequence[ClauseResult]) -> str:
    """The verdict of one clause, or how many clauses have each."""
    if len(results) == 1:
        return _outcome_badge_html(results[0].outcome)
    counts = {outcome: sum(result.outcome == outcome for result in results) for outcome in COLOUR_BY_OUTCOME}
    return ", ".join(f"{count} {_outcome_badge_html(outcome)}" for outcome, count in counts.items() if count)


def _clause_section(result: ClauseResult) -> str:
    """One clause: verdict and settings, how it is read, the margins, and its tables."""
    clause = result.clause
    settings = ", ".join(f"{name} {value}" for name, value in result.settings.items())
    basis = "; ".join(filter(None, (clause.basis_text.capitalize(), clause.unchecked_text)))
    parts = [
        f'<h2 id="{escape(clause.name)}">{_outcome_badge_html(result.outcome)} {escape(clause.title)}</h2>',
        f"<p>{result.passed_text} trials pass, with {format_count(result.n_repetitions, 'repetition')} of each; "
        f"{escape(settings)}. Source: {escape(clause.source)}. {basis}.</p>",
        f"<p>How the numbers are read: {escape(clause.reading)}</p>" if clause.reading else "",
        _margin_picture(result.trials_with_repetitions),
    ]
    for table in detail_tables(result):
        text = _format_table(table)
        title = escape(table.title.partition(": ")[2])
        parts.append(
            text if table.key == UNFOLDED_TABLE_KEY else f"<details><summary>{title}</summary>{text}</details>"
        )
    return "\n".join(part for part in parts if part)


def _outcome_badge_html(outcome: str) -> str:
    """An outcome as a coloured word."""
    return f'<span class="badge" style="background:{COLOUR_BY_OUTCOME[outcome]}">{escape(outcome)}</span>'


def _format_table(table: SummaryTable) -> str:
    """A table; outcomes are badges and numbers stand right."""
    outcome = table.columns.index("outcome") if "outcome" in table.columns else -1
    rows = [
        [
            _outcome_badge_html(str(cell)) if k == outcome else escape("" if cell is None else str(cell))
            for k, cell in enumerate(row)
        ]
        for row in table.rows
    ]
    return _format_rows(table.columns, rows)


def _format_rows(columns: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    """Cells of HTML as a table."""
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    lines = ["<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows]
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def _margins_s_and_outcomes(trial: TrialResult) -> list[tuple[float, str]]:
    """Margin in seconds and outcome of each repetition that has such a margin."""
    verdicts = [(each.verdict, each.outcome) for each in trial.repetitions if each.verdict is not None]
    return [(v.margin, outcome) for v, outcome in verdicts if v.unit == "s" and math.isfinite(v.margin)]


def _margin_picture(trials: Sequence[TrialResult]) -> str:
    """A row for each trial, with a mark for each repetition on an axis of margins; "" where none has seconds."""
    found = {trial.trial.name: _margins_s_and_outcomes(trial) for trial in trials}
    margins = [margin for each in found.values() for margin, _ in each]
    if not margins:
        return ""
    low, high = min(0.0, *margins), max(0.0, *margins)
    spare = AXIS_MARGIN_SHARE * max(high - low, TICK_STEPS_S[0])
    low, high = low - spare, high + spare

    def margin_to_x_px(margin: float) -> float:
        return NAME_COLUMN_WIDTH_PX + PLOT_COLUMN_WIDTH_PX * (margin - low) / (high - low)

    height = MARGIN_PLOT_AXIS_HEIGHT_PX + MARGIN_PLOT_ROW_HEIGHT_PX * len(trials) + 4
    zero = margin_to_x_px(0.0)
    lines = [
        f'<rect x="{NAME_COLUMN_WIDTH_PX}" y="{MARGIN_PLOT_AXIS_HEIGHT_PX}" width="{zero - NAME_COLUMN_WIDTH_PX:.1f}" '
        f'height="{height - MARGIN_PLOT_AXIS_HEIGHT_PX}" fill="#fbeaea"/>',
        *_margin_axis_svg(low, high, margin_to_x_px, height),
        f'<line x1="{zero:.1f}" x2="{zero:.1f}" y1="{MARGIN_PLOT_AXIS_HEIGHT_PX}" y2="{height}" stroke="#c02f2f"/>',
    ]
    for k, trial in enumerate(trials):
        y = MARGIN_PLOT_AXIS_HEIGHT_PX + MARGIN_PLOT_ROW_HEIGHT_PX * (k + 0.5)
        text = f'y="{y + 4:.1f}" font-size="12"'
        lines.append(f'<text x="0" {text}>{escape(_shorten_keeping_end(trial.trial.name))}</text>')
        lines += [_outcome_mark_svg(margin_to_x_px(margin), y, outcome) for margin, outcome in found[trial.trial.name]]
        words = trial.margin_text or trial.worst_repetition_text
        colour = COLOUR_BY_OUTCOME[trial.outcome]
        lines.append(
            f'<text x="{NAME_COLUMN_WIDTH_PX + PLOT_COLUMN_WIDTH_PX + 10}" {text} fill="{colour}">'
            f"{trial.outcome}, {trial.passed_text}, {escape(words)}</text>"
        )
    width = NAME_COLUMN_WIDTH_PX + PLOT_COLUMN_WIDTH_PX + VALUE_COLUMN_WIDTH_PX
    return (
        f'<svg viewBox="0 0 {width} {height}" width="{width}" role="img" aria-label="margins of all repetitions">'
        f"{''.join(lines)}</svg>"
    )


def _margin_axis_svg(low: float, high: float, place: Callable[[float], float], height: float) -> list[str]:
    """Lines and labels of the axis of margins, s."""
    step = next((step for step in TICK_STEPS_S if (high - low) / step <= 7), 10.0 * TICK_STEPS_S[-1])
    ticks = [step * k for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
    lines = ['<text x="0" y="14" font-size="12" fill="#555">margin to the required number, s</text>']
    for tick in ticks:
        x = place(tick)
        lines.append(
            f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{MARGIN_PLOT_AXIS_HEIGHT_PX}" y2="{height}" stroke="#e2e2e2"/>'
        )
        lines.append(
            f'<text x="{x:.1f}" y="14" font-size="12" fill="#555" text-anchor="middle">{_tick_text(tick)}</text>'
        )
    return lines


def _tick_text(margin_s: float) -> str:
    """A margin with its sign, which zero has not."""
    return f"{margin_s:+.1f}" if margin_s else "0"


def _outcome_mark_svg(x: float, y: float, outcome: str) -> str:
    """A disc for a repetition that passes, a cross for one that fails, a ring for one that is not valid."""
    colour = COLOUR_BY_OUTCOME[outcome]
    if outcome == FAILED:
        path = f"M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8"
        return f'<path d="{path}" stroke="{colour}" stroke-width="2"/>'
    fill = colour if outcome == PASSED else "none"
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{fill}" fill-opacity=".55" stroke="{colour}"/>'


def _shorten_keeping_end(name: str, length: int = 46) -> str:
    """A name that fits its column; its end tells the trials apart."""
    if len(name) <= length:
        return name
    end = name.rpartition(", ")[2]
    return f"{name[: max(length - len(end) - 3, 6)]}... {end}"
