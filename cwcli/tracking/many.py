"""Many targets: which detections belong together, with clutter densities that are known or found."""

from __future__ import annotations

import numpy as np

from cwcli.kernels.track import RowKind
from cwcli.tracking.config import TrackerConfig
from cwcli.tracking.detections import DetectionKind, SensorModel
from cwcli.tracking.prepare import PreparedDetections
from cwcli.tracking.scan_loop import Association, ScanLoop

# A sensor watches at least this much, however little it saw: m; m, rad, m/s.
_LEAST_EXTENT = {
    RowKind.POSITION: (20.0, 20.0),
    RowKind.RADAR_WITHOUT_RATE: (20.0, 1.0),
    RowKind.RADAR: (20.0, 1.0, 10.0),
}


_USUAL_EXTENT = {
    RowKind.POSITION: (100.0, 100.0),
    RowKind.RADAR_WITHOUT_RATE: (100.0, 1.0),
    RowKind.RADAR: (100.0, 1.0, 20.0),
}


def usual_density(kind: DetectionKind, model: SensorModel) -> float:
    """The clutter density of a sensor of which nothing is known: one false detection in a scan."""
    if kind == DetectionKind.POSITION:
        return float(1.0 / np.prod(_USUAL_EXTENT[RowKind.POSITION]))
    return float(1.0 / np.prod(_USUAL_EXTENT[RowKind.RADAR if model.use_range_rate else RowKind.RADAR_WITHOUT_RATE]))


def volume(prepared: PreparedDetections, source: int) -> float:
    """Size of the part of the measurement space in which a source's detections lie: 2.5 to 97.5 % of each value.

    Positions count from the sensor, so that a drive through the map does not widen it.
    """
    rows = prepared.rows
    mine = rows.source == source
    kind = RowKind(rows.kind[mine].max(initial=RowKind.POSITION))
    least = np.array(_LEAST_EXTENT[kind])
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


def associate(prepared: PreparedDetections, config: TrackerConfig) -> Association:
    """Give every detection to a track.

    Clutter densities that the sensor models leave open are estimated: a first pass counts every detection as possible
    clutter, a second one only those that no confirmed track took.
    """
    names, models = prepared.rows.sources, prepared.models
    n_scans = np.bincount(prepared.scans.source, minlength=len(names)).clip(1)
    volumes = [volume(prepared, k) for k in range(len(names))]
    n_rows = np.bincount(prepared.rows.source, minlength=len(names))
    # at least one false detection in all scans together: a density of 0 would take anything for a target
    density = np.array(
        [
            m.clutter_density if m.clutter_density is not None else max(n / s, 1.0 / s) / v
            for m, n, s, v in zip(models, n_rows, n_scans, volumes, strict=True)
        ]
    )
    result = ScanLoop(prepared, config, density).run()
    if any(m.clutter_density is None for m in models):
        for k, model in enumerate(models):
            if model.clutter_density is None:
                free = int(((result.row_track == 0) & (prepared.rows.source == k)).sum())
                density[k] = max(free, 1) / n_scans[k] / volumes[k]
        result = ScanLoop(prepared, config, density).run()
    return result
