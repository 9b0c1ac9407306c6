"""Predicted paths at the moments of the warnings, read from the few chunks that hold them.

The path channels are by far the largest of an annotated log: loaded whole, twenty vehicles over ten minutes fill a
gigabyte. So only the chunks around each warning are read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cwcli.errors import InputError
from cwcli.logs.log import Log
from cwcli.logs.schemas import message_schema
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S

PATH_SCHEMA = "cwcli.v1.PredictedPath"


@dataclass(frozen=True)
class Path2D:
    """One predicted path in the map frame.

    Attributes:
        stamp_ns: Time of the state that it starts from.
        model: The motion model.
        time_s: Shape (k,), from 0.
        xy_m: Shape (k, 2).
        covariance_m2: Shape (k, 3): xx, xy, yy.
        heading_rad: Shape (k,).
    """

    stamp_ns: int
    model: str
    time_s: FloatArray
    xy_m: FloatArray
    covariance_m2: FloatArray
    heading_rad: FloatArray


def path_known_at(log: Log, topic: str, vehicle: str, at_ns: int, *, max_age_s: float) -> Path2D | None:
    """The newest path of a vehicle that had been logged at a time, or None.

    Args:
        log: The log.
        topic: Of the paths; without any where its schema is another one.
        vehicle: Its id.
        at_ns: Log time.
        max_age_s: How far back to look.

    Raises:
        InputError: The log is damaged there.
    """
    from google.protobuf.message import DecodeError
    from google.protobuf.message_factory import GetMessageClass

    schemas = {channel.schema_name for channel in log.channels if channel.topic == topic}
    if schemas != {PATH_SCHEMA}:
        return None
    message_class = GetMessageClass(message_schema(PATH_SCHEMA).descriptor)
    newest: Any = None
    try:
        for _, data in log.messages(topic, at_ns - round(max_age_s * NS_PER_S), at_ns):
            path: Any = message_class.FromString(bytes(data))
            if path.id == vehicle and (newest is None or path.stamp_ns >= newest.stamp_ns):
                newest = path
    except DecodeError as error:
        raise InputError(f"the predicted paths can't be read: {error}", where=f"{log.name}: {topic}") from error
    return None if newest is None else _arrays(newest)


def _arrays(path: Any) -> Path2D | None:
    xy = (
        np.column_stack([np.array(path.x_m, np.float64), np.array(path.y_m, np.float64)])
        if (len(path.x_m) == len(path.y_m))
        else np.empty((0, 2))
    )
    n = len(xy)
    if n < 2 or len(path.position_covariance) != 3 * n or len(path.heading_rad) != n or not np.isfinite(xy).all():
        return None
    return Path2D(
        stamp_ns=int(path.stamp_ns),
        model=str(path.model),
        time_s=np.arange(n, dtype=np.float64) * float(path.step_s),
        xy_m=xy,
        covariance_m2=np.array(path.position_covariance, np.float64).reshape(n, 3),
        heading_rad=np.array(path.heading_rad, np.float64),
    )
