"""Build the tracker's inputs, detections and sensor models, from signals and the user's settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cwcli.errors import MissingSignalError, UsageError
from cwcli.signals.builders.motion import MAP_FRAME_IDS
from cwcli.signals.canonical import DetectionSignal
from cwcli.signals.columns import Int64Array, Strings, sort_distinct_values
from cwcli.signals.elements import offsets_and_indices_of_selected_sequences
from cwcli.tracking.convert import radar_values_and_covariances_from_cartesian
from cwcli.tracking.detections import DetectionKind, Detections, SensorModel
from cwcli.tracking.sensor_setting import SensorSetting


def detections_from_signal(signal: DetectionSignal, setting: SensorSetting) -> Detections:
    """Convert a signal to detections in the order of arrival."""
    arrival = np.argsort(signal.log_time_ns, kind="stable")
    offsets, rows = offsets_and_indices_of_selected_sequences(signal.offsets, arrival)
    counts = np.diff(offsets)
    values, covariance = signal.values[rows], signal.covariance[rows]
    if signal.kind == "radar_track":
        values, covariance = radar_values_and_covariances_from_cartesian(
            values[:, :2], values[:, 2:], covariance[:, :2, :2], covariance[:, 2:, 2:]
        )
    if setting.is_rate_towards and signal.kind != "position":
        values = values * np.array([1.0, 1.0, -1.0])
    return Detections(
        source=signal.source,
        kind=DetectionKind.POSITION if signal.kind == "position" else DetectionKind.RADAR,
        stamp_ns=np.repeat(signal.stamp_ns[arrival], counts),
        values=values,
        covariance=covariance,
        frame=Strings(np.repeat(signal.frame.codes[arrival], counts), signal.frame.values),
        scan_stamp_ns=sort_distinct_values(signal.stamp_ns),
    )


def build_sensor_models(
    signals: Sequence[DetectionSignal], settings: Mapping[str, SensorSetting]
) -> tuple[dict[str, SensorModel], list[str]]:
    """Build the model of each sensor, and notes on what was assumed.

    Raises:
        UsageError: A setting names a topic without detections, or a value does not fit the sensor.
    """
    unknown = [topic for topic in settings if topic not in {signal.source for signal in signals}]
    if unknown:
        raise UsageError(
            f"--sensor {unknown[0]}: no detections are read from this topic",
            hint=f"sensors: {', '.join(signal.source for signal in signals)}",
        )
    models, notes = {}, []
    for signal in signals:
        setting = settings.get(signal.source, SensorSetting())
        frame = setting.frame or _most_frequent_frame(signal.frame)
        carrier = setting.carrier or ("map" if frame in MAP_FRAME_IDS else "body")
        if carrier == "body" and not setting.has_user_mounting:
            notes.append(
                f"{signal.source}: its mounting is not given; it is assumed at the car's origin, looking forward "
                f"(--sensor {signal.source}:x=..,y=..,yaw_deg=..)"
            )
        models[signal.source] = _build_sensor_model(signal.source, setting, frame, carrier)
    return models, notes


def _build_sensor_model(source: str, setting: SensorSetting, frame: str, carrier: str) -> SensorModel:
    """Build the model of one sensor; a `UsageError` if a value does not fit."""
    given_values = {
        "x_m": setting.x_m,
        "y_m": setting.y_m,
        "yaw_rad": setting.yaw_rad,
        "max_range_m": setting.max_range_m,
        "field_of_view_rad": setting.field_of_view_rad,
        "detection_probability": setting.detection_probability,
    }
    numbers = {name: value for name, value in given_values.items() if value is not None}
    try:
        return SensorModel(
            axes=setting.axes,
            carrier="map" if carrier == "map" else "body",
            sigma=setting.sigma,
            frame_ids=(frame,) if frame else (),
            use_range_rate=setting.use_range_rate,
            **numbers,
        )
    except ValueError as error:
        raise UsageError(f"--sensor {source}: {error}") from None


def _most_frequent_frame(frame: Strings) -> str:
    """The frame id of most scans; "" if none has one."""
    named = frame.codes[frame.codes >= 0]
    if not len(named):
        return ""
    names, counts = np.unique([frame.values[code] for code in named.tolist()], return_counts=True)
    return str(names[np.argmax(counts)])


def require_common_frame_and_tell_if_map(models: Mapping[str, SensorModel], *, has_ego: bool, where: str) -> bool:
    """Require that all sensors share a frame, and return whether tracks will be in the map.

    Raises:
        MissingSignalError: Some sensors move with the car, others stand in the map, and the ego state is not known.
    """
    fixed = [source for source, model in models.items() if model.carrier == "map"]
    moving = [source for source, model in models.items() if model.carrier == "body"]
    if fixed and moving and not has_ego:
        raise MissingSignalError(
            f"{moving[0]} moves with the car and {fixed[0]} is fixed in the map: the ego state is missing",
            where=where,
            hint=f"run `cwcli estimate LOG -o estimated.mcap` first, or say --sensor {fixed[0]}:carrier=body",
        )
    return has_ego or not moving


def scan_stamps_and_knowable_times_ns(
    signals: Sequence[DetectionSignal], ego_ns: tuple[Int64Array, Int64Array] | None
) -> tuple[Int64Array, Int64Array]:
    """Increasing stamps of all scans, and the times (ns) at which the tracks there could have been known.

    Args:
        ego_ns: Increasing stamps, and log times, of the car's states; None without them.
    """
    stamp_ns, log_time_ns = scan_stamps_and_log_times_ns(signals)
    if ego_ns is not None:
        after = np.minimum(np.searchsorted(ego_ns[0], stamp_ns), len(ego_ns[0]) - 1)
        log_time_ns = np.maximum(log_time_ns, ego_ns[1][after])
    return stamp_ns, np.maximum.accumulate(log_time_ns)


def scan_stamps_and_log_times_ns(signals: Sequence[DetectionSignal]) -> tuple[Int64Array, Int64Array]:
    """Increasing stamps of all scans, and their log times."""
    stamp_ns = np.concatenate([signal.stamp_ns for signal in signals])
    log_time_ns = np.concatenate([signal.log_time_ns for signal in signals])
    order = np.lexsort((log_time_ns, stamp_ns))
    stamp_ns, log_time_ns = stamp_ns[order], log_time_ns[order]
    last = np.append(np.diff(stamp_ns) != 0, True)
    return stamp_ns[last], log_time_ns[last]
