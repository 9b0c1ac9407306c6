"""What `estimate` says: a line per source and vehicle."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from cwcli.estimation.latency import Latency
from cwcli.estimation.measurements import QUANTITIES
from cwcli.estimation.result import SourceReport
from cwcli.estimation.summary import TrackSummary, quantity_of
from cwcli.pipeline.result import Cell, Section
from cwcli.signals.canonical import TimedSignal
from cwcli.signals.clocks import find_gaps
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import EGO_ID, StateFlag
from cwcli.stages.summaries import NIS_WORDS, bounds_text

MAX_GAP_NOTES = 5


def sections(tracks: Mapping[str, TrackSummary]) -> tuple[Section, ...]:
    """The stage's tables for the terminal."""
    ego = tracks[EGO_ID]
    return _sources_section(ego), _noise_section(ego), _vehicles_section(tracks)


def gap_notes(signals: Iterable[TimedSignal], start_ns: int, end_ns: int) -> list[str]:
    """One line for each signal with gaps, a late start and an early end included: how many, and where the longest is.

    Args:
        signals: Canonical signals.
        start_ns, end_ns: Span in which the signals should have been there.
    """
    notes = []
    for signal in signals:
        gaps = find_gaps(np.sort(signal.stamp_ns), start_ns=start_ns, end_ns=end_ns)
        if not gaps:
            continue
        longest = max(gaps, key=lambda gap: gap.duration_s)
        at_s = (longest.start_ns - start_ns) / NS_PER_S
        count = len(gaps)
        notes.append(
            f"{signal.source}: {count} gap{'s' if count > 1 else ''}, the longest {longest.duration_s:.1f} s "
            f"from {at_s:.1f} s on"
        )
    return notes[:MAX_GAP_NOTES] + (
        [f"{len(notes) - MAX_GAP_NOTES} more channels have gaps"] if len(notes) > MAX_GAP_NOTES else []
    )


def _sources_section(ego: TrackSummary) -> Section:
    rows: list[tuple[Cell, ...]] = [
        (
            report.source,
            quantity_of(report),
            report.n_used,
            report.n_gated,
            _latency_text(report.latency),
            report.latency.status.value,
            _bias_text(report),
        )
        for report in ego.sources
    ]
    columns = ("source", "quantity", "used", "gated", "latency [ms]", "latency status", "bias")
    return Section("sources", "Ego sources: what was used and corrected", columns, tuple(rows))


def _noise_section(ego: TrackSummary) -> Section:
    rows: list[tuple[Cell, ...]] = [
        (
            report.source,
            quantity_of(report),
            f"{report.sigma:.3g} {QUANTITIES[report.kind].unit}",
            report.noise_origin,
            report.nis_mean / report.nis_dof,
            bounds_text(*(bound / report.nis_dof for bound in report.nis_bounds)),
            NIS_WORDS[report.nis_inside],
        )
        for report in ego.sources
    ]
    columns = ("source", "quantity", "noise", "from", "NIS/dof", "95 % bounds", "inside")
    return Section("noise", "Ego sources: noise and consistency of the innovations", columns, tuple(rows))


def _vehicles_section(tracks: Mapping[str, TrackSummary]) -> Section:
    rows: list[tuple[Cell, ...]] = [
        (
            vehicle,
            track.n_states,
            track.span_s,
            track.max_speed_mps,
            track.median_sigma_m,
            sum(report.n_gated for report in track.sources),
            *track.n_flagged.values(),
        )
        for vehicle, track in tracks.items()
    ]
    columns = (
        "vehicle",
        "states",
        "span [s]",
        "max speed [m/s]",
        "median sigma [m]",
        "gated",
        *(str(f.name).lower().replace("_", " ") for f in StateFlag),
    )
    return Section("vehicles", "Estimated tracks", columns, tuple(rows))


def _latency_text(latency: Latency) -> str:
    if math.isnan(latency.found_s):
        return ""
    value = f"{1e3 * latency.found_s:.0f}"
    return value if math.isnan(latency.sigma_s) else f"{value} +- {1e3 * latency.sigma_s:.0f}"


def _bias_text(report: SourceReport) -> str:
    if math.isnan(report.bias):
        return ""
    return f"{report.bias:.3g} {QUANTITIES[report.kind].unit}"
