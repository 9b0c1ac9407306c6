"""The scenes over which the European Commission's JRC-FSM compares the driver models; 10 Hz, cars of 4.3 by 1.9 m."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.control.driver_models import CasePoses, DriverModel, DriverOutcome, EgoCases, simulate_driver_cases

FloatArray = npt.NDArray[np.float64]
CAR_M = (4.3, 1.9)
STEP_S = 0.1
N_STEPS = 350
KMH = 1.0 / 3.6
LANE_GAP_M = 1.6
CUT_IN_ACCEL_MPS2 = 1.5
STANDING_M = (5.0, 1.9)  # the standing car of the cut-out is as long as the reference's default
WANDERING_M = -0.375


def straight(way_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return way_m, np.zeros(len(way_m)), np.zeros(len(way_m))


def cut_in(
    driver: DriverModel, ego_kmh: FloatArray, other_kmh: FloatArray, gap_m: FloatArray, lateral: FloatArray
) -> DriverOutcome:
    """The other leaves its lane, with 1.5 m/s^2 up to its lateral speed, which it has where the gap is as told.

    Places are sums of steps, as in the reference, so that what is decided by the last bit is decided alike.
    """
    own, theirs = ego_kmh * KMH, other_kmh * KMH
    outcomes, order = [], []
    for speed in np.unique(lateral):
        rows = np.flatnonzero(lateral == speed)
        order.append(rows)
        side, across = cut_in_profile(float(speed))
        before = len(side) - N_STEPS - 1

        def other_at(
            step: int,
            rows: np.ndarray = rows,
            side: FloatArray = side,
            across: FloatArray = across,
            early: int = before,
        ) -> tuple[CasePoses, np.ndarray, tuple[float, float]]:
            n, zero = len(rows), np.zeros(len(rows))
            x = gap_m[rows] + CAR_M[0] + (step - early) * theirs[rows] * STEP_S
            pose = CasePoses(x, np.full(n, side[step]), zero, theirs[rows], np.full(n, across[step]))
            return pose, np.ones(n, dtype=bool), CAR_M

        outcomes.append(
            simulate_driver_cases(
                driver,
                ego=EgoCases(speed_mps=own[rows], pose_at=straight, size=CAR_M, offset_m=-before * own[rows] * STEP_S),
                other_at=other_at,
                n_steps=N_STEPS + before,
                step_s=STEP_S,
            )
        )
    return joined(outcomes, np.concatenate(order))


def cut_in_profile(lateral: float) -> tuple[FloatArray, FloatArray]:
    """Place and speed across, of each step: the ramp, one step at the lateral speed, and the cut-in."""
    side = LANE_GAP_M + CAR_M[1]
    ramp = np.arange(0.0, -lateral, -CUT_IN_ACCEL_MPS2 / 10)
    early = np.cumsum(-ramp[::-1] / 10)[::-1] + side
    n_moving = int(10 * side // lateral + 1) if lateral else 0
    moving = np.concatenate([np.full(n_moving, -lateral), np.zeros(N_STEPS)])[:N_STEPS]
    place = np.concatenate([early, [side], moving.cumsum() / 10 + side])
    return place, np.concatenate([ramp, [-lateral], moving])


def joined(outcomes: list[DriverOutcome], order: np.ndarray) -> DriverOutcome:
    back = np.argsort(order)
    names = DriverOutcome.__dataclass_fields__
    return DriverOutcome(**{name: np.concatenate([getattr(each, name) for each in outcomes])[back] for name in names})


def following(
    driver: DriverModel, distance: Callable[[FloatArray], FloatArray], kmh: FloatArray, braking_g: FloatArray
) -> DriverOutcome:
    """The other ahead brakes from the first moment on."""
    own = kmh * KMH
    x = distance(own) + CAR_M[0]
    state = {"x": x}

    def other_at(step: int) -> tuple[CasePoses, np.ndarray, tuple[float, float]]:
        speed = np.maximum(own - step * braking_g * 9.81 * STEP_S, 0.0)
        state["x"] = state["x"] + speed * STEP_S
        zero = np.zeros(len(own))
        return CasePoses(state["x"], zero, zero, speed, zero), np.ones(len(own), dtype=bool), CAR_M

    return simulate_driver_cases(
        driver,
        ego=EgoCases(speed_mps=own, pose_at=straight, size=CAR_M, offset_m=own * STEP_S),
        other_at=other_at,
        n_steps=N_STEPS - 1,
        step_s=STEP_S,
    )


def cut_out(
    driver: DriverModel,
    distance: Callable[[FloatArray], FloatArray],
    kmh: FloatArray,
    beyond_m: FloatArray,
    lateral: FloatArray,
) -> DriverOutcome:
    """The one ahead leaves the lane, behind which another stands; it may run into that one itself."""
    own = kmh * KMH
    x_ahead = distance(own) + CAR_M[0]
    x_stands = x_ahead + beyond_m + CAR_M[0]
    n_moving = (10 * 4.0 // lateral + 1).astype(int)
    run = {"x": x_ahead.copy(), "y": np.zeros(len(own)), "stopped": np.zeros(len(own), dtype=bool)}
    length = 0.5 * (STANDING_M[0] + CAR_M[0])

    def other_at(step: int) -> tuple[CasePoses, np.ndarray, Any]:
        go = ~run["stopped"]
        run["x"] = np.where(go, run["x"] + own * STEP_S, run["x"])
        run["y"] = np.where(go & (step < n_moving), run["y"] - lateral / 10, run["y"])
        hits = (np.abs(run["y"]) < CAR_M[1]) & (np.abs(x_stands - run["x"]) < length)
        run["stopped"] = run["stopped"] | hits
        crashed = run["stopped"]
        zero = np.zeros(len(own))
        pose = CasePoses(np.where(crashed, run["x"], x_stands), np.where(crashed, run["y"], 0.0), zero, zero, zero)
        size = np.where(crashed, CAR_M[0], STANDING_M[0]), np.where(crashed, CAR_M[1], STANDING_M[1])
        return pose, crashed | (run["y"] < WANDERING_M), size

    return simulate_driver_cases(
        driver,
        ego=EgoCases(speed_mps=own, pose_at=straight, size=CAR_M, offset_m=own * STEP_S),
        other_at=other_at,
        n_steps=N_STEPS - 1,
        step_s=STEP_S,
    )
