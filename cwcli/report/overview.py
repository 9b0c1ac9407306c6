"""The overview of a run: what happened in all its logs, and the table of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cwcli.digest.story import Badge
from cwcli.errors import InputError
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.gates import GateResult
from cwcli.metrics.pooling import LogMetrics
from cwcli.report.gates import build_gate_views, gate_badge_of_run
from cwcli.report.page import OverviewRow, PageContent, PageRenderer
from cwcli.report.pooled import SourceInLog, pool_metrics, pool_sources
from cwcli.report.source import LogEntry, ReportedRun
from cwcli.report.tables import format_metric_value
from cwcli.report.tiles import TileServer
from cwcli.text import escape_control_characters, format_count
from cwcli.version import __version__

MAX_PAGE_BYTES = 5_900_000
"""The size of a page that sections are fitted into, in bytes; docs/report.md promises less than 6 MB."""
MAX_DOUBTFUL_LOGS_NAMED_IN_HEADLINE = 3
"""Greatest number of doubtful logs that the headline names; chosen by hand."""
MIN_LISTED_FAILURE_REASONS, MAX_LISTED_FAILURE_REASONS = 2, 8
"""Least and greatest number of reasons of failures that are listed; chosen by hand."""
MAX_ROWS_WITH_COLUMN_NAMES_IN_CELLS = 200
"""Greatest number of rows whose cells carry the names of their columns, for narrow screens. Chosen by hand: they take a
third of the table."""
MAX_ROWS_SHOWN_AT_ONCE = 300
"""Greatest number of rows that the browser lays out before it is asked for more. Chosen by hand: ten thousand take
seconds."""
DOUBTS_METRIC, MISSED_WARNINGS_METRIC = "doubts.count", "warnings.missed_count"
"""Metrics that count the doubts about a log, and the conflicts without a warning."""
OVERVIEW_METRICS_AND_HEADINGS = (
    (DOUBTS_METRIC, "doubts"),
    ("data.duration_s", "duration [s]"),
    ("warnings.count", "warnings"),
    (MISSED_WARNINGS_METRIC, "missed"),
    ("ego.position_rmse_m", "position RMSE [m]"),
    ("ego.position_nees", "NEES of position (2: right)"),
    ("ego.gated_share", "gated [share]"),
    ("lanes.found_share", "lanes found [share]"),
    ("data.rejected_count", "messages rejected"),
)
"""Metrics that the overview table shows, with their headings. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class Report:
    """The finished page.

    Attributes:
        html: The file's content.
        n_logs: In the run.
        n_detailed: Of them with figures.
        n_failed: That the run or a gate failed.
        left_out: Names of the logs without figures.
    """

    html: bytes
    n_logs: int
    n_detailed: int
    n_failed: int
    left_out: tuple[str, ...]


@dataclass
class LogCandidate:
    """A log, as far as it is known before its figures are made; those of the lowest rank come first.

    Doubts are counted where the run's digest stands for the log.
    """

    entry: LogEntry
    badges: list[Badge]
    rank: int
    n_warnings: int
    story: str = ""
    anchor: str = ""
    links: tuple[tuple[str, str], ...] = ()
    track: str = ""
    sources: tuple[SourceInLog, ...] = ()
    n_doubts: int = 0


def log_metrics_of_entry(entry: LogEntry) -> LogMetrics:
    """Convert a log of the run to the form that gates and pooling take."""
    error = entry.error.get("what", "it failed") if entry.has_failed else ""
    return LogMetrics(entry.id, entry.metrics, error)


def assemble_run_report(
    run: ReportedRun,
    candidates: list[LogCandidate],
    results: Sequence[GateResult],
    sections: list[str],
    renderer: PageRenderer,
) -> Report:
    """Assemble the report of a run.

    Args:
        candidates: Its logs, in the order of the table.

    Raises:
        InputError: The run has too many logs for a page.
    """
    columns = [
        (name, title)
        for name, title in OVERVIEW_METRICS_AND_HEADINGS
        if any(name in each.entry.metrics for each in candidates)
    ]
    rows = []
    for each in candidates:
        known = each.entry.metrics
        shown = tuple(
            format_metric_value(name, known[name].value if name in known else math.nan) for name, _ in columns
        )
        story = each.story or (format_count(each.n_warnings, "warning") if each.n_warnings else "no warning")
        rows.append(OverviewRow(each.anchor, each.entry.name, tuple(each.badges), story, shown, each.links, each.track))
    failed = [each for each in candidates if each.rank <= 1]
    left_out = tuple(each.entry.name for each in candidates if not each.anchor and each.entry.log is not None)
    anchors = {each.entry.id: each.anchor for each in candidates if each.anchor}
    sources, n_sources = pool_sources([source for each in candidates for source in each.sources], anchors)
    page = PageContent(
        title=run.name,
        headline=_run_headline(candidates),
        sentences=(*_failure_sentences(candidates), *_left_out_sentences(left_out, len(candidates))),
        badges=tuple(_build_run_badges(candidates, results)),
        gates=tuple(build_gate_views(results)),
        columns=tuple(title for _, title in columns),
        rows=tuple(rows),
        metrics=pool_metrics([log_metrics_of_entry(each.entry) for each in candidates], anchors),
        sources=sources,
        n_sources=n_sources,
        has_plain_cells=len(candidates) > MAX_ROWS_WITH_COLUMN_NAMES_IN_CELLS,
        n_shown_rows=MAX_ROWS_SHOWN_AT_ONCE,
        footer=footer_sentences(renderer.tiles),
    )
    html = renderer.render_page(page, sections).encode()
    if len(html) > MAX_PAGE_BYTES * 1.5:
        raise InputError(f"the run has so many logs ({len(candidates)}) that the page would be {len(html)} bytes long")
    return Report(html, len(candidates), len(sections), len(failed), left_out)


def _failure_sentences(candidates: Sequence[LogCandidate]) -> list[str]:
    """Say why logs failed, the most frequent reason first."""
    names: dict[str, list[str]] = {}
    for each in candidates:
        if each.entry.has_failed:
            names.setdefault(each.entry.error.get("what", "it failed"), []).append(each.entry.name)
    n_failed = sum(map(len, names.values()))
    if len(names) < MIN_LISTED_FAILURE_REASONS and n_failed <= MAX_DOUBTFUL_LOGS_NAMED_IN_HEADLINE:  # the rows say it
        return []
    ordered = sorted(names.items(), key=lambda item: (-len(item[1]), item[0]))
    return [
        f"{format_count(len(logs), 'log')} failed: {what} ({', '.join(logs[:MAX_DOUBTFUL_LOGS_NAMED_IN_HEADLINE])}"
        f"{', ...' if len(logs) > MAX_DOUBTFUL_LOGS_NAMED_IN_HEADLINE else ''})."
        for what, logs in ordered[:MAX_LISTED_FAILURE_REASONS]
    ]


def _run_headline(candidates: Sequence[LogCandidate]) -> str:
    """Say in one or two sentences what happened in the run."""
    n = len(candidates)
    warned = [each for each in candidates if each.n_warnings]
    n_warnings = sum(each.n_warnings for each in warned)
    broken = [each for each in candidates if each.entry.has_failed]
    text = f"{format_count(n, 'drive')}: cwcli gave {format_count(n_warnings, 'warning')}"
    if warned:
        text += f" in {len(warned)} of them" if n > 1 else ""
    text += f"; {len(broken)} could not be processed." if broken else "."
    if len(warned) == 1 and warned[0].story and n > 1:
        text += f" {warned[0].story}"
    elif n == 1 and candidates[0].story:
        return candidates[0].story
    return f"{doubtful} {text}" if (doubtful := _doubtful_logs_sentence(candidates)) else text


def _doubtful_logs_sentence(candidates: Sequence[LogCandidate]) -> str:
    """Name the logs that should not be trusted as they are, those of most doubts first; "" without any."""
    counts = {
        each.entry.name: each.entry.metrics[DOUBTS_METRIC].value
        for each in candidates
        if DOUBTS_METRIC in each.entry.metrics and each.entry.metrics[DOUBTS_METRIC].value > 0
    }
    if not counts:
        return ""
    named = sorted(counts, key=lambda name: (-counts[name], name))
    names = ", ".join(escape_control_characters(name) for name in named[:MAX_DOUBTFUL_LOGS_NAMED_IN_HEADLINE])
    more = (
        f" and {len(named) - MAX_DOUBTFUL_LOGS_NAMED_IN_HEADLINE} more"
        if len(named) > MAX_DOUBTFUL_LOGS_NAMED_IN_HEADLINE
        else ""
    )
    are = "it is" if len(named) == 1 else "they are"
    return f"Do not trust {len(named)} of {format_count(len(candidates), 'drive')} as {are}: {names}{more}."


def _left_out_sentences(left_out: Sequence[str], n: int) -> list[str]:
    """Say which logs are in the table only."""
    if not left_out:
        return []
    names = ", ".join(escape_control_characters(name) for name in left_out[:10])
    more = f" and {len(left_out) - 10} more" if len(left_out) > 10 else ""
    return [
        f"To keep the page small, {len(left_out)} of the {n} logs are in the table only, without figures: "
        f"{names}{more}. "
        "`cwcli report` on such a log's annotated.mcap makes a page of its own."
    ]


def _build_run_badges(candidates: Sequence[LogCandidate], results: Sequence[GateResult]) -> list[Badge]:
    """Return the badges of the run: its failures and its gates."""
    badges = []
    n_failed = sum(each.entry.has_failed for each in candidates)
    if n_failed:
        badges.append(Badge(f"{format_count(n_failed, 'log')} failed", "bad"))
    else:
        badges.append(Badge(f"all {len(candidates)} logs processed" if len(candidates) > 1 else "processed", "good"))
    return [*badges, gate_badge_of_run(results)]


def footer_sentences(tiles: TileServer | None) -> tuple[str, ...]:
    """Return the sentences below every page."""
    network = "This page needs no network."
    if tiles is not None:
        network = (
            f"This page needs no network except for the map below the tracks ({tiles.attribution}), whose tiles it "
            f"requests from {tiles.origin}; that server learns where the drive was."
        )
    return (
        f"Made by cwcli {__version__} from annotated logs. Positions are in metres east and north of the first fix; "
        "headings count counter-clockwise from east; bands and ellipses are one standard deviation. What `really` "
        "happened is what the estimated tracks say.",
        f"{network} Plots by plotly.js (MIT licence), which is inside.",
    )
