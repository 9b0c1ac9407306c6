"""The published state and path channels, back as arrays: what `predict` and `warn` start from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.errors import DataError, MissingSignalError
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import Columns, FloatArray, Int64Array, Ragged, Strings
from cwcli.signals.vehicle_state import STATE_NAMES

N_STATES = len(STATE_NAMES)
MAX_SPREAD_S = 1e-6  # step and horizon of one channel's paths may differ by rounding only


@dataclass(frozen=True)
class VehicleStates:
    """Rows of a `cwcli.v1.VehicleState` channel, in log-time order.

    Attributes:
        ids: Vehicle id, n rows.
        stamp_ns, log_time_ns: Shape (n,).
        state: Shape (n, 8), order `STATE_NAMES`.
        covariance: Shape (n, 8, 8).
        length_m, width_m: Shape (n,), NaN where unknown.
    """

    ids: Strings
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    state: FloatArray
    covariance: FloatArray
    length_m: FloatArray
    width_m: FloatArray

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def rows(self, rows: npt.NDArray[np.intp]) -> VehicleStates:
        """The given rows, in the given order."""
        return VehicleStates(
            Strings(self.ids.codes[rows], self.ids.values),
            self.stamp_ns[rows],
            self.log_time_ns[rows],
            self.state[rows],
            self.covariance[rows],
            self.length_m[rows],
            self.width_m[rows],
        )

    def logged_within(self, start_ns: int | None, end_ns: int | None) -> VehicleStates:
        """The states whose log time is in [start_ns, end_ns)."""
        if start_ns is None and end_ns is None:
            return self
        keep = np.ones(len(self), dtype=bool)
        if start_ns is not None:
            keep &= self.log_time_ns >= start_ns
        if end_ns is not None:
            keep &= self.log_time_ns < end_ns
        return self.rows(np.flatnonzero(keep))


def require_ego(states: VehicleStates, *, log_name: str, topic: str) -> None:
    """Check that there is a state of the ego in the part of the log that was asked for.

    Raises:
        MissingSignalError: There is none.
    """
    if not len(states):
        raise MissingSignalError(
            "no state of the ego is in the log, or none between --start and --end", where=f"{log_name}: {topic}"
        )


@dataclass(frozen=True)
class PredictedPaths:
    """Rows of a `cwcli.v1.PredictedPath` channel: `paths` has one row a message."""

    ids: Strings
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    model: str
    paths: Paths

    def __len__(self) -> int:
        return len(self.stamp_ns)


def vehicle_rows(ids: Strings) -> Iterator[tuple[str, npt.NDArray[np.intp]]]:
    """Each vehicle's id and the indices of its rows, in order of id first seen."""
    if not len(ids):
        return
    order = np.argsort(ids.codes, kind="stable")
    codes, starts = np.unique(ids.codes[order], return_index=True)
    for code, rows in zip(codes, np.split(order, starts[1:]), strict=True):
        yield ids.values[code], rows


def rows_by_stamp(stamp_ns: Int64Array, rows: npt.NDArray[np.intp] | None = None) -> npt.NDArray[np.intp]:
    """Rows, or those of `rows`, in the order of their stamps, the first of each stamp."""
    chosen = np.arange(len(stamp_ns)) if rows is None else rows
    ordered = chosen[np.argsort(stamp_ns[chosen], kind="stable")]
    return ordered[np.concatenate(([True], np.diff(stamp_ns[ordered]) > 0))] if len(ordered) else ordered


def read_states(columns: Columns) -> VehicleStates:
    """Take the columns of a state channel as arrays.

    Raises:
        DataError: A field is missing or the covariance has not 64 values a row: another version wrote it.
    """
    n = len(columns)
    state = np.column_stack([_numbers(columns, name) for name in STATE_NAMES])
    return VehicleStates(
        ids=_ids(columns),
        stamp_ns=_stamps(columns),
        log_time_ns=columns.log_time_ns,
        state=state,
        covariance=_matrix(columns, "covariance", N_STATES**2).reshape(n, N_STATES, N_STATES),
        length_m=_numbers(columns, "length_m"),
        width_m=_numbers(columns, "width_m"),
    )


def read_paths(columns: Columns) -> PredictedPaths:
    """Take the columns of a path channel as arrays.

    Raises:
        DataError: The paths of the channel differ in step, length or model.
    """
    n = len(columns)
    x_m = _matrix(columns, "x_m")
    k = x_m.shape[1]
    step_s = _numbers(columns, "step_s")
    models = columns.fields.get("model")
    model = models.values[0] if isinstance(models, Strings) and models.values else ""
    if n and np.ptp(step_s) > MAX_SPREAD_S:
        raise DataError("the predicted paths of one channel differ in their step", where=columns.topic)
    paths = Paths(
        time_s=np.arange(k, dtype=np.float64) * (float(step_s[0]) if n else 0.0),
        x_m=x_m,
        y_m=_matrix(columns, "y_m", k),
        heading_rad=_matrix(columns, "heading_rad", k),
        speed_mps=_matrix(columns, "speed_mps", k),
        position_covariance_m2=_matrix(columns, "position_covariance", 3 * k).reshape(n, k, 3),
    )
    return PredictedPaths(_ids(columns), _stamps(columns), columns.log_time_ns, model, paths)


def _ids(columns: Columns) -> Strings:
    ids = columns.fields.get("id")
    if not isinstance(ids, Strings):
        raise _broken(columns, "id")
    return ids


def _stamps(columns: Columns) -> Int64Array:
    return np.asarray(_array(columns, "stamp_ns"), dtype=np.int64)


def _numbers(columns: Columns, name: str) -> FloatArray:
    return np.asarray(_array(columns, name), dtype=np.float64)


def _array(columns: Columns, name: str) -> npt.NDArray[np.generic]:
    values = columns.fields.get(name)
    if not isinstance(values, np.ndarray):
        raise _broken(columns, name)
    return values


def _matrix(columns: Columns, name: str, width: int | None = None) -> FloatArray:
    """A repeated field with the same number of values in every row, shape (n, width)."""
    values = columns.fields.get(name)
    n = len(columns)
    if isinstance(values, Ragged):
        sizes = np.diff(values.offsets)
        if n and (sizes != sizes[0]).any():
            raise _broken(columns, name)
        matrix = np.asarray(values.values, dtype=np.float64).reshape(n, -1) if n else np.empty((0, width or 0))
    elif isinstance(values, np.ndarray) and values.ndim == 2:
        matrix = np.asarray(values, dtype=np.float64)
    else:
        raise _broken(columns, name)
    if width is not None and matrix.shape[1] != width:
        raise _broken(columns, name)
    return matrix


def _broken(columns: Columns, name: str) -> DataError:
    return DataError(
        f"the channel has no usable field `{name}`",
        where=columns.topic,
        hint="write it again with this version of cwcli (`--replace`)",
    )
