"""The page of two runs: for each log that differs what changed, and both motions in one map and one strip."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from cwcli.errors import CwcliError
from cwcli.evaluation.message_changes import LogDifference
from cwcli.events.evidence import EventEvidence
from cwcli.logs.read.reader import Log
from cwcli.report.drawing import EGO_COLOUR, WARNING_COLOUR
from cwcli.report.svg import MapTrack, TimeAxis, escape_for_html, html_page, map_svg, strip_svg
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S
from cwcli.text import format_count

MAX_LOGS_WITH_FIGURES = 100
"""Greatest number of logs with figures; chosen by hand, so that the page stays below 3 MB."""
MAX_POINTS_PER_LINE = 300
"""Greatest number of points of a line; chosen by hand, a line is 300 pixels wide."""


class DifferingLog(NamedTuple):
    """A log that differs between two runs.

    Attributes:
        name: Its id.
        early_path, late_path: Its annotated logs of the earlier and of the later run.
        difference: What differs.
        sentences: What differs, in sentences.
    """

    name: str
    early_path: str
    late_path: str
    difference: LogDifference
    sentences: Sequence[str]


class _BothMotions(NamedTuple):
    """The motion of the ego in both runs, on the stamps of the earlier one.

    Attributes:
        time_s: From the log's start, (n,).
        early, late: x, y [m] and speed [m/s] in the map of the earlier run, (n, 3); NaN where there are no states.
    """

    time_s: FloatArray
    early: FloatArray
    late: FloatArray


def build_comparison_page(
    title: str,
    logs: Sequence[DifferingLog],
    n_compared: int,
    open_log: Callable[[str], Log],
    step: Callable[[int, str], None] = lambda done, name: None,
) -> bytes:
    """Build the page of two runs as HTML, which needs no script and no network.

    Args:
        title: Names of both runs.
        logs: The logs that differ.
        n_compared: Number of logs that were compared.
        open_log: Opens a log by its path.
        step: Called with the number of drawn logs and the name of the next one.
    """
    cards = []
    for k, log in enumerate(logs):
        step(k, log.name)
        lines = "".join(f"<p>{escape_for_html(line)}</p>" for line in log.sentences)
        figures = _map_and_strips_or_reason_html(log, open_log) if k < MAX_LOGS_WITH_FIGURES else ""
        name = escape_for_html(log.name)
        cards.append(f'<article><h2>{name}</h2>{lines}<div class="figures">{figures}</div></article>\n')
    verb = "differs" if 1 in (len(logs), n_compared) else "differ"
    head = f"{len(logs)} of {format_count(n_compared, 'compared log')} {verb}."
    if len(logs) > MAX_LOGS_WITH_FIGURES:
        head += f" The first {MAX_LOGS_WITH_FIGURES} have figures."
    legend = (
        f'In the figures <b style="color:{WARNING_COLOUR}">the earlier run is orange</b> and <b style="color:'
        f'{EGO_COLOUR}">the later one is blue</b>. Dashed lines are warnings that only this run gives, or gives at '
        "another time. North is up."
    )
    return html_page("cwcli compare", title, head, legend, "".join(cards))


def _map_and_strips_or_reason_html(log: DifferingLog, open_log: Callable[[str], Log]) -> str:
    """Return map and strips of a log; a sentence where there is nothing to draw."""
    try:
        with open_log(log.early_path) as early, open_log(log.late_path) as late:
            motions = _read_ego_motions_of_both_runs(EventEvidence(early), EventEvidence(late), log.difference.start_ns)
    except CwcliError as error:
        return f"<p><small>Not drawn: {escape_for_html(error.what)}.</small></p>"
    marks = []
    for warning in log.difference.warnings:
        at_s = log.difference.seconds_since_start(warning.raised_ns)
        if warning.kind != "vanished":
            marks.append((at_s, EGO_COLOUR))
        if warning.kind != "appeared":
            marks.append((at_s - (warning.moved_s if warning.kind == "moved" else 0.0), WARNING_COLOUR))
    tracks = [MapTrack(motions.early[:, :2], WARNING_COLOUR), MapTrack(motions.late[:, :2], EGO_COLOUR)]
    apart_m = np.hypot(*(motions.late - motions.early)[:, :2].T)
    axis = TimeAxis(motions.time_s, "time from the log's start [s]")
    speeds = [(motions.early[:, 2], WARNING_COLOUR), (motions.late[:, 2], EGO_COLOUR)]
    strips = strip_svg(axis, "speed of the ego [m/s]", speeds, marks)
    if np.nanmax(apart_m, initial=0.0) > 0.0:
        strips += "<br/>" + strip_svg(axis, "distance of both positions [m]", [(apart_m, "#333333")], marks)
    else:
        strips += "<p><small>The positions of the ego are the same in both runs.</small></p>"
    return f"{map_svg(tracks, 'both tracks of the ego; dots are their ends')}<div>{strips}</div>"


def _read_ego_motions_of_both_runs(early: EventEvidence, late: EventEvidence, start_ns: int) -> _BothMotions:
    """Read the motion of the ego in both runs.

    Raises:
        MissingSignalError: A log holds no states of the ego.
    """
    rows = np.unique(np.linspace(0, len(early.stamp_ns) - 1, MAX_POINTS_PER_LINE).astype(int))
    at_ns = early.stamp_ns[rows]
    late_s = (late.stamp_ns - start_ns) / NS_PER_S
    time_s = (at_ns - start_ns) / NS_PER_S
    late_state = np.column_stack(
        [np.interp(time_s, late_s, late.ego_state[:, k], left=np.nan, right=np.nan) for k in range(3)]
    )
    return _BothMotions(time_s, early.ego_state[rows, :3], late_state)
