"""Single plots of an annotated log as image files: the report's curves, and the trajectory errors of the field."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from cwcli.digest.drive import Drive
from cwcli.errors import MissingSignalError, UsageError, install_hint
from cwcli.estimation.measurements import Kind
from cwcli.evaluation.evaluation_context import EgoTruth
from cwcli.lazy_dataclass import dataclass
from cwcli.report.map_figure import insert_nan_rows_in_time_gaps
from cwcli.report.sensors import MAX_INTERPOLATION_GAP_S, truth_error_curves
from cwcli.report.signal_figures import SignalCurve, lane_curves, motion_curves
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import HEADING
from cwcli.text import shorten_and_escape

RELATIVE_POSITION_ERROR_SPAN_S = 1.0
"""Time span of a relative position error, in s. Chosen by hand; not fitted."""
FIGURE_WIDTH_IN = 9.0
"""Width of a plot, in inches. Chosen by hand; not fitted."""
PANEL_HEIGHT_IN = 2.1
"""Height of a panel over time, in inches. Chosen by hand; not fitted."""
MAP_HEIGHT_IN = 6.5
"""Height of a map, in inches. Chosen by hand; not fitted."""
PNG_DOTS_PER_INCH = 110
"""Resolution of PNG files, in dots per inch. Chosen by hand; not fitted."""
ESTIMATE_COLOUR = "#0072b2"
"""Colour of estimates. From Okabe and Ito's palette."""
UNCERTAINTY_BAND_AND_ERROR_COLOUR = "#0072b2"
"""Colour of the bands around estimates and of errors. From Okabe and Ito's palette."""
MEASURED_COLOUR = "0.65"
"""Colour of raw measurements, as matplotlib's grey level. Chosen by hand; not fitted."""
GATED_COLOUR = "#d55e00"
"""Colour of gated measurements. From Okabe and Ito's palette."""
TRUTH_COLOUR = "black"
"""Colour of the truth. Chosen by hand; not fitted."""
WARNING_COLOUR = "#d55e00"
"""Colour of warnings. From Okabe and Ito's palette."""
OTHER_VEHICLE_COLOURS = ("#cc79a7", "#009e73", "#56b4e9", "#e69f00", "#5b3f8c")
"""Colours of the other vehicles, in order. From Okabe and Ito's palette but for the last."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes over time.

    Attributes:
        curve: What is drawn, in its unit.
        is_error: Its band lies around zero.
        statistics_text: What stands in the title beside the curve's name, such as its mean.
    """

    curve: SignalCurve
    is_error: bool = False
    statistics_text: str = ""


def motion_panels(drive: Drive) -> list[Panel]:
    """Make the panels of speed, heading, yaw rate and acceleration."""
    return [Panel(curve) for curve in motion_curves(drive)]


def truth_error_panels(drive: Drive) -> list[Panel]:
    """Make the panels of the errors of position, speed and heading against the truth."""
    panels = [Panel(curve, is_error=True) for curve in truth_error_curves(drive, _require_truth(drive))]
    return panels or _raise_no_common_time_error()


def lane_panels(drive: Drive) -> list[Panel]:
    """Make the panels of the place in the lane."""
    panels = [Panel(curve) for curve in lane_curves(drive)]
    if not panels:
        raise MissingSignalError("the log holds no lanes", where=drive.name, hint="run `cwcli lanes` first")
    return panels


def absolute_position_error_panels(drive: Drive) -> list[Panel]:
    """Make the panel of the absolute position error (APE, translation part), without alignment."""
    truth = _require_truth(drive)
    return [
        _error_panel_with_statistics(
            "APE, translation", truth.stamp_ns, np.hypot(*(_states_at_truth_stamps(drive, truth)[:, :2] - truth.xy).T)
        )
    ]


def relative_position_error_panels(drive: Drive) -> list[Panel]:
    """Make the panel of the relative position error (RPE, translation part) over `RELATIVE_POSITION_ERROR_SPAN_S`.

    The ways are those in the frames of the two poses at the beginning; in the map where the truth has no heading.
    """
    truth = _require_truth(drive)
    return [
        _error_panel_with_statistics(
            f"RPE over {RELATIVE_POSITION_ERROR_SPAN_S:.0f} s, translation",
            *displacement_end_ns_and_error_m(_states_at_truth_stamps(drive, truth), truth),
        )
    ]


def displacement_end_ns_and_error_m(state: FloatArray, truth: EgoTruth) -> tuple[Int64Array, FloatArray]:
    """Compute the errors of the displacements over `RELATIVE_POSITION_ERROR_SPAN_S` from each of the truth's stamps.

    Args:
        state: The estimated states at the truth's stamps, (n, 8), NaN where not known.

    Returns:
        Stamps of the ends (k,), and errors (k,), m.
    """
    end = np.searchsorted(truth.stamp_ns, truth.stamp_ns + round(RELATIVE_POSITION_ERROR_SPAN_S * NS_PER_S))
    start = np.flatnonzero(end < len(end))
    end = end[start]
    is_near = (truth.stamp_ns[end] - truth.stamp_ns[start]) < (
        RELATIVE_POSITION_ERROR_SPAN_S + MAX_INTERPOLATION_GAP_S
    ) * NS_PER_S
    start, end = start[is_near], end[is_near]
    way, true_way = state[end, :2] - state[start, :2], truth.xy[end] - truth.xy[start]
    if truth.heading_rad is not None:
        way, true_way = (
            _rotate_vectors(way, -state[start, HEADING]),
            _rotate_vectors(true_way, -truth.heading_rad[start]),
        )
    return truth.stamp_ns[end], np.hypot(*(way - true_way).T)


def _rotate_vectors(xy: FloatArray, angle: FloatArray) -> FloatArray:
    """Rotate vectors (n, 2) by angles (n,), rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * xy[:, 0] - s * xy[:, 1], s * xy[:, 0] + c * xy[:, 1]])


def _error_panel_with_statistics(title: str, stamp_ns: Int64Array, values: FloatArray) -> Panel:
    """Make the panel of an error, with its statistics in the title."""
    known = values[np.isfinite(values)]
    if not len(known):
        _raise_no_common_time_error()
    rmse, mean, median, most = np.sqrt((known**2).mean()), known.mean(), np.median(known), known.max()
    said = f"rmse {rmse:.3g}, mean {mean:.3g}, median {median:.3g}, max {most:.3g} m, n {len(known)}"
    return Panel(
        SignalCurve(title, "m", 3, stamp_ns, values, np.full(len(values), np.nan)), is_error=True, statistics_text=said
    )


def _require_truth(drive: Drive) -> EgoTruth:
    """Return the truth, or raise MissingSignalError."""
    if drive.truth is None:
        raise MissingSignalError(
            "the log holds no truth of the ego that was used",
            where=drive.name,
            hint="a topic with the role truth, or `cwcli estimate --topic truth=/name`",
        )
    return drive.truth


def _states_at_truth_stamps(drive: Drive, truth: EgoTruth) -> FloatArray:
    """Interpolate the ego's states at the truth's stamps, (n, 8)."""
    assert drive.ego is not None  # who has a truth has states
    states = drive.ego.sort_by_stamp_without_repeats()
    return interpolate_signal_at_times(states.stamp_ns, states.state, truth.stamp_ns, max_gap_s=MAX_INTERPOLATION_GAP_S)


def _raise_no_common_time_error() -> list[Panel]:
    """Raise that states and truth have no common time."""
    raise MissingSignalError("the states and the truth have no time in common")


PANEL_BUILDERS: Mapping[str, Callable[[Drive], list[Panel]]] = {
    "motion": motion_panels,
    "error": truth_error_panels,
    "ape": absolute_position_error_panels,
    "rpe": relative_position_error_panels,
    "lane": lane_panels,
}
"""Plot name -> the function that makes its panels."""
MOTION_PANEL_TITLES: Mapping[str, str] = {
    "speed": "speed",
    "heading": "heading",
    "yaw-rate": "yaw rate",
    "acceleration": "acceleration",
}
"""Plot name -> title of the one panel of `motion` that it shows."""
MAP_PLOT_NAME = "map"
"""Plot name of the map."""
PLOT_NAMES = (*PANEL_BUILDERS, *MOTION_PANEL_TITLES, MAP_PLOT_NAME)
"""All names of plots, for the option that chooses one."""


def draw_plot(drive: Drive, plot_name: str, file_format: str) -> bytes:
    """Draw one plot as a file; the same log gives the same bytes.

    Args:
        plot_name: One of `PLOT_NAMES`.
        file_format: One of `PLOT_FILE_FORMATS`.

    Raises:
        UsageError: matplotlib is not installed.
        MissingSignalError: The log does not hold what is to be drawn.
    """
    from importlib.util import find_spec

    if find_spec("matplotlib") is None:
        raise UsageError("plots need matplotlib", hint=install_hint("plots"))
    if drive.ego is None and plot_name != "lane":
        raise MissingSignalError("the log holds no ego state", where=drive.name, hint="run `cwcli estimate` first")
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.hashsalt": "cwcli"}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from")  # names with such letters are drawn as boxes
        if plot_name == MAP_PLOT_NAME:
            figure = Figure(figsize=(FIGURE_WIDTH_IN, MAP_HEIGHT_IN), layout="constrained")
            _draw_map(figure, drive)
        else:
            title = MOTION_PANEL_TITLES.get(plot_name)
            panels = PANEL_BUILDERS["motion" if title else plot_name](drive)
            panels = [panel for panel in panels if title is None or panel.curve.title == title]
            figure = Figure(figsize=(FIGURE_WIDTH_IN, PANEL_HEIGHT_IN * len(panels) + 1.2), layout="constrained")
            _draw_panels(figure, drive, panels)
        sink = io.BytesIO()
        name = shorten_and_escape(PurePath(drive.name).name)
        figure.suptitle(name, fontsize="medium", parse_math=False)
        metadata = {"Title": name, **({"Date": None} if file_format == "svg" else {"Software": "cwcli"})}
        figure.savefig(sink, format=file_format, dpi=PNG_DOTS_PER_INCH, metadata=metadata)
    return sink.getvalue()


def _draw_panels(figure: Any, drive: Drive, panels: Sequence[Panel]) -> None:
    """Draw panels over a common time axis."""
    all_axes = figure.subplots(len(panels), sharex=True, squeeze=False)[:, 0]
    handles: dict[str, Any] = {}
    for axes, panel in zip(all_axes, panels, strict=True):
        curve = panel.curve
        stamp_ns, both = insert_nan_rows_in_time_gaps(curve.stamp_ns, np.column_stack([curve.values, curve.sigma]))
        seconds, (values, sigma) = drive.seconds_since_start(stamp_ns), both.T
        if curve.measured is not None:
            at = drive.seconds_since_start(curve.measured[0])
            handles["measured"] = axes.plot(at, curve.measured[1], ".", color=MEASURED_COLOUR, markersize=2, zorder=1)[
                0
            ]
            if curve.gated is not None and curve.gated.any():
                crosses = axes.plot(
                    at[curve.gated], curve.measured[1][curve.gated], "x", color=GATED_COLOUR, markersize=4
                )
                handles["gated"] = crosses[0]
        if np.isfinite(sigma).any():
            middle = np.zeros_like(values) if panel.is_error else values
            said = "95 % band" if panel.is_error else "1-sigma band"
            handles[said] = axes.fill_between(
                seconds,
                middle - sigma,
                middle + sigma,
                color=UNCERTAINTY_BAND_AND_ERROR_COLOUR,
                alpha=0.25,
                linewidth=0,
                zorder=2,
            )
        name = "error" if panel.is_error else "estimated"
        handles[name] = axes.plot(seconds, values, color=ESTIMATE_COLOUR, linewidth=1.1, zorder=3)[0]
        for at_s in _warning_times_s(drive):
            handles["warning"] = axes.axvline(at_s, color=WARNING_COLOUR, linestyle="--", linewidth=0.9, zorder=0)
        axes.set_ylabel(f"{curve.title.partition(',')[0]} [{curve.unit}]")
        if panel.statistics_text:
            axes.set_title(f"{curve.title}: {panel.statistics_text}", fontsize="medium")
            axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3)
    all_axes[-1].set_xlabel("time since the log began [s]")
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=len(handles), fontsize="small")


def _warning_times_s(drive: Drive) -> FloatArray:
    """Return the times of the warnings, in s since the log began."""
    from cwcli.channels.warning import warning_events_with_known_start

    if drive.warnings is None:
        return np.zeros(0)
    return drive.seconds_since_start(
        np.array([event.raised_ns for event in warning_events_with_known_start(drive.warnings)], np.int64)
    )


def _draw_map(figure: Any, drive: Drive) -> None:
    """Draw the tracks from above."""
    axes = figure.add_subplot()
    assert drive.ego is not None
    states = drive.ego.sort_by_stamp_without_repeats()
    _, xy = insert_nan_rows_in_time_gaps(states.stamp_ns, states.state[:, :2])
    for k, other in enumerate(drive.others):
        _, theirs = insert_nan_rows_in_time_gaps(other.track.stamp_ns, other.track.state[:, :2])
        label = f"{other.kind} {other.id}" if k < len(OTHER_VEHICLE_COLOURS) else None
        axes.plot(
            *theirs.T,
            color=OTHER_VEHICLE_COLOURS[k % len(OTHER_VEHICLE_COLOURS)],
            linestyle="--",
            linewidth=1.0,
            label=label,
        )
    for fixes in [each for each in drive.measurements if each.kind is Kind.POSITION][:1]:
        axes.plot(
            *fixes.values[:, :2].T, ".", color=MEASURED_COLOUR, markersize=3, zorder=1, label="raw position fixes"
        )
    if drive.truth is not None:
        axes.plot(*drive.truth.xy.T, color=TRUTH_COLOUR, linestyle=":", linewidth=1.2, label="the truth")
    axes.plot(*xy.T, color=ESTIMATE_COLOUR, linewidth=1.5, label="the car, estimated")
    axes.plot(*xy[0], "o", color=ESTIMATE_COLOUR, markerfacecolor="none", label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east [m]")
    axes.set_ylabel("north [m]")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=3, fontsize="small")
