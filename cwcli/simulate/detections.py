"""The detections of a simulated log: `cwcli.Detections` in JSON, one message a scan, with the noise that is in them."""

from __future__ import annotations

import json
from typing import Any

from cwcli.logs.encoders.schemas import schema_folder
from cwcli.signals.units import NS_PER_S
from cwcli.simulate.cdr import BODY_FRAME_ID
from cwcli.simulation.detectors import DetectionScans

DETECTIONS_SCHEMA_NAME = "cwcli.Detections"
"""Schema name of the messages."""
VALUE_DIGITS = 9
"""Digits behind the point, so that the last bits of a processor's sine can't change the bytes of a log."""
VALUE_NAMES = {"lidar": ("x_m", "y_m"), "radar": ("range_m", "azimuth_rad", "range_rate_mps")}
"""Sensor -> names of its values, as in schemas/detections.schema.json."""


def detections_schema() -> bytes:
    """Return the JSON schema of the messages, `schemas/detections.schema.json`."""
    return (schema_folder() / "detections.schema.json").read_bytes()


def encode_detections(scans: DetectionScans) -> list[bytes]:
    """Encode the scans of one sensor as messages."""
    names = VALUE_NAMES[scans.sensor]
    sigmas = [round(float(sigma), VALUE_DIGITS) for sigma in scans.sigma]
    if scans.sensor == "lidar":
        noise = {"covariance_xx_m2": sigmas[0] ** 2, "covariance_xy_m2": 0.0, "covariance_yy_m2": sigmas[1] ** 2}
    else:
        noise = dict(zip(("range_sigma_m", "azimuth_sigma_rad", "range_rate_sigma_mps"), sigmas, strict=True))
    rows = [
        {**dict(zip(names, (round(value, VALUE_DIGITS) for value in row), strict=True)), **noise}
        for row in scans.values.tolist()
    ]
    messages = []
    for stamp_ns, first, last in zip(
        scans.stamp_ns.tolist(), scans.first[:-1].tolist(), scans.first[1:].tolist(), strict=True
    ):
        sec, nsec = divmod(stamp_ns, NS_PER_S)
        document: dict[str, Any] = {
            "timestamp": {"sec": int(sec), "nsec": int(nsec)},
            "frame_id": BODY_FRAME_ID,
            "detections": rows[first:last],
        }
        messages.append(json.dumps(document).encode())
    return messages
