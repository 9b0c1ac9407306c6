"""Track one or many targets from the detections of several sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import Literal

import numpy as np

from cwcli.kernels.track import RowKind, RowStatus
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array, sort_distinct_values
from cwcli.tracking.association import associate_detections
from cwcli.tracking.config import TrackerConfig
from cwcli.tracking.detections import DetectionCounts, Detections, EgoStates, SensorModel
from cwcli.tracking.prepare import DetectionRows, PreparedDetections, prepare_detections
from cwcli.tracking.scan_loop import Association
from cwcli.tracking.single_target import FilterOutput, NisConsistency, filter_single_target, nis_consistency_by_source
from cwcli.tracking.tune import TunedFilter, scale_sigmas, tune_noise

TargetCountChoice = Literal["auto", "one", "many"]
"""Number of targets as the user gives it."""
NO_SIGMA_FACTORS: Mapping[str, tuple[float, ...]] = {}
"""Factors on the sigmas of each sensor where no noise was tuned: an empty mapping, so that no sigma is scaled."""
MAX_DETECTIONS_OUTSIDE_GATE_OF_SINGLE_TARGET_SHARE = 0.1
"""Greatest share of detections outside the gate of a single target; a larger one means more targets. Chosen by hand;
not fitted."""


@dataclass(frozen=True)
class TargetTrack:
    """The track of one target.

    Attributes:
        id: Number from 1 in the order of confirmation; it never changes and is never used again.
        stamp_ns: Shape (n,), int64, non-decreasing: the times of the scans.
        state: Shape (n, d): x_m, y_m, vx_mps, vy_mps and the model's own, in the tracking frame.
        covariance: Shape (n, d, d).
        source: Shape (n,): index into `TrackResult.sources` of the sensor that updated the row, -1 = coasted.
        confirmed_ns: Time of confirmation; earlier rows were tentative (they are there only when smoothed).
    """

    id: int
    stamp_ns: Int64Array
    state: FloatArray
    covariance: FloatArray
    source: Int64Array
    confirmed_ns: int

    def __len__(self) -> int:
        return len(self.stamp_ns)


@dataclass(frozen=True)
class TrackResult:
    """All tracks of a drive.

    Attributes:
        tracks: The tracks in the order of their ids.
        frame: `map` when the ego states were given, else `body`.
        sources: Names of the sensors.
        counts: Source -> read, used, rejected by reason, repaired.
        consistency: Source -> mean NIS over all tracks with its 95 % bounds, from the filter (not the smoother).
        state_names: Columns of `state`.
        tuned: What `tune` found, or None.
        clutter_density: Source -> density used; empty for one target.
        notes: Notes for the user.
    """

    tracks: tuple[TargetTrack, ...]
    frame: str
    sources: tuple[str, ...]
    counts: dict[str, DetectionCounts]
    consistency: dict[str, NisConsistency]
    state_names: tuple[str, ...]
    tuned: TunedFilter | None = None
    clutter_density: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def track_one_target(
    detections: Sequence[Detections],
    sensors: Mapping[str, SensorModel] | None = None,
    config: TrackerConfig | None = None,
    ego: EgoStates | None = None,
    scale: Mapping[str, tuple[float, ...]] = NO_SIGMA_FACTORS,
) -> TrackResult:
    """Track one target that every detection belongs to (xiang2019); the filter starts at the first detection.

    Args:
        detections: One entry per sensor.
        sensors: Source -> model.
        config: Only `single` and `max_scan` are used.
        ego: The car's states, or None.
        scale: Source -> known factors on its sigmas (`TunedFilter.scale`).
    """
    config = config or TrackerConfig()
    prepared = prepare_detections(detections, sensors, ego, max_scan=config.max_scan)
    rows, single, tuned = scale_sigmas(prepared.rows, scale), config.single, None
    if single.tune and len(rows):
        tuned = tune_noise([rows], single)
        rows, single = scale_sigmas(rows, tuned.scale), tuned.config
    tracks: tuple[TargetTrack, ...] = ()
    output = filter_single_target(rows, single, smooth=False)
    checks = nis_consistency_by_source(rows.sources, rows.source, output.nis, output.n_values, output.status)
    if len(rows):
        shown = filter_single_target(rows, single, smooth=True) if single.smooth else output
        updated = np.isin(output.status, (RowStatus.USED, RowStatus.STARTED))
        source = np.where(updated, rows.source, -1)
        first = int(rows.stamp_ns[0])
        tracks = (TargetTrack(1, rows.stamp_ns, shown.state, shown.covariance, source, first),)
    for name, count in prepared.counts.items():
        k = rows.sources.index(name)
        n_gated = int(((output.status == RowStatus.GATED) & (rows.source == k)).sum())
        count.count_rejected("outside the gate", n_gated)
        count.used -= n_gated
    return TrackResult(
        tracks, "map" if prepared.has_ego else "body", rows.sources, prepared.counts, checks,
        single.motion_model.states, tuned,
    )  # fmt: skip


def track_many_targets(
    detections: Sequence[Detections],
    sensors: Mapping[str, SensorModel] | None = None,
    config: TrackerConfig | None = None,
    ego: EgoStates | None = None,
    scale: Mapping[str, tuple[float, ...]] = NO_SIGMA_FACTORS,
) -> TrackResult:
    """Track any number of targets: gating, global nearest neighbour, births and deaths, then each track by itself.

    With `config.single.smooth` a track runs from its first to its last detection, smoothed. Without, it runs from its
    confirmation to its end, and a row uses nothing later.

    Args:
        detections: One entry per sensor.
        sensors: Source -> model.
        ego: The car's states, or None.
        scale: As for `track_one_target`.
    """
    config = config or TrackerConfig()
    prepared = prepare_detections(detections, sensors, ego, max_scan=config.max_scan)
    prepared = replace(prepared, rows=scale_sigmas(prepared.rows, scale))
    found = associate_detections(prepared, config)
    tuned = None
    if config.single.tune and len(found.track_id):
        parts = [prepared.rows.select_rows(found.row_track == i) for i in found.track_id.tolist()]
        tuned = tune_noise(parts, config.single)
        prepared = replace(prepared, rows=scale_sigmas(prepared.rows, tuned.scale))
        config = replace(config, single=tuned.config)
        found = associate_detections(prepared, config)
    tracks = []
    pool = []
    for k in range(len(found.track_id)):
        track, part = _filter_one_track_with_rows_and_output(prepared, found, k, config)
        tracks.append(track)
        pool.append(part)
    for name, count in prepared.counts.items():
        mine = prepared.rows.source == prepared.rows.sources.index(name)
        free = int((found.row_track[mine] == 0).sum())
        count.count_rejected("belongs to no confirmed track", free)
        count.used -= free
    notes = []
    if found.n_refused:
        notes.append(f"{found.n_refused} possible new targets refused: {config.max_tracks} tracks at a time")
    return TrackResult(
        tuple(tracks), "map" if prepared.has_ego else "body", prepared.rows.sources, prepared.counts,
        _consistency_by_source_over_tracks(prepared.rows.sources, pool), config.single.motion_model.states, tuned,
        found.clutter_density, tuple(notes),
    )  # fmt: skip


def _rows_at_all_scans(prepared: PreparedDetections, which: Int64Array, last_ns: int) -> DetectionRows:
    """The rows `which` and a predict-only row at every other scan between the first of them and `last_ns`."""
    rows = prepared.rows.select_rows(which)
    times = sort_distinct_values(prepared.scans.stamp_ns)
    inside = times[(times > rows.stamp_ns[0]) & (times <= last_ns)]
    empty = np.setdiff1d(inside, rows.stamp_ns)
    m = len(empty)
    joined_rows = DetectionRows(
        np.concatenate([rows.stamp_ns, empty]),
        np.concatenate([rows.source, np.full(m, -1)]),
        np.concatenate([rows.kind, np.full(m, RowKind.NOTHING, np.int8)]),
        np.concatenate([rows.z, np.zeros((m, 3))]),
        np.concatenate([rows.r, np.tile(np.eye(3), (m, 1, 1))]),
        np.concatenate([rows.origin, np.zeros((m, 4))]),
        np.concatenate([rows.index, np.full(m, -1)]),
        rows.sources,
    )
    return joined_rows.select_rows(np.argsort(joined_rows.stamp_ns, kind="stable"))


def _filter_one_track_with_rows_and_output(
    prepared: PreparedDetections, association: Association, track_index: int, config: TrackerConfig
) -> tuple[TargetTrack, tuple[Int64Array, FilterOutput]]:
    """Filter (and smooth) one track over its own detections."""
    single = replace(config.single, gate_probability=1.0)
    which = np.flatnonzero(association.row_track == association.track_id[track_index])
    last_ns = int(prepared.rows.stamp_ns[which[-1]] if single.smooth else association.ended_ns[track_index])
    rows = _rows_at_all_scans(prepared, which, last_ns)
    output = filter_single_target(rows, single, smooth=False)
    shown = filter_single_target(rows, single, smooth=True) if single.smooth else output
    keep = np.ones(len(rows), bool) if single.smooth else rows.stamp_ns >= association.confirmed_ns[track_index]
    track = TargetTrack(
        int(association.track_id[track_index]), rows.stamp_ns[keep], shown.state[keep], shown.covariance[keep],
        rows.source[keep], int(association.confirmed_ns[track_index]),
    )  # fmt: skip
    return track, (rows.source, output)


def _consistency_by_source_over_tracks(
    sources: tuple[str, ...], pool: Sequence[tuple[Int64Array, FilterOutput]]
) -> dict[str, NisConsistency]:
    """NIS consistency of each source over all tracks."""
    if not pool:
        return {}
    return nis_consistency_by_source(
        sources,
        np.concatenate([source for source, _ in pool]),
        np.concatenate([output.nis for _, output in pool]),
        np.concatenate([output.n_values for _, output in pool]),
        np.concatenate([output.status for _, output in pool]),
    )


def track_targets_and_name_method(
    targets: TargetCountChoice,
    detections: Sequence[Detections],
    models: Mapping[str, SensorModel],
    config: TrackerConfig,
    ego: EgoStates | None = None,
) -> tuple[TrackResult, str]:
    """Track `one` target or `many`: the tracks, and which of both was chosen.

    Args:
        targets: `one`, `many`, or `auto`: one if no scan has two detections and a single track uses nine in ten of
            them, else many.
        detections, models, config, ego: As for `track_one_target` and `track_many_targets`.
    """
    one_a_scan = all(_max_detections_in_a_scan(data) <= 1 for data in detections)
    if targets == "one" or (targets == "auto" and one_a_scan):
        result = track_one_target(detections, models, config, ego)
        gated = sum(count.rejected.get("outside the gate", 0) for count in result.counts.values())
        used = sum(count.used for count in result.counts.values())
        if targets == "one" or gated <= MAX_DETECTIONS_OUTSIDE_GATE_OF_SINGLE_TARGET_SHARE * (gated + used):
            return result, "one"
    return track_many_targets(detections, models, config, ego), "many"


def track_targets_online(
    result: TrackResult,
    method_name: str,
    detections: Sequence[Detections],
    models: Mapping[str, SensorModel],
    config: TrackerConfig,
    ego: EgoStates | None = None,
) -> TrackResult:
    """Track without smoothing, with the noise, the clutter and the number of targets of another result.

    Args:
        result, method_name: Results of `track_targets_and_name_method`.
        ego: The car's states as they could have been known online.
    """
    tuned = result.tuned
    single = replace(config.single if tuned is None else tuned.config, tune=False, smooth=False)
    found = {
        source: replace(model, clutter_density=result.clutter_density.get(source, model.clutter_density))
        for source, model in models.items()
    }
    track = track_one_target if method_name == "one" else track_many_targets
    return track(
        detections, found, replace(config, single=single), ego, NO_SIGMA_FACTORS if tuned is None else tuned.scale
    )


def _max_detections_in_a_scan(data: Detections) -> int:
    """The largest number of finite detections that share a stamp."""
    stamps = data.stamp_ns[np.isfinite(data.values[:, :2]).all(axis=1)]
    return int(np.unique(stamps, return_counts=True)[1].max(initial=0))
