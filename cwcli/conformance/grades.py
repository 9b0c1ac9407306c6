"""Grades of noise: the host's sensors and the V2X link of every trial that is simulated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Settings = Mapping[str, Mapping[str, Any]]
"""Table of a scenario -> its keys: `gnss`, `gnss_heading`, `speed`, `imu` and `v2x`."""

SCENARIO_OVERRIDES_BY_GRADE: Mapping[str, Settings] = {
    "nominal": {
        "gnss": {"rate_hz": 10},
        "gnss_heading": {"rate_hz": 10},
        "speed": {"rate_hz": 20, "sigma_mps": 0.1},
        "imu": {"rate_hz": 50},
        "v2x": {"rate_hz": 10, "delay_s": 0.05, "jitter_s": 0.02, "drop_probability": 0.05},
    },
    "fine": {
        "gnss": {"rate_hz": 20, "sigma_m": 0.05},
        "gnss_heading": {"rate_hz": 20, "sigma_deg": 0.1},
        "speed": {"rate_hz": 50, "sigma_mps": 0.02},
        "imu": {"rate_hz": 100, "accel_sigma_mps2": 0.02, "yaw_rate_sigma_dps": 0.05},
        "v2x": {
            "rate_hz": 20,
            "position_sigma_m": 0.05,
            "speed_sigma_mps": 0.02,
            "heading_sigma_deg": 0.1,
            "accel_sigma_mps2": 0.01,
        },
    },
    "j2945": {
        "gnss": {"rate_hz": 10},
        "gnss_heading": {"rate_hz": 10},
        "speed": {"rate_hz": 20, "sigma_mps": 0.1},
        "imu": {"rate_hz": 50},
        "v2x": {"rate_hz": 10, "delay_s": 0.05, "jitter_s": 0.02, "drop_probability": 0.05, "sender": "j2945"},
    },
}
"""Grade -> what differs from the defaults of a scenario (docs/scenarios.md). `nominal` is that of the bundled traps: a
single-frequency receiver, wheel speeds, a MEMS IMU, 10 messages a second of which 5 % are lost. `fine` is a survey
receiver on both vehicles. `j2945` is nominal with senders that filter their acceleration."""

RADAR_OF_EVERY_GRADE: Mapping[str, Any] = {"rate_hz": 20, "fov_deg": 60, "max_range_m": 160}
"""The host's radar in every grade, for scenes that need one: the rate, view and range of a usual long-range radar,
chosen by hand, with the noise of a scenario's radar."""
