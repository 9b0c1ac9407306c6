"""Vehicles that change their ids among others: what was sent, and who is who."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.columns import encode_strings
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.stitch import join_changed_station_ids

T0_NS = 1_600_000_000_000_000_000
HERE = LocalMap(50.0, 8.0, 100.0)
N_CARS, RATE_HZ, SPAN_S = 11, 10.0, 12.0
POSITION_SIGMA_M, SPEED_SIGMA_MPS, HEADING_SIGMA_RAD, ACCEL_SIGMA_MPS2 = 0.7, 0.15, np.deg2rad(0.7), 0.15


@dataclass(frozen=True)
class Scene:
    """Messages of some cars, and which of their ids are of one car, in order."""

    signal: RemoteSignal
    ids: list[list[str]]


def scene(rng: np.random.Generator, n_cars: int = N_CARS) -> Scene:
    """Cars on three lanes, 12 to 40 m apart, each braking, accelerating and swinging on its own, all of one size.

    The first one changes its id, with a pause of 0.1 to 2 s; each of the others does with a probability of 0.3.
    """
    at_s = np.arange(0.0, SPAN_S, 1.0 / RATE_HZ)
    rows: list[dict[str, float]] = []
    names: list[str] = []
    ids: list[list[str]] = []
    base_mps = rng.uniform(10.0, 30.0)
    along_m = np.cumsum(rng.uniform(12.0, 40.0, n_cars))
    for car in range(n_cars):
        speed = base_mps + rng.normal(0.0, 1.0) + rng.uniform(0.0, 1.5) * np.sin(0.5 * at_s + rng.uniform(0.0, 6.0))
        sideways = rng.uniform(0.0, 0.3) * np.sin(0.4 * at_s + rng.uniform(0.0, 6.0))
        x = along_m[car] + np.cumsum(speed) / RATE_HZ
        y = 3.5 * rng.integers(3) + sideways
        heading = np.gradient(sideways, at_s) / speed
        sent = np.ones(len(at_s), np.bool_)
        own = [f"{rng.integers(1 << 32):08x}"]
        change = np.full(len(at_s), 0)
        if car == 0 or rng.random() < 0.3:
            start_s, pause_s = rng.uniform(4.0, 7.0), rng.uniform(0.1, 2.0)
            sent &= (at_s < start_s) | (at_s >= start_s + pause_s)
            change[at_s >= start_s] = 1
            own.append(f"{rng.integers(1 << 32):08x}")
        ids.append(own)
        noise = rng.normal(size=(5, len(at_s)))
        accel = np.gradient(speed, at_s)
        for k in np.flatnonzero(sent):
            names.append(own[change[k]])
            rows.append(
                {
                    "t": at_s[k] + 0.003 * car,
                    "x": x[k] + POSITION_SIGMA_M * noise[0, k],
                    "y": y[k] + POSITION_SIGMA_M * noise[1, k],
                    "speed": speed[k] + SPEED_SIGMA_MPS * noise[2, k],
                    "heading": heading[k] + HEADING_SIGMA_RAD * noise[3, k],
                    "accel": accel[k] + ACCEL_SIGMA_MPS2 * noise[4, k],
                }
            )
    order = np.argsort([row["t"] for row in rows], kind="stable")
    columns = {name: np.array([rows[k][name] for k in order]) for name in rows[0]}
    n = len(order)
    latitude, longitude, altitude = HERE.wgs84_from_map(columns["x"], columns["y"], np.zeros(n))
    stamp_ns = T0_NS + np.round(columns["t"] * 1e9).astype(np.int64)
    nothing = np.full(n, np.nan)
    signal = RemoteSignal(
        source="/v2x",
        station=encode_strings([names[k] for k in order]),
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns + 30_000_000,
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_m=altitude,
        speed_mps=columns["speed"],
        heading_rad=columns["heading"],
        accel_mps2=columns["accel"],
        lateral_accel_mps2=nothing,
        yaw_rate_radps=nothing,
        length_m=np.full(n, 4.5),
        width_m=np.full(n, 1.8),
        position_covariance_m2=np.tile([POSITION_SIGMA_M**2, 0.0, POSITION_SIGMA_M**2], (n, 1)),
        speed_sigma_mps=nothing,
        heading_sigma_rad=nothing,
        accel_sigma_mps2=nothing,
        yaw_rate_sigma_radps=nothing,
        message_count=nothing,
    )
    return Scene(signal, ids)


def score(n_scenes: int, seed: int) -> tuple[int, int, int]:
    """Changes, those that were found, and pairs of two cars that were taken for one."""
    rng = np.random.default_rng(seed)
    n_changes = n_right = n_wrong = 0
    for _ in range(n_scenes):
        made = scene(rng)
        true = {tuple(ids) for ids in made.ids if len(ids) == 2}
        found = set(join_changed_station_ids(made.signal, HERE).joined)
        n_changes += len(true)
        n_right += len(true & found)
        n_wrong += len(found - true)
    return n_changes, n_right, n_wrong
