"""`cwcli.v1.PredictedPath`: where the ego and the other vehicles are going to be."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cwcli.channels.output import output
from cwcli.channels.published import Channel
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.errors import DataError
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import Columns, Field, Int64Array, NumericArray, OutputChannel, Strings, constant_strings
from cwcli.signals.leaf_fields import matrix, numbers, texts, whole_numbers
from cwcli.signals.units import NS_PER_S

MAX_SPREAD_S = 1e-6
"""Step and horizon of one channel's paths may differ by rounding only."""


@dataclass(frozen=True)
class PredictedPaths:
    """Paths of vehicles, n rows.

    Attributes:
        ids: Vehicle id.
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
    def of(cls, states: VehicleStates, model: str, paths: Paths) -> PredictedPaths:
        """Paths that start from states, one from each."""
        return cls(states.ids, states.stamp_ns, states.log_time_ns, model, paths)

    def __len__(self) -> int:
        return len(self.stamp_ns)


def write_paths(
    channel: Channel, predicted: PredictedPaths, *, frame_id: str = "", rate_hz: float | None = None
) -> OutputChannel:
    """One message a path.

    Args:
        channel: Where they are published.
        predicted: The paths.
        frame_id: "" for `map`.
        rate_hz: A file gets so many of each vehicle at most; None: all. Later stages of the same run see all.
    """
    n, paths = len(predicted), predicted.paths
    fields: dict[str, Field] = {
        "stamp_ns": predicted.stamp_ns,
        "id": predicted.ids,
        "model": constant_strings(predicted.model, n),
        "horizon_s": np.full(n, float(paths.time_s[-1])),
        "step_s": np.full(n, float(paths.time_s[1] - paths.time_s[0]) if len(paths.time_s) > 1 else 0.0),
        "x_m": paths.x_m,
        "y_m": paths.y_m,
        "heading_rad": paths.heading_rad,
        "speed_mps": paths.speed_mps,
        "position_covariance": paths.position_covariance_m2.reshape(n, 3 * len(paths.time_s)),
    }
    if frame_id:
        fields["frame_id"] = constant_strings(frame_id, n)
    made = output(channel, predicted.log_time_ns, fields)
    if rate_hz is None:
        return made
    ids, stamp_ns = made.fields["id"], made.fields["stamp_ns"]
    assert isinstance(ids, Strings) and isinstance(stamp_ns, np.ndarray)
    return replace(made, written=first_of_each_period(ids.codes, stamp_ns.astype(np.int64), rate_hz))


def first_of_each_period(codes: NumericArray, stamp_ns: Int64Array, rate_hz: float) -> Int64Array:
    """The first row of each vehicle in each period of a clock that ticks at a rate; increasing.

    Args:
        codes, stamp_ns: Shape (n,): vehicle and time of each row.
        rate_hz: Of the clock, whose first tick is at time 0.
    """
    period_ns = max(round(NS_PER_S / rate_hz), 1)
    pairs = np.stack([codes.astype(np.int64), stamp_ns // period_ns], axis=1)
    return np.sort(np.unique(pairs, axis=0, return_index=True)[1]).astype(np.int64)


def read_paths(columns: Columns) -> PredictedPaths:
    """The paths of a channel, in log-time order.

    Raises:
        DataError: A field is missing, or the paths differ in step or length: another version wrote them.
    """
    n = len(columns)
    x_m = matrix(columns, "x_m", required=True)
    k = x_m.shape[1]
    step_s = numbers(columns, "step_s", required=True)
    models = texts(columns, "model")
    if n and np.ptp(step_s) > MAX_SPREAD_S:
        raise DataError("the predicted paths of one channel differ in their step", where=columns.topic)
    paths = Paths(
        time_s=np.arange(k, dtype=np.float64) * (float(step_s[0]) if n else 0.0),
        x_m=x_m,
        y_m=matrix(columns, "y_m", k, required=True),
        heading_rad=matrix(columns, "heading_rad", k, required=True),
        speed_mps=matrix(columns, "speed_mps", k, required=True),
        position_covariance_m2=matrix(columns, "position_covariance", 3 * k, required=True).reshape(n, k, 3),
    )
    return PredictedPaths(
        ids=texts(columns, "id", required=True),
        stamp_ns=whole_numbers(columns, "stamp_ns", required=True)[0],
        log_time_ns=columns.log_time_ns,
        model=models.values[0] if models is not None and models.values else "",
        paths=paths,
    )
