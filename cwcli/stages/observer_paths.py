"""Paths from the observer's channel, in the car's own axes: what `predict-lane` and overlays start from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cwcli.channels.lateral_state import Observed, read_observed
from cwcli.channels.published import OBSERVER
from cwcli.dynamics.vehicle import Vehicle
from cwcli.logs.read.reader import Log
from cwcli.pipeline.records import vehicle_of
from cwcli.prediction.lateral import LateralPathConfig, lateral_paths
from cwcli.prediction.lateral_calibrate import calibrate_paths
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import FloatArray, Int64Array

MODEL_NAMES = {"cwcli": "lateral", "zhang2011": "lateral-zhang2011"}
"""Path model of `prediction.lateral` -> its name in `cwcli.v1.PredictedPath`."""


@dataclass(frozen=True)
class BodyPaths:
    """The path from each observed frame, in the body frame of that frame.

    Attributes:
        observed: n frames, in the order of their stamps; `observed.track` holds speed, state and status.
        paths: n paths of the centre of gravity: x forward, y left, from (0, 0, 0); NaN where there is no state.
            `position_covariance_m2` is that of the way since the frame, so it is zero at the start.
        vehicle: The car that was observed.
        model: Name of the path model, as in `cwcli.v1.PredictedPath`.
        notes: For the user.
    """

    observed: Observed
    paths: Paths
    vehicle: Vehicle
    model: str
    notes: tuple[str, ...] = ()

    @property
    def stamp_ns(self) -> Int64Array:
        """Shape (n,), increasing: time of each frame, the stamp of its image."""
        return self.observed.track.stamp_ns

    def row(self, stamp_ns: int) -> int | None:
        """The row of the frame with this stamp that has a path; None if there is none."""
        at = int(np.searchsorted(self.stamp_ns, stamp_ns))
        if at == len(self.stamp_ns) or self.stamp_ns[at] != stamp_ns or np.isnan(self.paths.x_m[at, 0]):
            return None
        return at

    def before_camera(self, row: int) -> tuple[FloatArray, FloatArray]:
        """One path on the road as the camera's geometry counts it.

        Returns:
            Points (k, 2): x ahead of the point below the camera, y left of the car's centre line, m (the axes of
            `LaneBoundary.lateral_m`); and their covariance (k, 2, 2), m^2. The first points lie behind the camera if
            that is ahead of the centre of gravity.
        """
        xx, xy, yy = np.moveaxis(self.paths.position_covariance_m2[row], -1, 0)
        points = np.column_stack([self.paths.x_m[row] - self.vehicle.camera_forward_m, self.paths.y_m[row]])
        return points, np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)


def body_paths(
    log: Log,
    config: LateralPathConfig | None = None,
    *,
    topic: str = OBSERVER.topic,
    calibrate: bool = True,
    start_ns: int | None = None,
    end_ns: int | None = None,
) -> BodyPaths:
    """Predict from each frame of a log's observer channel.

    Args:
        log: With the channel of `cwcli observe`, in the file or in memory.
        config: Model, horizon, step; None: the defaults. The preview distance is the channel's.
        topic: The channel.
        calibrate: Scale the uncertainty across the path by how far this record's car went from its paths; looks at
            the whole record.
        start_ns, end_ns: Only frames logged in this span.

    Raises:
        DataError: The channel is of another version.
    """
    observed = read_observed(log.columns(topic).logged_within(start_ns, end_ns))
    vehicle, notes = vehicle_of(log)
    made = predict_body(observed, vehicle, config, calibrate=calibrate)
    return replace(made, notes=notes)


def predict_body(
    observed: Observed, vehicle: Vehicle, config: LateralPathConfig | None = None, *, calibrate: bool = True
) -> BodyPaths:
    """The same from a channel that has been read."""
    config = replace(config or LateralPathConfig(), preview_m=observed.preview_m)
    paths = lateral_paths(observed.track, vehicle, config)
    if calibrate:
        paths = calibrate_paths(paths, observed.track)
    return BodyPaths(observed, paths, vehicle, MODEL_NAMES[config.model])
