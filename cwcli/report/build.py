"""Builds the page of a run: how much of it each log gets, and what is left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cwcli.channels.published import EGO_PATH, WARNINGS
from cwcli.channels.warning import read_warnings
from cwcli.digest.digest import confidence_sentences
from cwcli.digest.drive import read_drive, require_results
from cwcli.digest.encounters import find_encounters
from cwcli.digest.lines import CUT_SENTENCE_MARK, NO_DOUBT_TEXT
from cwcli.digest.story import Badge, Story, build_story
from cwcli.errors import CwcliError
from cwcli.evaluation.doubts import find_doubts_in_evidence
from cwcli.evaluation.system_topics import OtherSystemTopics
from cwcli.fleet.folder import log_id_of_annotated_file
from cwcli.fleet.results import read_run_metrics
from cwcli.logs.read.reader import Log
from cwcli.metrics.gate_syntax import metric_names_in_gate
from cwcli.metrics.gates import GateResult, check_gates, matches_pattern
from cwcli.metrics.pooling import MetricRow, metric_rows_by_name
from cwcli.pipeline.records import read_run_records
from cwcli.report.gates import build_gate_views, gate_badge_of_run, gate_badges_of_log
from cwcli.report.overview import (
    MAX_PAGE_BYTES,
    MISSED_WARNINGS_METRIC,
    OVERVIEW_METRICS_AND_HEADINGS,
    LogCandidate,
    Report,
    assemble_run_report,
    footer_sentences,
    log_metrics_of_entry,
)
from cwcli.report.page import PageContent, PageRenderer
from cwcli.report.pooled import SourceInLog, is_pooled_metric, read_ego_sources
from cwcli.report.section import DetailLevel, SectionOptions, build_log_view
from cwcli.report.sensors import sensor_remarks_sentence
from cwcli.report.source import LogEntry, ReportedRun, read_reported_run
from cwcli.report.system import judge_warnings_of_other_system, other_system_sentences
from cwcli.report.thumbnail import read_ego_track_svg_path
from cwcli.report.tiles import TileServer
from cwcli.report.views import LogView
from cwcli.text import format_count
from cwcli.warning.rows import RAISED
from cwcli.work_share import part_of_work

MAX_UNFOLDED_LOGS = 3
"""Greatest number of logs of a run that are all shown unfolded; of more, only the first is. Chosen by hand; not
fitted."""
MAX_LOGS_IN_FULL_DETAIL = 5
"""Greatest number of logs of a run that are first tried in full detail. Chosen by hand; not fitted."""
OVERVIEW_ROW_BYTES = 1200
"""Space that is reserved for one row of the overview table, in bytes, 300 of them for the track. Estimated by hand."""
OVERVIEW_ROW_BYTES_OF_LONG_PAGE, MAX_LONG_PAGE_BYTES = 290, 5_000_000
"""The page of many logs sets aside so many bytes for a row of its overview, and has at most so many bytes. Chosen by
hand: ten thousand rows, and figures of the worst logs."""
MAX_LOGS_OPENED_FOR_OVERVIEW = 200
"""Greatest number of logs of a run that are opened for the overview; of more, the run's digest tells. Chosen by hand:
opening one takes some 20 ms."""
MAX_PREDICTED_PATHS_EVALUATED_WITHOUT_GATE = 20_000
"""Greatest number of predicted paths of a log whose metrics are computed although no gate needs them. Chosen by hand;
not fitted."""
MAX_TOO_LARGE_LOG_SECTIONS_BEFORE_GIVING_UP = 5
"""Number of logs whose section exceeds the remaining bytes after which no further log is tried. Chosen by hand; not
fitted."""
MAX_LOG_DESCRIPTION_CHARACTERS = 400
"""The greatest length of a log's description in the overview table, in characters. Chosen by hand; not fitted."""
MAX_LOG_DESCRIPTION_CHARACTERS_OF_LARGE_RUN = 90
"""The same in a run of more than `MAX_LOGS_OPENED_FOR_OVERVIEW` logs. Chosen by hand: 10,000 rows fit into 5 MB."""
FIGURE_DETAIL_OF_LARGE_RUN = DetailLevel(
    n_pieces=250, n_events=3, n_frame_events=1, n_frames=3, n_moments=0, has_all_metrics=False
)
"""The detail of logs in runs of more than `MAX_LOGS_IN_FULL_DETAIL` logs. Chosen by hand; not fitted."""
LEAST_FIGURE_DETAIL = DetailLevel(
    n_pieces=150, n_events=1, n_frame_events=1, n_frames=2, n_moments=0, has_all_metrics=False, has_residuals=False
)
"""The least detail that is tried before a log is left without figures. Chosen by hand; not fitted."""
Progress = Callable[[str], None]


def build_report(
    source: str,
    *,
    gates: Sequence[str] = (),
    system: OtherSystemTopics | None = None,
    tiles: TileServer | None = None,
    recover: bool = False,
    progress: Progress | None = None,
) -> Report:
    """Build the HTML page of a run or of one annotated log.

    Args:
        source: An output folder of `cwcli run -d`, or one annotated log.
        gates: Gate expressions beside those of the pipeline.
        system: Another system in the logs, which is judged too, or None.
        tiles: What is drawn below the maps, or None.
        recover: Read the intact parts of a single damaged log.
        progress: Told which log is worked on.

    Raises:
        InputError: The source can't be read.
        MissingSignalError: No stage of cwcli has run on the log.
        UsageError: The extra `report` is not installed, a gate is malformed, or another system's topic or field is not
            there.
    """
    say = progress or (lambda text: None)
    renderer = PageRenderer(tiles)
    run = read_reported_run(source, _page_metric_filter(gates))
    if system is not None and run.is_folder:
        run = _replace_metrics_with_system(run, source, system, say)
    gates = [*run.gates, *gates]
    if len(run.entries) == 1 and not run.entries[0].has_failed and run.entries[0].log is not None:
        source = source if not run.is_folder else run.entries[0].log
        return _build_report_of_one_log(run, source, gates, renderer, say, system=system, recover=recover)
    results = check_gates(gates, [log_metrics_of_entry(each) for each in run.entries])
    is_opened = len(run.entries) <= MAX_LOGS_OPENED_FOR_OVERVIEW
    candidates = sorted(
        (_read_log_and_rank_candidate(each, results, is_opened=is_opened) for each in run.entries),
        key=_candidate_sort_key,
    )
    is_few = len(candidates) <= MAX_LOGS_IN_FULL_DETAIL
    row_bytes, page_bytes = (
        (OVERVIEW_ROW_BYTES, MAX_PAGE_BYTES) if is_opened else (OVERVIEW_ROW_BYTES_OF_LONG_PAGE, MAX_LONG_PAGE_BYTES)
    )
    budget = page_bytes - renderer.fixed_size_bytes - row_bytes * len(candidates) - 20_000
    sections: list[str] = []
    n_misfits = 0
    shown = [candidate for candidate in candidates if candidate.entry.log is not None and budget > 0]
    for index, candidate in enumerate(shown):
        say(f"{candidate.entry.name}, log {index + 1} of {len(shown)}")
        is_open = len(shown) <= MAX_UNFOLDED_LOGS or index == 0
        with part_of_work(index / len(shown), (index + 1) / len(shown)):
            section = _render_section_and_complete_candidate(
                candidate, f"log-{index + 1}", renderer, budget, system, is_few=is_few, is_open=is_open
            )
        if section is None:
            n_misfits += 1
            if n_misfits == MAX_TOO_LARGE_LOG_SECTIONS_BEFORE_GIVING_UP:
                break
            continue
        candidate.anchor = f"log-{index + 1}"
        sections.append(section)
        budget -= len(section.encode()) + len(candidate.track)
        if budget < row_bytes:
            break
    return assemble_run_report(run, candidates, results, sections, renderer)


def _build_report_of_one_log(
    run: ReportedRun,
    source: str,
    gates: Sequence[str],
    renderer: PageRenderer,
    report_progress: Progress,
    *,
    system: OtherSystemTopics | None,
    recover: bool,
) -> Report:
    """Build the page of one annotated log."""
    report_progress(run.name)
    entry = run.entries[0]
    with Log.open(source, recover=recover) as log:
        require_results(log)
        if not run.is_folder:
            name = log_id_of_annotated_file(Path(source)) or log.name.rpartition("/")[2]
            with part_of_work(0.0, 0.5, "chunks"):
                metrics = _evaluate_headline_metrics(log, system, is_needed=bool(gates))
            entry = LogEntry(entry.id, name, log.name, entry.log, metrics=metrics)
        results = check_gates(gates, [log_metrics_of_entry(entry)])
        section, story, badges = "", None, []
        for detail in (DetailLevel(), DetailLevel(n_pieces=400), FIGURE_DETAIL_OF_LARGE_RUN, LEAST_FIGURE_DETAIL):
            options = SectionOptions("log-1", (), detail, is_alone=True, is_open=True)
            with part_of_work(0.5, 0.9, "chunks"):
                view = _read_and_build_log_view(log, entry, options, system)
            if not entry.metrics:
                note = "No metrics are shown; `cwcli evaluate` computes them."
                view = replace(view, notes=(*view.notes, note))
            story, section = view.story, renderer.render_log_section(view)
            if renderer.fixed_size_bytes + len(section.encode()) < MAX_PAGE_BYTES - 20_000:
                break
    assert story is not None
    badges = [gate_badge_of_run(results), *story.badges]
    page = PageContent(
        title=entry.name,
        headline=story.headline,
        sentences=(" ".join(story.sentences),),
        badges=tuple(badges),
        gates=tuple(build_gate_views(results)),
        columns=(),
        rows=(),
        footer=footer_sentences(renderer.tiles),
    )
    html = renderer.render_page(page, [section]).encode()
    n_failed = int(any(result.failed_checks for result in results))
    return Report(html, n_logs=1, n_detailed=1, n_failed=n_failed, left_out=())


def _page_metric_filter(gates: Sequence[str]) -> Callable[[str], bool]:
    """Return a function that tells whether the page of many logs needs a metric."""
    patterns = [name for gate in gates for name in metric_names_in_gate(gate)]
    columns = {name for name, _ in OVERVIEW_METRICS_AND_HEADINGS}
    return lambda name: (
        name in columns or is_pooled_metric(name) or any(matches_pattern(pattern, name) for pattern in patterns)
    )


def _replace_metrics_with_system(
    run: ReportedRun, source: str, system: OtherSystemTopics, report_progress: Progress
) -> ReportedRun:
    """Return the run with the metrics of another system added to those of each log."""
    found = {log.id: log for log in read_run_metrics(source, system=system, step=report_progress).logs}
    known = {entry.id: found[entry.id].rows for entry in run.entries if entry.id in found}
    return replace(
        run, entries=tuple(replace(each, metrics=known.get(each.id) or each.metrics) for each in run.entries)
    )


def _evaluate_headline_metrics(log: Log, system: OtherSystemTopics | None, *, is_needed: bool) -> dict[str, MetricRow]:
    """Compute the headline metrics of a log that is not part of a run; {} where they can't be computed.

    Args:
        is_needed: For a gate. Else they are left out where so many paths would have to be read that it takes longer
            than everything else.
    """
    from cwcli.evaluation.evaluate_log import evaluate_log

    n_paths = sum(channel.message_count or 0 for channel in log.channels if channel.schema_name == EGO_PATH.schema)
    if n_paths > MAX_PREDICTED_PATHS_EVALUATED_WITHOUT_GATE and not is_needed and system is None:
        return {}
    try:
        return metric_rows_by_name(evaluate_log(log, system=system))
    except CwcliError:
        if system is not None:  # it is asked for
            raise
        return {}


def _read_log_and_rank_candidate(entry: LogEntry, results: Sequence[GateResult], *, is_opened: bool) -> LogCandidate:
    """Collect what the run says of a log, and count its warnings: those of its channel, or as the run counted them."""
    badges: list[Badge] = []
    n_warnings, n_doubts, rank = 0, 0, 3
    if entry.has_failed:
        badges.append(Badge("the run failed", "bad"))
        rank = 0
    of_gates = [] if entry.has_failed else gate_badges_of_log(results, entry.id)
    badges += of_gates
    if any(badge.tone == "bad" for badge in of_gates):
        rank = min(rank, 1)
    story = ""
    if entry.has_failed:
        story = ": ".join(entry.error[key] for key in ("where", "what") if entry.error.get(key))
        if entry.error.get("hint"):
            story += f" (hint: {entry.error['hint']})"
    sources: list[SourceInLog] = []
    track = ""
    if not is_opened and entry.line is not None:
        n_warnings = entry.line.n_warnings
        story = _cut_after_whole_word(story or entry.line.text, MAX_LOG_DESCRIPTION_CHARACTERS_OF_LARGE_RUN)
        n_doubts = len(entry.line.doubts)
        badges += [Badge(format_count(n_doubts, "doubt"), "plain")] if n_doubts else []
    elif entry.log is not None:
        try:
            with Log.open(entry.log) as log:
                n_warnings = _count_raised_warnings(log)
                sources = read_ego_sources(entry.id, read_run_records(log).get("estimate", {}))
                track = read_ego_track_svg_path(log)
        except CwcliError as error:
            story, rank = story or f"{error.what}", 0
            badges.append(Badge("the annotated log can't be read", "bad"))
    if n_warnings or n_doubts:
        rank = min(rank, 2)
    shown = _cut_after_whole_word(story, MAX_LOG_DESCRIPTION_CHARACTERS)
    return LogCandidate(entry, badges, rank, n_warnings, shown, track=track, sources=tuple(sources), n_doubts=n_doubts)


def _cut_after_whole_word(text: str, max_characters: int) -> str:
    """Return the beginning of a text, with a mark where the rest is left out."""
    if len(text) <= max_characters:
        return text
    beginning = text[: max_characters - len(CUT_SENTENCE_MARK) + 1]
    return f"{beginning.rpartition(' ')[0] or beginning[:-1]}{CUT_SENTENCE_MARK}"


def _count_raised_warnings(log: Log) -> int:
    """Count the warnings that the log's channel raises."""
    if WARNINGS.topic not in {channel.topic for channel in log.channels}:
        return 0
    warnings = read_warnings(log.columns(WARNINGS.topic, ["state"]))
    return int(np.count_nonzero(warnings.state == RAISED))


def _candidate_sort_key(candidate: LogCandidate) -> tuple[Any, ...]:
    """Sort key: failed logs come first, then those of most doubts, of most missed warnings, of most warnings."""
    missed = candidate.entry.metrics.get(MISSED_WARNINGS_METRIC)
    n_missed = missed.value if missed is not None and missed.value > 0 else 0.0
    return candidate.rank, -candidate.n_doubts, -n_missed, -candidate.n_warnings, candidate.entry.id


def _render_section_and_complete_candidate(
    candidate: LogCandidate,
    anchor: str,
    renderer: PageRenderer,
    budget: int,
    system: OtherSystemTopics | None,
    *,
    is_few: bool,
    is_open: bool,
) -> str | None:
    """Render a log's section in as much detail as the budget of bytes allows; None if the least is too much."""
    assert candidate.entry.log is not None
    details = (
        (DetailLevel(), FIGURE_DETAIL_OF_LARGE_RUN, LEAST_FIGURE_DETAIL)
        if is_few
        else (FIGURE_DETAIL_OF_LARGE_RUN, LEAST_FIGURE_DETAIL)
    )
    try:
        with Log.open(candidate.entry.log) as log:
            for detail in details:
                options = SectionOptions(anchor, candidate.badges, detail, is_alone=False, is_open=is_open)
                view = _read_and_build_log_view(log, candidate.entry, options, system)
                candidate.story = candidate.story or _cut_after_whole_word(
                    view.story.headline, MAX_LOG_DESCRIPTION_CHARACTERS
                )
                section = renderer.render_log_section(view)
                if len(section.encode()) <= budget:
                    candidate.badges += view.story.badges
                    candidate.links = view.links
                    candidate.track = candidate.track or read_ego_track_svg_path(log)
                    return section
    except CwcliError as error:
        candidate.story = candidate.story or error.what
        candidate.badges.append(Badge("can't be shown", "bad"))
    return None


def _read_and_build_log_view(
    log: Log, entry: LogEntry, options: SectionOptions, system: OtherSystemTopics | None
) -> LogView:
    """Read an annotated log and collect everything that its section shows."""
    drive = replace(read_drive(log), other_system=judge_warnings_of_other_system(log, system))
    drive_encounters = find_encounters(drive)
    story: Story = build_story(
        drive,
        drive_encounters,
        entry.skip_reason_by_stage.get("warn", ""),
        find_doubts_in_evidence(drive.doubt_evidence),
        (NO_DOUBT_TEXT, *confidence_sentences(drive.doubt_evidence)),
    )
    story = replace(
        story, more=(*story.more, *filter(None, (sensor_remarks_sentence(drive),)), *other_system_sentences(drive))
    )
    options = replace(options, badges=(*options.badges, *story.badges))
    return build_log_view(log, entry, drive, drive_encounters, story, options)
