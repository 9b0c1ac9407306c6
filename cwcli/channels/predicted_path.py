"""`cwcli.v1.PredictedPath`: where the ego and the other vehicles are going to be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

import numpy as np

from cwcli.channels.output import first_rows_of_each_vehicle_and_period, make_output_channel
from cwcli.channels.published import Channel
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.errors import DataError
from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.paths import Paths
from cwcli.prediction.plan import PathPlan, SelectedPaths
from cwcli.signals.columns import (
    Columns,
    Field,
    FloatArray,
    Int64Array,
    OutputChannel,
    OutputField,
    StreamedChannel,
    Strings,
    repeat_string,
)
from cwcli.signals.leaf_fields import read_integers, read_matrix, read_numbers, read_texts
from cwcli.signals.precision import round_plane_covariance, round_to_binary_step
from cwcli.signals.row_order import Rows

LENGTH_FRACTION_BITS, ANGLE_FRACTION_BITS, VARIANCE_BINARY_DIGITS = 7, 12, 6
"""Positions and speeds are multiples of 2^-7 m (m/s), headings of 2^-12 rad; variances have 6 binary digits."""
MAX_PATH_POINT_INTERVAL_S = 0.25
"""Longest time between published points, s; chosen: a car that brakes with 3 m/s^2 deviates 2 cm from the chord."""
MAX_PATH_STEP_DIFFERENCE_S = 1e-6
"""Largest difference of the steps of one channel's paths, s; chosen: rounding errors only."""


@dataclass(frozen=True)
class PredictedPaths:
    """Paths of vehicles, n rows.

    Attributes:
        stamp_ns, log_time_ns: Shape (n,): time of the start; time at which it was known.
        model: The motion model of all of them.
        paths: One a row.
    """

    ids: Strings
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    model: str
    paths: Paths

    @classmethod
    def from_states(cls, states: VehicleStates, model: str, paths: Paths) -> PredictedPaths:
        return cls(states.ids, states.stamp_ns, states.log_time_ns, model, paths)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def time_s(self) -> FloatArray:
        """The times of each path's points, from its start."""
        return self.paths.time_s

    def select_paths(self, rows: Rows) -> Paths:
        return self.paths.paths_of_rows(rows)

    def positions_m_of_points(self, rows: Rows, points: Rows) -> FloatArray:
        """Some points of some paths, shape (rows, points, 2)."""
        at = np.ix_(rows, points)
        return np.stack([self.paths.x_m[at], self.paths.y_m[at]], axis=2)


@dataclass(frozen=True)
class LazyPaths:
    """Paths of vehicles that are computed on request; n rows, one from each state.

    Attributes:
        ids, stamp_ns, log_time_ns: As of `PredictedPaths`.
        plan: The motion model and the states from which paths are computed.
    """

    ids: Strings
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    plan: PathPlan

    @classmethod
    def from_states(cls, states: VehicleStates, plan: PathPlan) -> LazyPaths:
        return cls(states.ids, states.stamp_ns, states.log_time_ns, plan)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def model(self) -> str:
        """The motion model of all of them."""
        return self.plan.model

    @property
    def time_s(self) -> FloatArray:
        """The times of each path's points, from its start."""
        return self.plan.time_s

    def select_paths(self, rows: Rows) -> SelectedPaths:
        return SelectedPaths(self.plan, rows)

    def positions_m_of_points(self, rows: Rows, points: Rows) -> FloatArray:
        """Some points of some paths, shape (rows, points, 2)."""
        paths = self.plan.paths_of_rows(rows, points=points)
        return np.stack([paths.x_m, paths.y_m], axis=2)


AnyPaths = PredictedPaths | LazyPaths
"""Paths of vehicles, n rows: computed, or on request."""


@dataclass(frozen=True)
class LazyPathChannel(StreamedChannel):
    """A channel of paths that are computed while the log is written; reading it gives the same messages.

    Attributes:
        lazy_paths: All paths, for later stages of the same run.
    """

    lazy_paths: LazyPaths = field(kw_only=True)


def make_predicted_path_channel(channel: Channel, predicted: PredictedPaths, *, frame_id: str = "") -> OutputChannel:
    """Make the channel of one message a path.

    Args:
        frame_id: "" for `map`.
    """
    fields = _predicted_path_fields(predicted.ids, predicted.stamp_ns, predicted.model, predicted.paths)
    if frame_id:
        fields["frame_id"] = repeat_string(frame_id, len(predicted))
    return make_output_channel(channel, predicted.log_time_ns, fields)


def make_lazy_path_channel(channel: Channel, planned: LazyPaths, *, rate_hz: float) -> LazyPathChannel:
    """Make the channel of the first path of each vehicle in each period, with points a quarter of a second apart.

    Args:
        rate_hz: Rate of paths for each vehicle.
    """
    order = np.argsort(planned.log_time_ns, kind="stable")
    chosen = order[first_rows_of_each_vehicle_and_period(planned.ids.codes[order], planned.stamp_ns[order], rate_hz)]

    def build_fields_of_rows(start: int, stop: int) -> Mapping[str, OutputField]:
        own = chosen[start:stop]
        paths = planned.plan.paths_of_rows(own)
        return _predicted_path_fields(
            planned.ids.select_rows(own),
            planned.stamp_ns[own],
            planned.model,
            _round_paths_to_published_precision(paths.select_points(_published_point_indices(paths.time_s))),
        )

    return LazyPathChannel(
        channel.topic, channel.schema, planned.log_time_ns[chosen], make_rows=build_fields_of_rows, lazy_paths=planned
    )


def _published_point_indices(time_s: FloatArray) -> Rows:
    """Indices of every k-th point, as far apart as published points may be, with the last."""
    last = len(time_s) - 1
    every = max(
        (k for k in range(1, last + 1) if last % k == 0 and time_s[k] < MAX_PATH_POINT_INTERVAL_S + 1e-9), default=1
    )
    return np.arange(0, last + 1, every)


def _round_paths_to_published_precision(paths: Paths) -> Paths:
    return Paths(
        paths.time_s,
        round_to_binary_step(paths.x_m, LENGTH_FRACTION_BITS),
        round_to_binary_step(paths.y_m, LENGTH_FRACTION_BITS),
        round_to_binary_step(paths.heading_rad, ANGLE_FRACTION_BITS),
        round_to_binary_step(paths.speed_mps, LENGTH_FRACTION_BITS),
        round_plane_covariance(paths.position_covariance_m2, VARIANCE_BINARY_DIGITS),
    )


def _predicted_path_fields(ids: Strings, stamp_ns: Int64Array, model: str, paths: Paths) -> dict[str, Field]:
    n, time_s = len(stamp_ns), paths.time_s
    return {
        "stamp_ns": stamp_ns,
        "id": ids,
        "model": repeat_string(model, n),
        "horizon_s": np.full(n, float(time_s[-1])),
        "step_s": np.full(n, float(time_s[1] - time_s[0]) if len(time_s) > 1 else 0.0),
        "x_m": paths.x_m,
        "y_m": paths.y_m,
        "heading_rad": paths.heading_rad,
        "speed_mps": paths.speed_mps,
        "position_covariance": paths.position_covariance_m2.reshape(n, 3 * len(time_s)),
    }


def read_predicted_paths(columns: Columns) -> PredictedPaths:
    """Read the paths of a channel, in log-time order.

    Raises:
        DataError: A field is missing, or the paths differ in step or length: another version wrote them.
    """
    n = len(columns)
    x_m = read_matrix(columns, "x_m", required=True)
    k = x_m.shape[1]
    step_s = read_numbers(columns, "step_s", required=True, takes_impossible_numbers=True)
    models = read_texts(columns, "model")
    if n and np.ptp(step_s) > MAX_PATH_STEP_DIFFERENCE_S:
        raise DataError("the predicted paths of one channel differ in their step", where=columns.topic)
    paths = Paths(
        time_s=np.arange(k, dtype=np.float64) * (float(step_s[0]) if n else 0.0),
        x_m=x_m,
        y_m=read_matrix(columns, "y_m", k, required=True),
        heading_rad=read_matrix(columns, "heading_rad", k, required=True),
        speed_mps=read_matrix(columns, "speed_mps", k, required=True),
        position_covariance_m2=read_matrix(columns, "position_covariance", 3 * k, required=True).reshape(n, k, 3),
    )
    return PredictedPaths(
        ids=read_texts(columns, "id", required=True),
        stamp_ns=read_integers(columns, "stamp_ns", required=True)[0],
        log_time_ns=columns.log_time_ns,
        model=models.values[0] if models is not None and models.values else "",
        paths=paths,
    )
