"""The check of a builder's result: a signal of its role, consistent columns, and a count of every message."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from cwcli.registry import import_module_attribute
from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.path import PathSignal
from cwcli.signals.canonical import CameraInfoSignal, DetectionSignal, Signal
from cwcli.signals.columns import Columns, Strings
from cwcli.signals.quality import Quality
from cwcli.signals.role import Role

SIGNAL_TYPES_BY_ROLE: dict[Role, tuple[type[Signal], ...]] = {
    role: tuple(import_module_attribute(f"cwcli.signals.{place}") for place in role.signals)
    for role in Role
    if role.signals
}
"""The signal classes that can fill a role."""


def check_builder_result(built: object, columns: Columns, reading: Reading) -> tuple[Signal, Quality]:
    """Check a builder's result against its channel, and return it.

    Raises:
        TypeError: It is no signal of the role with its `Quality`.
        ValueError: Columns of different lengths, stamps that do not increase, or messages that are not accounted for.
    """
    if not (isinstance(built, tuple) and len(built) == 2 and isinstance(built[1], Quality)):
        raise TypeError("it is no (signal, Quality)")
    signal, quality = built
    kinds = SIGNAL_TYPES_BY_ROLE.get(reading.role, ())
    if not isinstance(signal, kinds):
        names = " or ".join(kind.__name__ for kind in kinds)
        raise TypeError(f"{type(signal).__name__} for {reading.role}, not {names or 'a role of its own'}")
    n_read = len(columns) + columns.n_undecodable
    n_known = quality.used + sum(quality.rejected.values()) + sum(quality.set_aside.values())
    if not quality.read == n_read == n_known:
        raise ValueError(f"{n_read} messages, {quality.read} of them read, {n_known} used, rejected or set aside")
    if not isinstance(signal, CameraInfoSignal):
        _check_signal_rows(signal, quality)
    return signal, quality


def _check_signal_rows(signal: object, quality: Quality) -> None:
    stamp_ns = getattr(signal, "stamp_ns")  # noqa: B009 - each signal but the camera's has stamps
    n = len(stamp_ns)
    if stamp_ns.dtype != np.int64 or (np.diff(stamp_ns) < 0).any():
        raise ValueError("stamps that are no int64, or not in order")
    n_rows: dict[str, int] = {}
    if isinstance(signal, PathSignal):
        n_rows = dict.fromkeys(("time_s", "x_m", "y_m", "speed_mps"), int(signal.offsets[-1])) | {"offsets": n + 1}
    elif isinstance(signal, DetectionSignal):
        n_rows = {"offsets": n + 1, "values": int(signal.offsets[-1]), "covariance": int(signal.offsets[-1])}
    for field in fields(signal):  # type: ignore[arg-type]
        values = getattr(signal, field.name)
        if isinstance(values, (np.ndarray, Strings)) and len(values) != n_rows.get(field.name, n):
            raise ValueError(f"{field.name} has {len(values)} rows, not {n_rows.get(field.name, n)}")
