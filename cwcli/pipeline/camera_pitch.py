"""What a log's lanes say of the pitch at which its camera is mounted."""

from __future__ import annotations

import math

import numpy as np

from cwcli.channels.lanes import read_lanes
from cwcli.channels.published import LANES
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.pipeline.records import read_configuration, read_finite_number_or_nan, read_input_counts, read_run_records
from cwcli.signals.role import Role

MIN_FRAMES_TO_ESTIMATE_PITCH = 100
"""Smallest number of frames with both boundaries from which a pitch is estimated; chosen by hand."""
N_BOOTSTRAP_BLOCKS = 10
"""Number of consecutive parts of the log whose mean pitches give the sigma; chosen by hand."""
MIN_PITCH_SIGMA_RAD = 5e-4
"""Smallest sigma of the pitch that is reported [rad]: half a pixel of the horizon at a focal length of 1000 pixels, an
error that all frames share. Chosen by hand."""


@dataclass(frozen=True)
class CameraPitch:
    """The camera's mean pitch over the frames with both boundaries; the car body's own pitching averages out.

    Attributes:
        pitch_rad, sigma_rad: The pitch, nose down positive, and its sigma from the scatter over parts of the log.
    """

    topic: str
    pitch_rad: float
    sigma_rad: float


def estimate_camera_pitch(log: Log) -> CameraPitch | None:
    """Estimate the camera's pitch from the lanes that `cwcli lanes` found without knowing it.

    Returns None without lanes, with too few frames, or where the pitch was given, on which the search then depends.
    """
    record = read_run_records(log).get(LANES.stage, {})
    topic = next(
        (str(each.get("topic")) for each in read_input_counts(record) if each.get("role") == Role.CAMERA.value), ""
    )
    mounting = read_configuration(record).get("mounting")
    is_open = isinstance(mounting, dict) and read_finite_number_or_nan(mounting, "pitch_rad") == 0.0
    if not topic or not is_open or all(channel.topic != LANES.topic for channel in log.channels):
        return None
    lanes = read_lanes(log.columns(LANES.topic))
    pitch_rad = lanes.camera_pitch_rad[lanes.found.all(axis=1) & np.isfinite(lanes.camera_pitch_rad)]
    if len(pitch_rad) < MIN_FRAMES_TO_ESTIMATE_PITCH or not np.ptp(pitch_rad) > 0.0:
        return None
    means = [part.mean() for part in np.array_split(pitch_rad, N_BOOTSTRAP_BLOCKS)]
    scatter_rad = float(np.std(means, ddof=1)) / math.sqrt(N_BOOTSTRAP_BLOCKS)
    return CameraPitch(topic, float(pitch_rad.mean()), math.hypot(scatter_rad, MIN_PITCH_SIGMA_RAD))
