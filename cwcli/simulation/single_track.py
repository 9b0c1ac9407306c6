"""A single-track car before a camera: zhang2011's simulated runs (figures 14 to 16), on the paper's linear model.

The steering angle is held while the road keeps its curvature, so the car soon leaves the lane and e_L grows without
bound. The paper's linear model (eq. 20, 21) allows that. A car that stays in a real lane is
`lane_drive`.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from cwcli.dynamics.matrix_exponential import transition_and_input_matrices
from cwcli.dynamics.samples import DEFAULT_PREVIEW_POINT_DISTANCE_M, LaneSamples, ScalarSamples
from cwcli.dynamics.single_track import preview_state_matrices, steady_lateral_speed_and_yaw_rate
from cwcli.dynamics.vehicle import Vehicle
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import MPS_PER_KMH
from cwcli.simulation.streams import seconds_to_ns


@dataclass(frozen=True)
class PaperRun:
    """One of the paper's simulated runs.

    Attributes:
        figure: Name of the figure, e.g. `fig 14`.
        load: Load of the simulated car.
        steer_rad: Steering angle, which is held; positive to the left. The paper's angles go right, as its bend does.
        start_kmh, end_kmh: Speed at the start, and the speed that is held once it is reached.
        accel_mps2: Acceleration between them.
        duration_s: Duration; the paper's text does not state it.
        curvature_1pm: Mean curvature of the road.
        step_s: Time step of the simulation.
        frame_s: Time between the observer's frames.
    """

    figure: str
    load: str
    steer_rad: float
    start_kmh: float
    end_kmh: float
    accel_mps2: float = 0.0
    duration_s: float = 5.0
    curvature_1pm: float = 0.001
    step_s: float = 0.01
    frame_s: float = 0.1


PAPER_RUNS: dict[str, PaperRun] = {
    "fig 14": PaperRun("fig 14", "half", -0.1, 88.0, 88.0),
    "fig 15": PaperRun("fig 15", "half", -0.01, 60.0, 80.0, 0.2, 27.8),
    "fig 16": PaperRun("fig 16", "full", -0.01, 80.0, 80.0),
}
"""The simulated runs of zhang2011's figures 14 to 16 by figure; durations that the paper does not state are chosen by
hand."""


@dataclass(frozen=True)
class LinearRun:
    """The true states and the exact measurements at each frame.

    Attributes:
        time_s: Shape (n,).
        state: Shape (n, 4): true v_y, gamma, y_L, e_L; signs as in `dynamics.single_track`.
        speed_mps: Shape (n,).
        lanes: Exact measurements.
        speed: Exact speed.
        steer: The held angle.
    """

    time_s: FloatArray
    state: FloatArray
    speed_mps: FloatArray
    lanes: LaneSamples
    speed: ScalarSamples
    steer: ScalarSamples


def simulate_zhang2011_run(
    run: PaperRun,
    vehicle: Vehicle,
    *,
    start: Literal["turning", "straight"] = "turning",
) -> LinearRun:
    """Drive the car of `run.load` on the linear model, exactly over each step.

    Args:
        vehicle: The car; its load is set by the run.
        start: "turning": in a steady turn from the first frame on, so the observer begins with the whole of v_y and
            gamma as its error. "straight": from v_y = gamma = 0, as the steering steps.
    """
    car = vehicle.with_load(run.load)
    per_frame = round(run.frame_s / run.step_s)
    n = int(run.duration_s / run.frame_s + 1e-9) + 1
    speeds = np.minimum(
        run.start_kmh * MPS_PER_KMH + run.accel_mps2 * run.step_s * np.arange(n * per_frame), run.end_kmh * MPS_PER_KMH
    )
    state = np.zeros((n, 4))
    if start == "turning":
        state[0, :2] = steady_lateral_speed_and_yaw_rate(car, run.start_kmh * MPS_PER_KMH, run.steer_rad)
    x = state[0].copy()
    inputs = np.array([run.steer_rad, run.curvature_1pm])
    phi = gamma = np.zeros(0)
    speed = np.nan
    for i in range((n - 1) * per_frame):
        middle = 0.5 * (speeds[i] + speeds[i + 1])
        if middle != speed:
            speed = middle
            phi, gamma = transition_and_input_matrices(
                *preview_state_matrices(car, float(speed), DEFAULT_PREVIEW_POINT_DISTANCE_M), run.step_s
            )
        x = phi @ x + gamma @ inputs
        if (i + 1) % per_frame == 0:
            state[(i + 1) // per_frame] = x
    time_s = np.arange(n, dtype=np.float64) * run.frame_s
    stamp_ns = seconds_to_ns(time_s)
    speed_mps = speeds[::per_frame].copy()
    constant = np.full(n, run.curvature_1pm)
    return LinearRun(
        time_s=time_s,
        state=state,
        speed_mps=speed_mps,
        lanes=LaneSamples(stamp_ns, state[:, 2].copy(), state[:, 3].copy(), constant),
        speed=ScalarSamples(stamp_ns, speed_mps),
        steer=ScalarSamples(stamp_ns, np.full(n, run.steer_rad)),
    )
