"""What the observers and their paths make of rendered lanes in tight bends: yaw rate, lateral speed, path at 2 s.

    python -m tests.studies.lane_motion                       # ramps and mountain bends, 4 drives of each
    python -m tests.studies.lane_motion --kinds plain change --seeds 4-9

Drives of `lane_drives`. The lane method is told the speed alone (`--with-yaw-rate`: the yaw rate too). A row a drive
and way, from 2 s on: the default observer from camera and speed, the same with a gyroscope, and zhang2011's observer;
each with its own path model, and the default observer with zhang2011's as well.
"""

from __future__ import annotations

import argparse

import numpy as np

from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.dynamics.samples import LateralTrack
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.prediction.lateral import LateralPathConfig, predict_paths_from_observer
from cwcli.reproduction.zhang2011.rendered import lane_samples_from_geometry
from cwcli.simulation.road.car import BEARING, LATERAL_SPEED, YAW_RATE, X, Y
from tests.studies.lane_drives import KINDS, RATE_HZ, Seen, planned, watched

SETTLED, AHEAD = 20, 20
"""Frames: 2 s each."""
OBSERVERS = {
    "camera and speed": (ObserverConfig(), False),
    "with a gyroscope": (ObserverConfig(), True),
    "zhang2011": (ObserverConfig("zhang2011"), False),
}


def observed(seen: Seen, name: str) -> LateralTrack:
    """The motion of a drive by one of `OBSERVERS`."""
    config, with_gyro = OBSERVERS[name]
    lanes = lane_samples_from_geometry(seen.drive.time_s, seen.geometry, seen.fits)
    return observe_lateral_motion(
        lanes, seen.speed, load_vehicle(), config, yaw_rate=seen.yaw_rate if with_gyro else None
    )


def yaw_rate_error_degps(seen: Seen, track: LateralTrack) -> np.ndarray:
    """Shape (n - `SETTLED`,)."""
    return np.degrees(track.state[:, 1] - seen.drive.states_at(seen.drive.time_s)[:, YAW_RATE])[SETTLED:]


def path_error_m(seen: Seen, track: LateralTrack, model: str) -> np.ndarray:
    """Distance of the path's end, 2 s ahead, from where the car then was; of each settled frame."""
    paths = predict_paths_from_observer(
        track, load_vehicle(), LateralPathConfig(model=model, horizon_s=AHEAD / RATE_HZ)
    )
    states = seen.drive.states_at(seen.drive.time_s)
    at = np.arange(SETTLED, len(states) - AHEAD)
    dx, dy = (states[at + AHEAD, each] - states[at, each] for each in (X, Y))
    cos, sin = np.cos(states[at, BEARING]), np.sin(states[at, BEARING])
    return np.hypot(paths.x_m[at, -1] - (cos * dx + sin * dy), paths.y_m[at, -1] - (cos * dy - sin * dx))


def row(seen: Seen, name: str) -> str:
    """Errors of a drive by one of `OBSERVERS`."""
    track = observed(seen, name)
    yaw = yaw_rate_error_degps(seen, track)
    lateral = (track.state[:, 0] - seen.drive.states_at(seen.drive.time_s)[:, LATERAL_SPEED])[SETTLED:]
    models = ("zhang2011",) if name == "zhang2011" else ("cwcli", "zhang2011")
    errors = {model: path_error_m(seen, track, model) for model in models}
    ends = ", ".join(f"{model} {np.nanmedian(each):.3f} m" for model, each in errors.items())
    known = 100.0 * np.isfinite(yaw).mean()
    spread = f"{np.sqrt(np.nanmean(yaw**2)):.2f}, at most {np.nanmax(np.abs(yaw)):.1f} deg/s"
    return f"yaw rate {spread}; v_y {np.sqrt(np.nanmean(lateral**2)):.3f} m/s; path {ends}; state in {known:.0f} %"


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=["ramp", "mountain"])
    parser.add_argument("--seeds", default="200-203", help="first and last")
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--with-yaw-rate", action="store_true")
    given = parser.parse_args()
    first, last = (int(part) for part in given.seeds.split("-"))
    for kind in given.kinds:
        for seed in range(first, last + 1):
            drive = planned(kind, seed, given.seconds)
            seen = watched(drive, drive.iter_rendered_frames(), with_yaw_rate=given.with_yaw_rate)
            for name in OBSERVERS:
                print(f"{kind} {seed} | {name:16} | {row(seen, name)}", flush=True)


if __name__ == "__main__":
    main()
