"""What `track` says: a line per sensor and target, and the metrics table."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cwcli.metrics.table import MetricRow, Table, metric_table
from cwcli.pipeline.result import Cell, InputCount, Section
from cwcli.stages.summaries import NIS_WORDS, bounds_text
from cwcli.tracking.config import FilterConfig
from cwcli.tracking.detections import Counts, DetectionKind
from cwcli.tracking.single import Consistency
from cwcli.tracking.tracker import TargetTrack, TrackResult

ASSOCIATION = ("outside the gate", "belongs to no confirmed track")
"""Reasons that lie in the scene and not in the data: they are no faults."""
VALUES: dict[DetectionKind, tuple[tuple[str, str], ...]] = {
    DetectionKind.POSITION: (("position", "m"),),
    DetectionKind.RADAR: (("range", "m"), ("azimuth", "rad"), ("range rate", "m/s")),
}
MAX_TARGETS_SHOWN = 20
S_PER_NS = 1e-9


def detection_counts(counts: Mapping[str, Counts]) -> tuple[InputCount, ...]:
    """What became of the detections, by sensor. One that fits no track is used all the same: it was weighed."""
    found = []
    for source, count in counts.items():
        faults = {reason: n for reason, n in count.rejected.items() if reason not in ASSOCIATION}
        used = count.read - sum(faults.values())
        found.append(InputCount(source, "each detection", count.read, used, faults, dict(count.repaired)))
    return tuple(found)


def sections(result: TrackResult, kinds: Mapping[str, DetectionKind], *, in_map: bool) -> tuple[Section, ...]:
    """The stage's tables for the terminal."""
    found = [_sensors_section(result), _noise_section(result, kinds), _targets_section(result, in_map)]
    return tuple(item for item in found if item.rows)


def track_tables(result: TrackResult, single: FilterConfig, kinds: Mapping[str, DetectionKind]) -> dict[str, Table]:
    """One table; its vehicle is the id of a target, or "" for all, its source a sensor."""
    rows: list[MetricRow] = []
    for source, count in result.counts.items():
        rows.extend(_sensor_rows(source, count, result, kinds[source]))
    tuned = single if result.tuned is None else result.tuned.config
    rows.append(("", "", "process", "noise", _noise(tuned), _noise_unit(tuned)))
    if tuned.motion.turn_noise > 0.0:
        rows.append(("", "", "process", "turn_noise", _turn_noise(tuned), "rad/s^1.5"))
    rows.append(("", "", "targets", "count", float(len(result.tracks)), ""))
    for track in result.tracks:
        rows.append((str(track.id), "", "state", "count", float(len(track)), ""))
        rows.append((str(track.id), "", "state", "seen_count", float((track.source >= 0).sum()), ""))
        rows.append((str(track.id), "", "position", "median_sigma", _median_sigma(track), "m"))
    return {"track": metric_table("track", rows)}


def _sensor_rows(source: str, count: Counts, result: TrackResult, kind: DetectionKind) -> list[MetricRow]:
    quantity = "position" if kind == DetectionKind.POSITION else "radar"
    rows: list[MetricRow] = [("", source, quantity, "read_count", float(count.read), "")]
    rows.append(("", source, quantity, "used_count", float(count.used), ""))
    for reason, n in (*count.rejected.items(), *count.repaired.items()):
        rows.append(("", source, reason, "count", float(n), ""))
    check = result.consistency.get(source)
    if check is not None:
        per = check.dof or math.nan
        for metric, value in (
            ("nis_mean", check.nis_mean),
            ("nis_dof", check.dof),
            ("nis_per_dof", check.nis_mean / per),
            ("nis_lower", check.low / per),
            ("nis_upper", check.high / per),
            ("nis_inside", float(check.is_inside)),
        ):
            rows.append(("", source, quantity, metric, value, ""))
    if result.tuned is not None:
        names = [name for name, _ in VALUES[kind]]
        rows.extend(
            ("", source, name, "noise_factor", factor, "")
            for name, factor in zip(names, result.tuned.scale.get(source, ()), strict=False)
        )
    if source in result.clutter_density:
        rows.append(("", source, quantity, "clutter_density", result.clutter_density[source], ""))
    return rows


def _sensors_section(result: TrackResult) -> Section:
    rows: list[tuple[Cell, ...]] = []
    for source, count in result.counts.items():
        check = result.consistency.get(source)
        free = sum(count.rejected.get(reason, 0) for reason in ASSOCIATION)
        faulty = count.read - count.used - free
        rows.append((source, count.read, count.used, free, faulty, *_nis_cells(check)))
    columns = ("sensor", "detections", "used", "no track", "faulty", "NIS/dof", "95 % bounds", "inside")
    return Section("sensors", "Detections, and consistency of the innovations", columns, tuple(rows))


def _nis_cells(check: Consistency | None) -> tuple[Cell, ...]:
    if check is None or not check.dof > 0.0:
        return None, "", ""
    bounds = bounds_text(check.low / check.dof, check.high / check.dof)
    return check.nis_mean / check.dof, bounds, NIS_WORDS[check.is_inside]


def _noise_section(result: TrackResult, kinds: Mapping[str, DetectionKind]) -> Section:
    if result.tuned is None:
        return Section("noise", "", (), ())
    rows: list[tuple[Cell, ...]] = [
        (source, name, factor)
        for source, factors in result.tuned.scale.items()
        for (name, _), factor in zip(VALUES[kinds[source]], factors, strict=False)
    ]
    tuned = result.tuned.config
    rows.append(("process", f"acceleration [{_noise_unit(tuned)}]", _noise(tuned)))
    if tuned.motion.turn_noise > 0.0:
        rows.append(("process", "turn rate [rad/s^1.5]", _turn_noise(tuned)))
    title = "Noise by maximum likelihood: factor on each given sigma, process noise"
    return Section("noise", title, ("source", "quantity", "found"), tuple(rows))


def _targets_section(result: TrackResult, in_map: bool) -> Section:
    start_ns = min((int(track.stamp_ns[0]) for track in result.tracks), default=0)
    longest = sorted(result.tracks, key=len, reverse=True)[:MAX_TARGETS_SHOWN]
    rows: list[tuple[Cell, ...]] = []
    for track in sorted(longest, key=lambda one: one.id):
        speed = np.hypot(track.state[:, 2], track.state[:, 3])
        rows.append(
            (
                str(track.id),
                float(track.stamp_ns[0] - start_ns) * S_PER_NS,
                float(track.stamp_ns[-1] - track.stamp_ns[0]) * S_PER_NS,
                len(track),
                100.0 * float((track.source >= 0).mean()),
                float(speed.max()),
                _median_sigma(track),
            )
        )
    shown = "" if len(longest) == len(result.tracks) else f" (the {len(longest)} longest of {len(result.tracks)})"
    columns = ("target", "from [s]", "for [s]", "states", "seen [%]", "max speed [m/s]", "median sigma [m]")
    return Section("targets", f"Targets in the {'map' if in_map else 'frame of the car'}{shown}", columns, tuple(rows))


def _noise(config: FilterConfig) -> float:
    return config.motion.noise if config.noise is None else config.noise


def _turn_noise(config: FilterConfig) -> float:
    return config.motion.turn_noise if config.turn_noise is None else config.turn_noise


def _noise_unit(config: FilterConfig) -> str:
    return "m/s^2.5" if "ax_mps2" in config.motion.states else "m/s^1.5"


def _median_sigma(track: TargetTrack) -> float:
    """Median of the horizontal one-sigma per axis."""
    return float(np.median(np.sqrt(0.5 * (track.covariance[:, 0, 0] + track.covariance[:, 1, 1]))))
