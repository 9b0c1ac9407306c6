"""The tables and the summary of the stage `observe`."""

from __future__ import annotations

import numpy as np

from cwcli.channels.lateral_state import STATE_NAMES, read_lateral_truth
from cwcli.dynamics.samples import FrameStatus, LateralTrack
from cwcli.metrics.table import ColumnDoc, Table, TableColumn
from cwcli.pipeline.result import Cell, Section
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.resample import resample
from cwcli.stages.inputs.lateral_sensors import Inputs

MAX_GAP_S = 0.5
SETTLED_S = 2.0
"""Errors count from here on after each start of the observer."""
Z_90 = 1.6448536269514722

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


def truth_errors(track: LateralTrack, truth: Columns) -> Table:
    """Observed minus true of each state, over the frames that are settled; one row a state."""
    true_ns, true_state = read_lateral_truth(truth)
    settled = _is_settled(track)
    rows: list[tuple[str, int, float, float, float, float, float]] = []
    for k, name in enumerate(STATE_NAMES):
        true = resample(true_ns, true_state[:, k], track.stamp_ns, max_gap_s=MAX_GAP_S)
        error = track.state[:, k] - true
        known = np.isfinite(error) & settled
        rows.append((name, *_scores(error[known], np.sqrt(np.abs(track.covariance[known, k, k])))))
    names, n, rms, bias, p95, largest, inside = zip(*rows, strict=True)
    columns: dict[str, TableColumn] = {
        "state": list(names),
        "n": np.array(n, dtype=np.int64),
        "rms": np.array(rms),
        "bias": np.array(bias),
        "p95": np.array(p95),
        "max": np.array(largest),
        "inside_90": np.array(inside),
    }
    docs = {
        "n": ColumnDoc(doc=f"frames with a state and a truth, from {SETTLED_S:g} s after each start of the observer"),
        "rms": ColumnDoc(doc="of observed minus true, in the unit of the state; likewise bias, p95, max"),
        "inside_90": ColumnDoc(doc="share of the errors within 1.645 of the observer's sigmas"),
    }
    return Table("observer_errors", columns, docs)


def observer_section(track: LateralTrack, inputs: Inputs) -> Section:
    """How many frames have a state, and what the states are like."""
    n = len(track)
    rows: list[tuple[Cell, ...]] = [("frames", n)]
    rows += [(f"frames {name.replace('_', ' ')}", count) for name, count in track.counts.items() if count]
    rows += [
        ("speed from", inputs.speed_source),
        ("yaw rate from", inputs.yaw_rate_source or "-"),
        ("steering angle from", inputs.steer_source or "the lanes"),
        ("largest yaw rate (deg/s)", _largest(np.degrees(track.state[:, 1]))),
        ("largest lateral speed (m/s)", _largest(track.state[:, 0])),
        ("sigma of the yaw rate, median (deg/s)", _median(np.degrees(np.sqrt(np.abs(track.covariance[:, 1, 1]))))),
        ("sigma of the lateral speed, median (m/s)", _median(np.sqrt(np.abs(track.covariance[:, 0, 0])))),
    ]
    known = np.flatnonzero(np.isfinite(track.mass_sigma_kg))
    if len(known):
        last = known[-1]
        rows.append(("mass at the end (kg)", float(track.mass_kg[last])))
        rows.append(("its sigma (kg)", float(track.mass_sigma_kg[last])))
    return Section("observer", "Lateral motion", ("quantity", "value"), tuple(rows))


def truth_section(errors: Table, topic: str) -> Section:
    """The errors against a truth channel."""
    rows = tuple(
        (str(row["state"]), row["n"], row["rms"], row["bias"], row["p95"], row["max"], 100.0 * row["inside_90"])
        for row in errors.records()
    )
    columns = ("state", "frames", "rms", "bias", "p95", "max", "in 90 % band [%]")
    return Section("observer_errors", f"Errors against {topic}", columns, rows)


def _is_settled(track: LateralTrack) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Where the observer began at least `SETTLED_S` before, shape (n,)."""
    began = np.where(track.status == FrameStatus.STARTED, track.stamp_ns, np.iinfo(np.int64).min)
    began = np.maximum.accumulate(began) if len(began) else began
    has_begun = began > np.iinfo(np.int64).min
    age_ns = np.where(has_begun, track.stamp_ns - np.where(has_begun, began, 0), -1)
    return np.asarray(age_ns >= SETTLED_S * 1e9, dtype=np.bool_)


def _scores(error: FloatArray, sigma: FloatArray) -> tuple[int, float, float, float, float, float]:
    if not len(error):
        nan = float("nan")
        return 0, nan, nan, nan, nan, nan
    size = np.abs(error)
    inside = float(np.mean(size <= Z_90 * sigma)) if np.isfinite(sigma).all() else float("nan")
    rms = float(np.sqrt(np.mean(error**2)))
    return len(error), rms, float(error.mean()), float(np.percentile(size, 95)), float(size.max()), inside


def _largest(values: FloatArray) -> float | None:
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max()) if len(finite) else None


def _median(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None
