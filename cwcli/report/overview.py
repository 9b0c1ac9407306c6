"""The overview of a run: what happened in all its logs, and the table of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cwcli import __version__
from cwcli.errors import InputError
from cwcli.metrics.gates import GateResult
from cwcli.metrics.pooling import LogMetrics
from cwcli.report.gates import badge_of_run, gate_views
from cwcli.report.page import Page, Renderer, Row
from cwcli.report.pooled import FoundSource, pooled_metrics, pooled_sources
from cwcli.report.source import Entry, Run
from cwcli.report.story import Badge
from cwcli.report.tables import value_text
from cwcli.report.tiles import Tiles
from cwcli.text import count, printable

MAX_BYTES = 5_900_000
"""The size of a page that sections are fitted into, in bytes; docs/report.md promises less than 6 MB."""
COLUMNS = (
    ("data.duration_s", "duration [s]"),
    ("warnings.count", "warnings"),
    ("warnings.missed_count", "missed"),
    ("ego.position_rmse_m", "position RMSE [m]"),
    ("ego.position_nees", "NEES"),
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
class Candidate:
    """A log, as far as it is known before its figures are made; those of the lowest rank come first."""

    entry: Entry
    badges: list[Badge]
    rank: int
    n_warnings: int
    story: str = ""
    anchor: str = ""
    links: tuple[tuple[str, str], ...] = ()
    sources: tuple[FoundSource, ...] = ()


def log_metrics(entry: Entry) -> LogMetrics:
    """Convert a log of the run to the form that gates and pooling take."""
    error = entry.error.get("what", "it failed") if entry.has_failed else ""
    return LogMetrics(entry.id, entry.metrics, error)


def assemble(
    run: Run, candidates: list[Candidate], results: Sequence[GateResult], sections: list[str], renderer: Renderer
) -> Report:
    """Assemble the report of a run.

    Args:
        candidates: Its logs, in the order of the table.
        results: Of the gates.
        sections: The logs that have figures.

    Raises:
        InputError: The run has too many logs for a page.
    """
    columns = [(name, title) for name, title in COLUMNS if any(name in each.entry.metrics for each in candidates)]
    rows = []
    for each in candidates:
        known = each.entry.metrics
        shown = tuple(value_text(name, known[name].value if name in known else math.nan) for name, _ in columns)
        story = each.story or (count(each.n_warnings, "warning") if each.n_warnings else "no warning")
        rows.append(Row(each.anchor, each.entry.name, tuple(each.badges), story, shown, each.links))
    failed = [each for each in candidates if each.rank <= 1]
    left_out = tuple(each.entry.name for each in candidates if not each.anchor and each.entry.log is not None)
    anchors = {each.entry.id: each.anchor for each in candidates if each.anchor}
    sources, n_sources = pooled_sources([source for each in candidates for source in each.sources], anchors)
    page = Page(
        title=run.name,
        headline=_headline(candidates),
        sentences=tuple(_sentences(left_out, len(candidates))),
        badges=tuple(_run_badges(candidates, results)),
        gates=tuple(gate_views(results)),
        columns=tuple(title for _, title in columns),
        rows=tuple(rows),
        metrics=pooled_metrics([log_metrics(each.entry) for each in candidates], anchors),
        sources=sources,
        n_sources=n_sources,
        footer=footer(renderer.tiles),
    )
    html = renderer.page(page, sections).encode()
    if len(html) > MAX_BYTES * 1.5:
        raise InputError(f"the run has so many logs ({len(candidates)}) that the page would be {len(html)} bytes long")
    return Report(html, len(candidates), len(sections), len(failed), left_out)


def _headline(candidates: Sequence[Candidate]) -> str:
    """Say in one or two sentences what happened in the run."""
    n = len(candidates)
    warned = [each for each in candidates if each.n_warnings]
    n_warnings = sum(each.n_warnings for each in warned)
    broken = [each for each in candidates if each.entry.has_failed]
    text = f"{count(n, 'drive')}: cwcli gave {count(n_warnings, 'warning')}"
    if warned:
        text += f" in {len(warned)} of them" if n > 1 else ""
    text += f"; {len(broken)} could not be processed." if broken else "."
    if len(warned) == 1 and warned[0].story and n > 1:
        text += f" {warned[0].story}"
    elif n == 1 and candidates[0].story:
        text = candidates[0].story
    return text


def _sentences(left_out: Sequence[str], n: int) -> list[str]:
    """Say which logs are in the table only."""
    if not left_out:
        return []
    names = ", ".join(printable(name) for name in left_out[:10])
    more = f" and {len(left_out) - 10} more" if len(left_out) > 10 else ""
    return [
        f"To keep the page small, {len(left_out)} of the {n} logs are in the table only, without figures: "
        f"{names}{more}. "
        "`cwcli report` on such a log's annotated.mcap makes a page of its own."
    ]


def _run_badges(candidates: Sequence[Candidate], results: Sequence[GateResult]) -> list[Badge]:
    """Return the badges of the run: its failures and its gates."""
    badges = []
    n_failed = sum(each.entry.has_failed for each in candidates)
    if n_failed:
        badges.append(Badge(f"{count(n_failed, 'log')} failed", "bad"))
    else:
        badges.append(Badge(f"all {len(candidates)} logs processed" if len(candidates) > 1 else "processed", "good"))
    return [*badges, badge_of_run(results)]


def footer(tiles: Tiles | None) -> tuple[str, ...]:
    """Return the sentences below every page."""
    network = "This page needs no network."
    if tiles is not None:
        network = (
            f"This page needs no network but for the map below the tracks ({tiles.attribution}), whose tiles it asks "
            f"{tiles.origin} for, and so tells it where the drive was."
        )
    return (
        f"Made by cwcli {__version__} from annotated logs. Positions are in metres east and north of the first fix; "
        "headings count counter-clockwise from east; bands and ellipses are one standard deviation. What `really` "
        "happened is what the estimated tracks say.",
        f"{network} Plots by plotly.js (MIT licence), which is inside.",
    )
