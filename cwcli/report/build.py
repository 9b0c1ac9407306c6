"""From a run to its page: which logs get how much of it, and what is left out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cwcli import __version__
from cwcli.channels.published import EGO_PATH, WARNINGS
from cwcli.channels.warning import read_warnings
from cwcli.errors import CwcliError, InputError
from cwcli.evaluation.system.topics import System
from cwcli.fleet.results import read_metrics
from cwcli.logs.read.reader import Log
from cwcli.metrics.gates import GateResult, check_gates
from cwcli.metrics.pooling import LogMetrics, MetricRow, rows_of
from cwcli.report.drive import read_drive, require_results
from cwcli.report.encounters import find_meetings
from cwcli.report.gates import badge_of_run, badges_of_log, gate_views
from cwcli.report.page import Page, Renderer, Row
from cwcli.report.section import Detail, log_view
from cwcli.report.sensors import doubts, first_remark
from cwcli.report.source import Entry, Run, read_run
from cwcli.report.story import Badge, Story, tell
from cwcli.report.system import judged_system, system_sentences
from cwcli.report.tables import value_text
from cwcli.report.views import LogView
from cwcli.text import count, printable
from cwcli.warning.rows import RAISED

MAX_BYTES = 5_900_000
"""Of the page."""
OPEN_LOGS = 3
"""In a run of no more logs than this, all are shown unfolded; in larger ones the first."""
FEW_LOGS = 5
PER_ROW_BYTES = 900
MAX_PATHS = 20_000
MAX_MISFITS = 5
"""After so many logs that do not fit any more, the others are not tried."""
MAX_STORY = 400
COLUMNS = (
    ("data.duration_s", "duration [s]"),
    ("warnings.count", "warnings"),
    ("ego.position_rmse_m", "position RMSE [m]"),
    ("lanes.found_share", "lanes found [share]"),
    ("data.rejected_count", "messages rejected"),
)
FOLDED = Detail(n_pieces=250, n_events=3, n_frame_events=1, n_frames=3, n_moments=0, has_all_metrics=False)
TIGHT = Detail(
    n_pieces=150, n_events=1, n_frame_events=1, n_frames=2, n_moments=0, has_all_metrics=False, has_residuals=False
)
Progress = Callable[[str], None]


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
class _Candidate:
    """A log, as far as it is known before its figures are made."""

    entry: Entry
    badges: list[Badge]
    rank: int
    n_warnings: int
    story: str = ""
    anchor: str = ""
    links: tuple[tuple[str, str], ...] = ()


def build_report(
    source: str,
    *,
    gates: Sequence[str] = (),
    system: System | None = None,
    recover: bool = False,
    progress: Progress | None = None,
) -> Report:
    """Make the page.

    Args:
        source: An output folder of `cwcli run -d`, or one annotated log.
        gates: Gate expressions beside those of the pipeline.
        system: Another system in the logs, which is judged too, or None.
        recover: Read what is intact of a single damaged log.
        progress: Told which log is worked on.

    Raises:
        InputError: The source can't be read.
        MissingSignalError: No stage of cwcli has run on the log.
        UsageError: The extra `report` is not installed, a gate is malformed, or another system's topic or field is not
            there.
    """
    say = progress or (lambda text: None)
    renderer = Renderer()
    run = read_run(source)
    if system is not None and run.is_folder:
        run = _scored_again(run, source, system, say)
    gates = [*run.gates, *gates]
    if len(run.entries) == 1 and not run.entries[0].has_failed and run.entries[0].log is not None:
        source = source if not run.is_folder else str(run.entries[0].log)
        return _of_one_log(run, source, gates, renderer, say, system=system, recover=recover)
    results = check_gates(gates, [_log_metrics(each) for each in run.entries])
    candidates = sorted((_candidate(each, results) for each in run.entries), key=_order)
    is_few = len(candidates) <= FEW_LOGS
    budget = MAX_BYTES - renderer.fixed_bytes - PER_ROW_BYTES * len(candidates) - 20_000
    sections: list[str] = []
    n_misfits = 0
    shown = [candidate for candidate in candidates if candidate.entry.log is not None]
    for index, candidate in enumerate(shown):
        say(candidate.entry.name)
        is_open = len(shown) <= OPEN_LOGS or index == 0
        made = _section(candidate, f"log-{index + 1}", renderer, budget, system, is_few=is_few, is_open=is_open)
        if made is None:
            n_misfits += 1
            if n_misfits == MAX_MISFITS:
                break
            continue
        candidate.anchor = f"log-{index + 1}"
        sections.append(made)
        budget -= len(made.encode())
        if budget < PER_ROW_BYTES:
            break
    return _assemble(run, candidates, results, sections, renderer)


def _of_one_log(
    run: Run,
    source: str,
    gates: Sequence[str],
    renderer: Renderer,
    say: Progress,
    *,
    system: System | None,
    recover: bool,
) -> Report:
    """The page of one annotated log."""
    say(run.name)
    entry = run.entries[0]
    with Log.open(source, recover=recover) as log:
        require_results(log)
        if not run.is_folder:
            name = log.name.rpartition("/")[2]
            entry = Entry(entry.id, name, log.name, entry.log, metrics=_evaluated(log, system, is_needed=bool(gates)))
        results = check_gates(gates, [_log_metrics(entry)])
        section, story, badges = "", None, []
        for detail in (Detail(), Detail(n_pieces=400), FOLDED, TIGHT):
            view = _view(log, entry, "log-1", [], detail, system, is_alone=True, is_open=True)
            if not entry.metrics:
                note = "No metrics are shown; `cwcli evaluate` computes them."
                view = replace(view, notes=(*view.notes, note))
            story, section = view.story, renderer.log(view)
            if renderer.fixed_bytes + len(section.encode()) < MAX_BYTES - 20_000:
                break
    assert story is not None
    badges = [badge_of_run(results), *story.badges]
    page = Page(
        title=entry.name,
        headline=story.headline,
        sentences=(" ".join(story.more),),
        badges=tuple(badges),
        gates=tuple(gate_views(results)),
        columns=(),
        rows=(),
        footer=_footer(),
    )
    html = renderer.page(page, [section]).encode()
    n_failed = int(any(result.failed for result in results))
    return Report(html, n_logs=1, n_detailed=1, n_failed=n_failed, left_out=())


def _log_metrics(entry: Entry) -> LogMetrics:
    """The log for the gates."""
    error = entry.error.get("what", "it failed") if entry.has_failed else ""
    return LogMetrics(entry.id, entry.metrics, error)


def _scored_again(run: Run, source: str, system: System, say: Progress) -> Run:
    """The run with the metrics of another system among those of each log."""
    found = {log.id: log for log in read_metrics(source, system=system, step=say).logs}
    known = {entry.id: found[entry.id].rows for entry in run.entries if entry.id in found}
    return replace(
        run, entries=tuple(replace(each, metrics=known.get(each.id) or each.metrics) for each in run.entries)
    )


def _evaluated(log: Log, system: System | None, *, is_needed: bool) -> dict[str, MetricRow]:
    """The headline metrics of a log that is not part of a run; none where they can't be computed.

    Args:
        is_needed: For a gate. Else they are left out where so many paths would have to be read that it takes longer
            than everything else.
    """
    from cwcli.evaluation.evaluate_log import evaluate_log

    n_paths = sum(channel.message_count or 0 for channel in log.channels if channel.schema_name == EGO_PATH.schema)
    if n_paths > MAX_PATHS and not is_needed and system is None:
        return {}
    try:
        return rows_of(evaluate_log(log, system=system))
    except CwcliError:
        if system is not None:  # it is asked for
            raise
        return {}


def _candidate(entry: Entry, results: Sequence[GateResult]) -> _Candidate:
    """What the run tells of a log, and how many warnings its channel holds."""
    badges: list[Badge] = []
    n_warnings, rank = 0, 3
    if entry.has_failed:
        badges.append(Badge("the run failed", "bad"))
        rank = 0
    of_gates = [] if entry.has_failed else badges_of_log(results, entry.id)
    badges += of_gates
    if any(badge.tone == "bad" for badge in of_gates):
        rank = min(rank, 1)
    story = ""
    if entry.has_failed:
        story = ": ".join(entry.error[key] for key in ("where", "what") if entry.error.get(key))
        if entry.error.get("hint"):
            story += f" (hint: {entry.error['hint']})"
    if entry.log is not None:
        try:
            n_warnings = _count_warnings(str(entry.log))
        except CwcliError as error:
            story, rank = story or f"{error.what}", 0
            badges.append(Badge("the annotated log can't be read", "bad"))
    if n_warnings:
        rank = min(rank, 2)
    return _Candidate(entry, badges, rank, n_warnings, story[:MAX_STORY])


def _count_warnings(path: str) -> int:
    with Log.open(path) as log:
        if WARNINGS.topic not in {channel.topic for channel in log.channels}:
            return 0
        warnings = read_warnings(log.columns(WARNINGS.topic, ["state"]))
    return int(np.count_nonzero(warnings.state == RAISED))


def _order(candidate: _Candidate) -> tuple[Any, ...]:
    """What went wrong comes first, then what was warned of, then the rest."""
    return candidate.rank, candidate.n_warnings == 0, candidate.entry.id


def _section(
    candidate: _Candidate,
    anchor: str,
    renderer: Renderer,
    budget: int,
    system: System | None,
    *,
    is_few: bool,
    is_open: bool,
) -> str | None:
    """The log's part of the page, in as much detail as the budget allows; None where even the least is too much."""
    assert candidate.entry.log is not None
    details = (Detail(), FOLDED, TIGHT) if is_few else (FOLDED, TIGHT)
    try:
        with Log.open(candidate.entry.log) as log:
            for detail in details:
                entry, badges = candidate.entry, candidate.badges
                view = _view(log, entry, anchor, badges, detail, system, is_alone=False, is_open=is_open)
                candidate.story = candidate.story or view.story.headline[:MAX_STORY]
                made = renderer.log(view)
                if len(made.encode()) <= budget:
                    candidate.badges += view.story.badges
                    candidate.links = view.links
                    return made
    except CwcliError as error:
        candidate.story = candidate.story or error.what
        candidate.badges.append(Badge("can't be shown", "bad"))
    return None


def _view(
    log: Log,
    entry: Entry,
    anchor: str,
    badges: Sequence[Badge],
    detail: Detail,
    system: System | None,
    *,
    is_alone: bool,
    is_open: bool,
) -> LogView:
    drive = replace(read_drive(log), system=judged_system(log, system))
    meetings = find_meetings(drive)
    story: Story = tell(drive, meetings, entry.left_out.get("warn", ""), doubts(drive))
    story = replace(story, more=(*story.more, *filter(None, (first_remark(drive),)), *system_sentences(drive)))
    return log_view(
        log,
        entry,
        drive,
        meetings,
        story,
        anchor=anchor,
        badges=[*badges, *story.badges],
        detail=detail,
        is_alone=is_alone,
        is_open=is_open,
    )


def _assemble(
    run: Run, candidates: list[_Candidate], results: Sequence[GateResult], sections: list[str], renderer: Renderer
) -> Report:
    columns = [(name, title) for name, title in COLUMNS if any(name in each.entry.metrics for each in candidates)]
    rows = []
    for each in candidates:
        known = each.entry.metrics
        shown = tuple(value_text(name, known[name].value if name in known else math.nan) for name, _ in columns)
        story = each.story or (count(each.n_warnings, "warning") if each.n_warnings else "no warning")
        rows.append(Row(each.anchor, each.entry.name, tuple(each.badges), story, shown, each.links))
    failed = [each for each in candidates if each.rank <= 1]
    left_out = tuple(each.entry.name for each in candidates if not each.anchor and each.entry.log is not None)
    page = Page(
        title=run.name,
        headline=_headline(candidates),
        sentences=tuple(_sentences(left_out, len(candidates))),
        badges=tuple(_run_badges(candidates, results)),
        gates=tuple(gate_views(results)),
        columns=tuple(title for _, title in columns),
        rows=tuple(rows),
        footer=_footer(),
    )
    html = renderer.page(page, sections).encode()
    if len(html) > MAX_BYTES * 1.5:
        raise InputError(f"the run has so many logs ({len(candidates)}) that the page would be {len(html)} bytes long")
    return Report(html, len(candidates), len(sections), len(failed), left_out)


def _headline(candidates: Sequence[_Candidate]) -> str:
    """What happened in the run, in a sentence or two."""
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
    if not left_out:
        return []
    names = ", ".join(printable(name) for name in left_out[:10])
    more = f" and {len(left_out) - 10} more" if len(left_out) > 10 else ""
    return [
        f"To keep the page small, {len(left_out)} of the {n} logs are in the table only, without figures: "
        f"{names}{more}. "
        "`cwcli report` on such a log's annotated.mcap makes a page of its own."
    ]


def _run_badges(candidates: Sequence[_Candidate], results: Sequence[GateResult]) -> list[Badge]:
    badges = []
    n_failed = sum(each.entry.has_failed for each in candidates)
    if n_failed:
        badges.append(Badge(f"{count(n_failed, 'log')} failed", "bad"))
    else:
        badges.append(Badge(f"all {len(candidates)} logs processed" if len(candidates) > 1 else "processed", "good"))
    return [*badges, badge_of_run(results)]


def _footer() -> tuple[str, ...]:
    return (
        f"Made by cwcli {__version__} from annotated logs. Positions are in metres east and north of the first fix; "
        "headings count counter-clockwise from east; bands and ellipses are one standard deviation. What `really` "
        "happened is what the estimated tracks say.",
        "This page needs no network. Plots by plotly.js (MIT licence), which is inside.",
    )
