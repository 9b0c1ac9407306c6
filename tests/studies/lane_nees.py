"""Whether the default lane method errs by as much as it says: squared errors over their variances.

    python -m tests.studies.lane_nees                    # 8 drives of each set and camera
    python -m tests.studies.lane_nees --seed 11 --preview 33.5

Rendered drives of the sets `good` and `complex`, of the paper's camera (320 x 240, 20 degrees wide) and of a wide one
(480 x 270), mounting and speed known, 16 frames at 10 Hz, every third of them. Of the lane's middle, its direction and
its curvature at the preview point: root mean square error, median sigma, and the mean of the squared error over its
variance, which is 1 where the sigmas are right. The mounting's own errors are none. Lanes that are off by more than
half a metre are counted, and left out: no sigma knows of a wrong line. Seed 3 was in sight of the constants in
`cwcli.vision.covariance_of_first_five_lane_numbers`.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from cwcli.reproduction.zhang2011.rendered import camera_with_pitch_error
from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.camera import RoadCamera, camera_of_zhang2011, wide_camera
from cwcli.simulation.road.drive import iter_set_drives
from cwcli.simulation.streams import seconds_to_ns
from cwcli.vision.fit_columns import FitCollector
from cwcli.vision.ground import GeometrySigmas, compute_lane_geometry
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.method import LaneFrame

N_FRAMES, EVERY = 16, 3
WRONG_M = 0.5
EXACT = GeometrySigmas(pitch_rad=0.0, yaw_rad=0.0, height_m=0.0)
CAMERAS = {"paper's": camera_of_zhang2011(), "wide": wide_camera(480, 270)}


@dataclass(frozen=True)
class Errors:
    """Of n frames: y_L (m), e_L (rad), K_L (1/m).

    Attributes:
        error, sigma: Shape (n, 3).
        n_wrong: Frames that were left out.
    """

    error: FloatArray
    sigma: FloatArray
    n_wrong: int

    def ratios(self) -> FloatArray:
        """Shape (3,): mean squared error over its variance."""
        return np.asarray(((self.error / self.sigma) ** 2).mean(axis=0))


def errors(name: str, n_drives: int, seed: int, camera: RoadCamera, preview_m: float) -> Errors:
    """Errors and sigmas on some drives of a set."""
    error, sigma = [], []
    told = camera_with_pitch_error(camera)
    for drive in iter_set_drives(name, n_drives, seed=seed, camera=camera, n_frames=N_FRAMES):
        search, recorder, truths = LaneTracker(), FitCollector(), []
        stamp_ns, speed_mps = seconds_to_ns(drive.time_s), drive.speed_at_mps(drive.time_s)
        for k, made in enumerate(drive.iter_rendered_frames()):
            frame = LaneFrame(made.grey, told, int(stamp_ns[k]), k, speed_mps=float(speed_mps[k]))
            recorder.append_fit(search.step(frame))
            truths.append([-part for part in made.truth.lane_centre_at_preview(preview_m)])
        geometry = compute_lane_geometry(recorder.to_columns(), told, preview_m=preview_m, sigmas=EXACT)
        values = (geometry.lateral_deviation_m, geometry.heading_deviation_rad, geometry.curvature_1pm)
        sigmas = (
            geometry.lateral_deviation_sigma_m,
            geometry.heading_deviation_sigma_rad,
            geometry.curvature_sigma_1pm,
        )
        error.append((np.column_stack(values) - truths)[::EVERY])
        sigma.append(np.column_stack(sigmas)[::EVERY])
    every, own = np.concatenate(error), np.concatenate(sigma)
    found = np.isfinite(every).all(axis=1)
    is_right = found & (np.abs(every[:, 0]) <= WRONG_M)
    return Errors(every[is_right], own[is_right], int(np.count_nonzero(found & ~is_right)))


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--drives", type=int, default=8)
    parser.add_argument("--preview", type=float, default=20.0)
    given = parser.parse_args()
    print("| set | camera | frames | wrong | error (m, rad, 1/m) | sigma, median | squared error over variance |")
    print("|---|---|---|---|---|---|---|")
    for name in ("good", "complex"):
        for label, camera in CAMERAS.items():
            seen = errors(name, given.drives, given.seed, camera, given.preview)
            rms = np.sqrt((seen.error**2).mean(axis=0))
            parts = [f"{y:.3f}, {e:.4f}, {k:.5f}" for y, e, k in (rms.tolist(), np.median(seen.sigma, axis=0).tolist())]
            ratios = ", ".join(f"{ratio:.2f}" for ratio in seen.ratios().tolist())
            print(f"| `{name}` | {label} | {len(seen.error)} | {seen.n_wrong} | {' | '.join(parts)} | {ratios} |")


if __name__ == "__main__":
    main()
