"""The table of the observed lateral motion."""

from __future__ import annotations

import numpy as np

from cwcli.dynamics.samples import STATE_NAMES, FrameStatus, LateralTrack
from cwcli.metrics.table import ColumnDoc, Table, TableColumn

LATERAL_SIGMA_NAMES = (
    "lateral_speed_sigma_mps",
    "yaw_rate_sigma_radps",
    "lateral_deviation_sigma_m",
    "heading_deviation_sigma_rad",
)
"""Names of the columns with the standard errors of the four states, in the states' order."""


def observer_table(track: LateralTrack) -> Table:
    """The table `observer`: one row per frame with the state, its sigmas and the inputs."""
    variance = np.diagonal(track.covariance, axis1=1, axis2=2)
    sigma = np.sqrt(np.where(variance >= 0.0, variance, np.nan))
    columns: dict[str, TableColumn] = {
        "stamp_ns": track.stamp_ns,
        "status": [FrameStatus(code).name.lower() for code in track.status.tolist()],
        "speed_mps": track.speed_mps,
    }
    for k, (name, sigma_name) in enumerate(zip(STATE_NAMES, LATERAL_SIGMA_NAMES, strict=True)):
        columns[name] = track.state[:, k]
        columns[sigma_name] = sigma[:, k]
    columns |= {
        "steer_rad": track.steer_rad,
        "curvature_1pm": track.curvature_1pm,
        "mass_kg": track.mass_kg,
        "mass_sigma_kg": track.mass_sigma_kg,
    }
    docs = {
        "status": ColumnDoc(doc="how the state was computed, or why it is missing; see cwcli.v1.LateralState"),
        "lateral_speed_mps": ColumnDoc(frame="body", doc="at the centre of gravity, left positive"),
        "yaw_rate_radps": ColumnDoc(doc="counter-clockwise positive"),
        "lateral_deviation_m": ColumnDoc(doc="offset of the lane's centre at the preview point, right positive (y_L)"),
        "heading_deviation_rad": ColumnDoc(doc="angle of the car to the lane there, counter-clockwise positive (e_L)"),
        "steer_rad": ColumnDoc(doc="angle of the front wheels, left positive"),
        "curvature_1pm": ColumnDoc(doc="curvature of the road at the preview point, right bend positive (K_L)"),
        "mass_kg": ColumnDoc(doc="estimated mass, or the assumed one"),
        "mass_sigma_kg": ColumnDoc(doc="NaN: the mass is assumed"),
    }
    return Table("observer", columns, docs)
