"""Associate detections with tracks of many targets, with given or estimated clutter densities."""

from __future__ import annotations

import numpy as np

from cwcli.kernels.track import RowKind
from cwcli.tracking.config import TrackerConfig
from cwcli.tracking.detections import DetectionKind, SensorModel
from cwcli.tracking.prepare import PreparedDetections
from cwcli.tracking.scan_loop import Association, ScanLoop

_MIN_EXTENT_OF_SENSOR_MEASURING_RANGE_BY_KIND = {
    RowKind.POSITION: (20.0, 20.0),
    RowKind.RADAR_WITHOUT_RATE: (20.0, 1.0),
    RowKind.RADAR: (20.0, 1.0, 10.0),
}
"""Least extent of each value over which a sensor measures, however little it saw: m; m, rad, m/s. Chosen by hand."""

_DEFAULT_EXTENT_OF_SENSOR_MEASURING_RANGE_BY_KIND = {
    RowKind.POSITION: (100.0, 100.0),
    RowKind.RADAR_WITHOUT_RATE: (100.0, 1.0),
    RowKind.RADAR: (100.0, 1.0, 20.0),
}
"""Assumed extent of each value of an unknown sensor: m; m, rad, m/s. Chosen by hand; not fitted."""


def default_clutter_density(kind: DetectionKind, model: SensorModel) -> float:
    """The clutter density of an unknown sensor: one false detection per scan over its assumed extent."""
    if kind == DetectionKind.POSITION:
        return float(1.0 / np.prod(_DEFAULT_EXTENT_OF_SENSOR_MEASURING_RANGE_BY_KIND[RowKind.POSITION]))
    return float(
        1.0
        / np.prod(
            _DEFAULT_EXTENT_OF_SENSOR_MEASURING_RANGE_BY_KIND[
                RowKind.RADAR if model.use_range_rate else RowKind.RADAR_WITHOUT_RATE
            ]
        )
    )


def volume_of_measurement_space(prepared: PreparedDetections, source: int) -> float:
    """Volume of the measurement space in which a source's detections lie: 2.5 to 97.5 % of each value.

    Positions are relative to the sensor, so that the car's motion does not enlarge it.
    """
    rows = prepared.rows
    mine = rows.source == source
    kind = RowKind(rows.kind[mine].max(initial=RowKind.POSITION))
    least = np.array(_MIN_EXTENT_OF_SENSOR_MEASURING_RANGE_BY_KIND[kind])
    if mine.sum() < 2:
        return float(np.prod(least))
    z = rows.z[mine][:, : len(least)]
    if kind == RowKind.POSITION:
        z = z - rows.origin[mine, :2]
    else:
        z = z.copy()
        z[:, 1] -= np.angle(np.exp(1j * z[:, 1]).mean())
        z[:, 1] = (z[:, 1] + np.pi) % (2.0 * np.pi) - np.pi
    low, high = np.quantile(z, [0.025, 0.975], axis=0)
    return float(np.prod(np.maximum((high - low) / 0.95, least)))


def associate_detections(prepared: PreparedDetections, config: TrackerConfig) -> Association:
    """Associate every detection with a track or with none.

    Clutter densities that the sensor models do not give are estimated: the first pass counts every detection as
    clutter, the second one only those without a confirmed track.
    """
    names, models = prepared.rows.sources, prepared.models
    n_scans = np.bincount(prepared.scans.source, minlength=len(names)).clip(1)
    volumes = [volume_of_measurement_space(prepared, k) for k in range(len(names))]
    n_rows = np.bincount(prepared.rows.source, minlength=len(names))
    # at least one false detection in all scans together: with a density of 0 every detection would be a target
    density = np.array(
        [
            m.clutter_density if m.clutter_density is not None else max(n / s, 1.0 / s) / v
            for m, n, s, v in zip(models, n_rows, n_scans, volumes, strict=True)
        ]
    )
    result = ScanLoop(prepared, config, density).associate_all_scans()
    if any(m.clutter_density is None for m in models):
        for k, model in enumerate(models):
            if model.clutter_density is None:
                free = int(((result.row_track == 0) & (prepared.rows.source == k)).sum())
                density[k] = max(free, 1) / n_scans[k] / volumes[k]
        result = ScanLoop(prepared, config, density).associate_all_scans()
    return result
