"""Converts an annotated log to a Rerun recording: Rerun's own import of the log, plus paths, speeds and views."""

from __future__ import annotations

from collections.abc import Container
from importlib.util import find_spec
from typing import Any

import numpy as np

from cwcli.channels.predicted_path import read_predicted_paths
from cwcli.channels.published import (
    EGO_FIX,
    EGO_PATH,
    EGO_POSE,
    EGO_STATE,
    REMOTE_PATH,
    REMOTE_STATE,
    WARNING_LOG,
)
from cwcli.channels.vehicle_state import KINEMATIC_FIELDS, read_vehicle_states
from cwcli.errors import MissingSignalError, UsageError, install_hint
from cwcli.logs.read.reader import Log
from cwcli.signals.row_order import iter_rows_by_id
from cwcli.signals.vehicle_state import MAP_FRAME

RERUN_TIMELINE = "message_log_time"
"""Rerun's name for the timeline of log times of MCAP messages."""

MAX_RERUN_TIME_NS = 2**63 - 1
"""The latest time that Rerun represents, in ns: its times are signed numbers of 64 bits, those of MCAP unsigned."""

VIEWER_EYE_HEIGHT_M = 150.0
"""Height of the viewer's eye above the ego, m; chosen by eye."""


def require_rerun() -> None:
    """Check that Rerun is installed.

    Raises:
        UsageError: The extra `view` is not installed.
    """
    if find_spec("rerun") is None:
        raise UsageError("the viewer needs rerun-sdk", hint=install_hint("view"))


def show_in_viewer(log: Log, path: str) -> None:
    """Open the Rerun viewer with an annotated log at `path`.

    Raises:
        MissingSignalError: The log holds no states.
    """
    topics_of_log = _require_states_and_get_topics(log)
    import rerun as rr

    recording = rr.RecordingStream("cwcli")
    recording.spawn(default_blueprint=_make_blueprint())
    _send_log(recording, log, path, topics_of_log)
    recording.flush()
    recording.disconnect()


def encode_recording(log: Log, path: str) -> bytes:
    """Encode a log as the content of an `.rrd` file.

    It is built in memory, because Rerun's own file writer waits forever when the disk is full.

    Args:
        path: Path of the log, which Rerun opens itself.

    Raises:
        MissingSignalError: The log holds no states.
    """
    topics_of_log = _require_states_and_get_topics(log)
    import rerun as rr

    # The id and the start are of the log, neither random nor of the clock: a recording made again holds the same.
    recording = rr.RecordingStream("cwcli", recording_id=log.begin_sha256().result(), send_properties=False)
    memory = recording.memory_recording()
    rr.set_log_time_enabled(False, recording)
    if log.start_ns <= MAX_RERUN_TIME_NS:
        rr.send_recording_start_time_nanos(log.start_ns, recording)
    recording.send_blueprint(_make_blueprint(), make_active=False)
    _send_log(recording, log, path, topics_of_log)
    return bytes(memory.drain_as_bytes())


def _require_states_and_get_topics(log: Log) -> set[str]:
    topics_of_log = {channel.topic for channel in log.channels}
    if not topics_of_log & {EGO_STATE.topic, REMOTE_STATE.topic}:
        raise MissingSignalError("the log holds no states", where=log.name, hint="run `cwcli run` first")
    return topics_of_log


def _send_log(recording: Any, log: Log, path: str, topics_of_log: Container[str]) -> None:
    """Send the log's file, speeds and paths to a recording."""
    import rerun as rr

    recording.log_file_from_path(path)
    # The frame of paths and poses: a view draws what a chain of transforms leads from to its own.
    recording.log("/", rr.CoordinateFrame(MAP_FRAME), static=True)
    recording.log(EGO_POSE.topic, rr.TransformAxes3D(5), static=True)
    for channel in (EGO_STATE, REMOTE_STATE):
        if channel.topic in topics_of_log:
            _send_speeds(recording, log, channel.topic)
    for channel in (EGO_PATH, REMOTE_PATH):
        if channel.topic in topics_of_log:
            _send_paths(recording, log, channel.topic)


def _make_blueprint() -> Any:
    import rerun.blueprint as rrb

    above = rrb.EyeControls3D(
        position=(0, 0, VIEWER_EYE_HEIGHT_M), look_target=(0, 0, 0), eye_up=(0, 1, 0), tracking_entity=EGO_POSE.topic
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin="/", contents=["/paths/**", EGO_POSE.topic], name="From above", eye_controls=above
            ),
            rrb.Vertical(
                rrb.MapView(origin=EGO_FIX.topic, name="The ego on the globe"),
                rrb.TimeSeriesView(origin="/speed", name="Speed [m/s]"),
                rrb.TextLogView(origin=WARNING_LOG.topic, name="Warnings"),
            ),
        )
    )


def _rerun_time_column(stamp_ns: Any) -> Any:
    import rerun as rr

    return rr.TimeColumn(RERUN_TIMELINE, timestamp=stamp_ns.astype("datetime64[ns]"))


def _send_speeds(recording: Any, log: Log, topic: str) -> None:
    import rerun as rr

    states = read_vehicle_states(log.columns(topic, KINEMATIC_FIELDS), with_covariance=False)
    for vehicle, rows in iter_rows_by_id(states.ids):
        speed = states.state[rows, 2]
        recording.send_columns(
            f"/speed/{vehicle}",
            [_rerun_time_column(states.log_time_ns[rows])],
            rr.Scalars.columns(scalars=speed),
        )


def _send_paths(recording: Any, log: Log, topic: str) -> None:
    import rerun as rr

    predicted = read_predicted_paths(log.columns(topic))
    for vehicle, rows in iter_rows_by_id(predicted.ids):
        x, y = predicted.paths.x_m[rows], predicted.paths.y_m[rows]
        strips = np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.float32)
        frames = rr.CoordinateFrame.columns(frame=[MAP_FRAME] * len(rows))
        columns = [*rr.LineStrips3D.columns(strips=list(strips)), *frames]
        recording.send_columns(f"/paths/{vehicle}", [_rerun_time_column(predicted.log_time_ns[rows])], columns)
