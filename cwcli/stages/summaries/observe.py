"""The tables and the summary of the stage `observe`."""

from __future__ import annotations

import numpy as np

from cwcli.channels.lateral_state import STATE_NAMES
from cwcli.dynamics.samples import FrameStatus, LateralTrack
from cwcli.metrics.table import ColumnDoc, Table, TableColumn
from cwcli.pipeline.result import Cell, Section
from cwcli.stages.inputs.observer import Inputs
from cwcli.stages.summaries import largest, median

SIGMA_NAMES = (
    "lateral_speed_sigma_mps",
    "yaw_rate_sigma_radps",
    "lateral_deviation_sigma_m",
    "heading_deviation_sigma_rad",
)


def observer_table(track: LateralTrack) -> Table:
    """One row a frame."""
    variance = np.diagonal(track.covariance, axis1=1, axis2=2)
    sigma = np.sqrt(np.where(variance >= 0.0, variance, np.nan))
    columns: dict[str, TableColumn] = {
        "stamp_ns": track.stamp_ns,
        "status": [FrameStatus(code).name.lower() for code in track.status.tolist()],
        "speed_mps": track.speed_mps,
    }
    for k, (name, sigma_name) in enumerate(zip(STATE_NAMES, SIGMA_NAMES, strict=True)):
        columns[name] = track.state[:, k]
        columns[sigma_name] = sigma[:, k]
    columns |= {
        "steer_rad": track.steer_rad,
        "curvature_1pm": track.curvature_1pm,
        "mass_kg": track.mass_kg,
        "mass_sigma_kg": track.mass_sigma_kg,
    }
    docs = {
        "status": ColumnDoc(doc="what stands behind the state, see cwcli.v1.LateralState"),
        "lateral_speed_mps": ColumnDoc(frame="body", doc="at the centre of gravity, left positive"),
        "yaw_rate_radps": ColumnDoc(doc="counter-clockwise positive"),
        "lateral_deviation_m": ColumnDoc(doc="of the lane's centre at the preview point, right positive (y_L)"),
        "heading_deviation_rad": ColumnDoc(doc="of the car from the lane there, counter-clockwise positive (e_L)"),
        "steer_rad": ColumnDoc(doc="of the front wheels, left positive"),
        "curvature_1pm": ColumnDoc(doc="of the road at the preview point, right bend positive (K_L)"),
        "mass_kg": ColumnDoc(doc="estimated, or as assumed"),
        "mass_sigma_kg": ColumnDoc(doc="NaN: the mass is assumed"),
    }
    return Table("observer", columns, docs)


def observer_section(track: LateralTrack, inputs: Inputs) -> Section:
    """How many frames have a state, and what the states are like."""
    n = len(track)
    rows: list[tuple[Cell, ...]] = [("frames", n)]
    rows += [(f"frames {name.replace('_', ' ')}", count) for name, count in track.counts.items() if count]
    rows += [
        ("speed from", inputs.speed_source),
        ("yaw rate from", inputs.yaw_rate_source or "-"),
        ("steering angle from", inputs.steer_source or "the lanes"),
        ("largest yaw rate (deg/s)", largest(np.degrees(track.state[:, 1]))),
        ("largest lateral speed (m/s)", largest(track.state[:, 0])),
        ("sigma of the yaw rate, median (deg/s)", median(np.degrees(np.sqrt(np.abs(track.covariance[:, 1, 1]))))),
        ("sigma of the lateral speed, median (m/s)", median(np.sqrt(np.abs(track.covariance[:, 0, 0])))),
    ]
    known = np.flatnonzero(np.isfinite(track.mass_sigma_kg))
    if len(known):
        last = known[-1]
        rows.append(("mass at the end (kg)", float(track.mass_kg[last])))
        rows.append(("its sigma (kg)", float(track.mass_sigma_kg[last])))
    return Section("observer", "Lateral motion", ("quantity", "value"), tuple(rows))
