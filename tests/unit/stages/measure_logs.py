"""Logs of states alone: the ego and cars around it, on straight ways or a ring road."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cwcli.channels.published import EGO_STATE, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Strings
from cwcli.signals.vehicle_state import N_STATES
from tests.unit.evaluation.small_logs import T0_NS, log_of

SIGMA = np.array([0.1, 0.1, 0.05, 0.005, 0.1, 0.01, 0.1, 0.1])
COVARIANCE = np.diag(SIGMA**2)


def states(
    ids: list[str], tracks: list[np.ndarray], time_s: np.ndarray, size_m: tuple[float, float] = (4.5, 1.8)
) -> VehicleStates:
    """Of several vehicles at the same times; a track is (n, 8)."""
    n = len(time_s)
    stamp_ns = np.tile(T0_NS + np.round(time_s * 1e9).astype(np.int64), len(ids))
    order = np.argsort(stamp_ns, kind="stable")
    made = VehicleStates(
        ids=Strings(np.repeat(np.arange(len(ids), dtype=np.int32), n), tuple(ids)),
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns,
        state=np.concatenate(tracks),
        covariance=np.broadcast_to(COVARIANCE, (n * len(ids), N_STATES, N_STATES)),
        length_m=np.full(n * len(ids), size_m[0]),
        width_m=np.full(n * len(ids), size_m[1]),
        flags=np.zeros(n * len(ids), np.uint8),
    )
    return made.select_rows(order)


def straight(x_m: float, y_m: float, speed_mps: float, heading_rad: float, time_s: np.ndarray) -> np.ndarray:
    """A track at constant velocity, (n, 8)."""
    way = speed_mps * time_s
    track = np.zeros((len(time_s), N_STATES))
    track[:, 0], track[:, 1] = x_m + way * np.cos(heading_rad), y_m + way * np.sin(heading_rad)
    track[:, 2], track[:, 3] = speed_mps, heading_rad
    return track


def ring(n_cars: int, time_s: np.ndarray, seed: int = 0) -> list[np.ndarray]:
    """Cars on three lanes of a ring road of 150 m radius, each at its own speed."""
    rng = np.random.default_rng(seed)
    tracks = []
    for k in range(n_cars):
        radius, speed = 150.0 + 4.0 * (k % 3), rng.uniform(7.0, 13.0)
        angle = rng.uniform(-np.pi, np.pi) + speed / radius * time_s
        track = np.zeros((len(time_s), N_STATES))
        track[:, 0], track[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
        track[:, 2], track[:, 3] = speed, angle + np.pi / 2.0
        track[:, 5] = speed / radius
        tracks.append(track)
    return tracks


def state_log(path: Path, ego: VehicleStates, others: VehicleStates | None) -> Log:
    """A log with these states in memory."""
    channels = [make_vehicle_state_channel(EGO_STATE, ego, None)]
    if others is not None:
        channels.append(make_vehicle_state_channel(REMOTE_STATE, others, None))
    return log_of(path, channels)


def without_sizes(made: VehicleStates) -> VehicleStates:
    """The states of vehicles that do not tell their size."""
    unknown = np.full(len(made), np.nan)
    return replace(made, length_m=unknown, width_m=unknown)
