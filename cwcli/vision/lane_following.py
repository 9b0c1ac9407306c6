"""What is known of a lane from one frame to the next: where the car's motion takes it, and what it can't do.

A lane that is followed is judged under another prior than one that is looked for: a car that changes lanes may be
anywhere between them, and one on a ramp turns in a bend that no motorway has. What it can't do is jump: its boundaries
move by no more than a car can move sideways.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.camera import Camera
from cwcli.vision.lane_model import (
    BEND,
    HIGH,
    HORIZON,
    LOW,
    MEAN,
    MIDDLE,
    PITCH_SIGMA_RAD,
    SIGMA,
    SPIRAL,
    VANISHING,
    WIDTH,
    LanePrior,
    bend_unit,
    spiral_unit,
)

OVER_THE_LINE = 0.55
"""Of the lane's width: a car whose camera is farther from the middle is in the next lane."""
BEYOND = 0.65
"""Likewise: farther a followed lane does not go."""
BETWEEN = 0.35
"""Likewise: from here on the car may be taken to be in the next lane."""
NEXT_SHARE = 0.2
"""By so much of the width the next lane may lie beside its place."""
FOLLOWED_OFFSET_M = 0.6
"""Sigma of its place. Chosen with lane changes and mountain bends 0 and 1 of `tests.studies.lane_drives` in sight;
drives 200 and 201 of both were not."""
FOLLOWED_HEADING_RAD = 0.05
"""A car that changes lanes or slides outwards in a tight bend points so far away from its lane."""
FOLLOWED_CURVATURE_1PM = 0.02
SIDEWAYS_MPS = 0.8
"""A boundary moves sideways by no more than this beside what speed and direction tell: 0.03 rad at 25 m/s."""
UNTOLD_SIDEWAYS_MPS = 1.5
"""Where nothing tells them: a swift lane change."""
WIDENS_MPS = 0.6
"""A taper of 1 : 40 at 25 m/s."""
MARGIN_M = 0.02
"""What a place may move beside that: the paint's grain."""
LEAST_DT_S = 0.02
APART_AT = (0.25, 0.6)
"""Rows in which lanes are compared, of the way from the horizon to the bottom."""
LINES = np.array([-1.5, -0.5, 0.5, 1.5])
"""Lines of a lane and of those beside it, from its middle, in its widths."""
SAME_LINE = 0.15
"""Over the camera's height: nearer lines are one."""
JERK_MPS3 = 1.0
"""Sigma of what a road's bends ask of a car: clothoids are made for lateral jerks of 0.5 to 1 m/s^3, ramps for more."""
MOST_SIGMAS = 4.0
TURN_M = 10.0
"""Over this way a bend that begins turns the lane's direction by what nobody predicted."""
SWIFT_MPS = 20.0
"""Faster, a spiral of one sigma moves a boundary 20 m ahead by less than 0.17 m. Then lanes have none, and
new bends are not searched for: where few dots are all there is, that freedom would find lanes that are not there."""
PIVOT_AT = 0.6
"""Of the way from the horizon to the image's bottom: 7 m ahead of a wide camera."""
PITCHES = np.array([0.0, -1.0, 1.0, -2.0, 2.0, -3.0, 3.0, -4.5, 4.5])
"""What is tried, in sigmas of what the prediction of the pitch may miss: a bump moves the whole lane up or down."""
SPIRALS, BENDS = (each.ravel() for each in np.meshgrid(np.linspace(-2.0, 2.0, 9), np.linspace(-6.0, 6.0, 9)))
"""What is tried: spirals in sigmas, and bends in sigmas of the spiral times the near row's distance. Chosen, like
`TURN_M`, with ramp 200 of `tests.studies.lane_drives` in sight."""
LATERAL_ACCEL_MPS2 = 6.0
"""More grip no car uses: bends at a known speed are not tighter."""
TIGHTEST_1PM = 0.06
UNTOLD_TIGHTEST_1PM = 0.02
SLOWEST_MPS = 3.0
"""Below it a yaw rate and a speed tell no curvature."""
BEND_SHARE = 0.25
"""By so much the bend ahead differs from that in which the car is."""


def tightest_1pm(speed_mps: float) -> float:
    """The greatest curvature in which a car drives at a speed."""
    if not math.isfinite(speed_mps):
        return UNTOLD_TIGHTEST_1PM
    return min(LATERAL_ACCEL_MPS2 / max(speed_mps, SLOWEST_MPS) ** 2, TIGHTEST_1PM)


def driven_1pm(speed_mps: float, yaw_rate_radps: float) -> float:
    """The curvature in which the car drives, right positive; NaN where it is not told."""
    if not (speed_mps >= SLOWEST_MPS and math.isfinite(yaw_rate_radps)):
        return math.nan
    return -yaw_rate_radps / speed_mps


def opened(prior: LanePrior, camera: Camera, speed_mps: float) -> LanePrior:
    """The prior of a lane that is followed."""
    rows: list[list[float]] = prior.table.tolist()
    place, ahead, bend = rows[MIDDLE], rows[VANISHING], rows[BEND]
    reach = BEYOND * rows[WIDTH][HIGH]
    place[SIGMA] = FOLLOWED_OFFSET_M * prior.per_m
    place[LOW], place[HIGH] = min(place[LOW], -reach), max(place[HIGH], reach)
    heading = camera.fx * FOLLOWED_HEADING_RAD
    ahead[SIGMA] = max(ahead[SIGMA], heading)
    ahead[LOW] -= 3.0 * heading
    ahead[HIGH] += 3.0 * heading
    unit = bend_unit(camera)
    tightest = max(bend[HIGH], unit * tightest_1pm(speed_mps))
    bend[SIGMA], bend[LOW], bend[HIGH] = unit * FOLLOWED_CURVATURE_1PM, -tightest, tightest
    drift = prior.drift
    if math.isfinite(speed_mps):
        drift = drift.copy()
        speed_mps = max(speed_mps, SLOWEST_MPS)
        drift[BEND] = max(drift[BEND], 2.0 * unit * JERK_MPS3 / speed_mps**2)
        spiral = spiral_unit(camera) * JERK_MPS3 / speed_mps**3
        drift[SPIRAL] = spiral
        if speed_mps < SWIFT_MPS:
            drift[VANISHING] = math.hypot(drift[VANISHING], camera.fx * TURN_M * JERK_MPS3 / speed_mps**2)
            rows[SPIRAL] = [0.0, spiral, -MOST_SIGMAS * spiral, MOST_SIGMAS * spiral]
    return prior.with_table(np.array(rows), drift)


def pitched(lane: FloatArray, prior: LanePrior, table: FloatArray, dt_s: float) -> FloatArray:
    """Shape (k, 6): the lane as predicted, and with other horizons.

    A search that moves one number after the other takes a bump for a bend, or stays where it is.

    Args:
        lane: As predicted.
        prior: Of a followed lane.
        table: Within whose limits they stay.
        dt_s: Since the frame before.
    """
    made = np.empty((len(PITCHES), len(lane)))
    made[:] = lane
    moved = lane[HORIZON] + PITCHES * (prior.drift[HORIZON] * math.sqrt(max(dt_s, LEAST_DT_S)))
    made[:, HORIZON] = np.minimum(np.maximum(moved, table[HORIZON, LOW]), table[HORIZON, HIGH])
    return made


def turned(lane: FloatArray, prior: LanePrior, table: FloatArray, height_px: int) -> FloatArray:
    """Shape (k, 6): the lane with other bends and spirals, which keeps its place and direction in a near row.

    Where a road begins to bend, place and direction beside the camera, bend and spiral are wrong together, and a search
    that moves one after the other does not leave the old bend. With t = 1 / h in the near row, all that leaves the line
    as it is there is dk (1 / h - t)^2 h + dq (1 / h - t)^3 h.

    Args:
        lane: As predicted.
        prior: Of a followed lane (`opened`): its spiral's sigma is the grid's unit.
        table: Within whose limits they stay.
        height_px: Of the image.
    """
    t, sigma = 1.0 / (PIVOT_AT * (height_px - float(lane[HORIZON]))), float(prior.table[SPIRAL, SIGMA])
    spirals, bends = sigma * SPIRALS, sigma * t * BENDS
    made = np.empty((len(bends), len(lane)))
    made[:] = lane
    dq = spirals - lane[SPIRAL]
    made[:, VANISHING] += (3.0 * dq * t - 2.0 * bends) * t
    made[:, MIDDLE] += (bends - dq * t) * t * t
    made[:, BEND] += bends - 3.0 * dq * t
    made[:, SPIRAL] = spirals
    return np.minimum(np.maximum(made, table[:, LOW]), table[:, HIGH])


def bent(prior: LanePrior, camera: Camera, speed_mps: float, yaw_rate_radps: float) -> LanePrior:
    """The prior of a lane that is looked for, with the bend in which the car drives, where that is told."""
    driven = driven_1pm(speed_mps, yaw_rate_radps)
    if math.isnan(driven):
        return prior
    table = prior.table.copy()
    unit = bend_unit(camera)
    table[BEND, MEAN] = unit * driven
    table[BEND, SIGMA] = math.hypot(table[BEND, SIGMA], unit * BEND_SHARE * driven)
    tightest = max(table[BEND, HIGH], unit * tightest_1pm(speed_mps))
    table[BEND, LOW], table[BEND, HIGH] = -tightest, tightest
    return prior.with_table(table)


def learned(prior: LanePrior, horizon_px: float, camera: Camera) -> LanePrior:
    """The prior with the horizon that the frames showed so far."""
    table = prior.table.copy()
    sigma = max(camera.fy * PITCH_SIGMA_RAD, 1.0)
    table[HORIZON] = horizon_px, sigma, horizon_px - 6.0 * sigma, horizon_px + 6.0 * sigma
    return prior.with_table(table)


def at_horizon(prior: LanePrior, lane: FloatArray, camera: Camera) -> LanePrior:
    """The prior for a lane whose horizon is another one than that which the frames showed so far; else itself."""
    row = prior.table[HORIZON]
    if prior.is_mounted or row[LOW] <= lane[HORIZON] <= row[HIGH]:
        return prior
    return learned(prior, float(lane[HORIZON]), camera)


def predicted(
    lane: FloatArray, camera: Camera, speed_mps: float, yaw_rate_radps: float, dt_s: float, prior: LanePrior
) -> FloatArray:
    """The lane in the next frame from the car's motion; unknown motion changes nothing.

    With places and curvatures K to the right, the lane's direction seen from the car turns by (K v + yaw rate) dt, its
    middle moves sideways by that direction times v dt, and the bend changes as it does ahead.

    Args:
        lane, camera, prior: As elsewhere.
        speed_mps, yaw_rate_radps: NaN where not known.
        dt_s: To the next frame.
    """
    made = np.array(lane)
    height_m = camera.mounting.height_m
    if math.isfinite(speed_mps):
        way_m = speed_mps * dt_s
        bend_1pm, change_1pm2 = lane[BEND] / bend_unit(camera), lane[SPIRAL] / spiral_unit(camera)
        if math.isfinite(yaw_rate_radps):
            turned_rad = (bend_1pm + 0.5 * change_1pm2 * way_m) * way_m + yaw_rate_radps * dt_s
            made[VANISHING] += camera.fx * turned_rad
        made[BEND] += bend_unit(camera) * change_1pm2 * way_m
        if prior.is_mounted:
            straight = camera.cx + camera.fx * math.tan(camera.mounting.yaw_rad)
            made[MIDDLE] += (lane[VANISHING] - straight) / camera.fx * way_m * prior.pinhole.stretch / height_m
    return made


def crossed(lane: FloatArray) -> int:
    """1 if the car has come into the next lane to the left, -1 to the right, else 0."""
    if abs(lane[MIDDLE]) <= OVER_THE_LINE * lane[WIDTH]:
        return 0
    return 1 if lane[MIDDLE] > 0.0 else -1


def beside(lane: FloatArray, change: int) -> FloatArray:
    """The lane after a change (`crossed`): the next one to the left (1) or to the right (-1)."""
    made = np.array(lane)
    made[MIDDLE] -= change * made[WIDTH]
    return made


def narrowed(prior: LanePrior, lane: FloatArray, dt_s: float, sideways_mps: float = UNTOLD_SIDEWAYS_MPS) -> FloatArray:
    """The prior's table times a normal distribution around the predicted lane, to which direction and bend are left.

    The lane's place and width are kept within what a car can do and a taper does.

    Args:
        prior: Of a followed lane (`opened`).
        lane: As predicted.
        dt_s: Since the frame before.
        sideways_mps: What the prediction of the place may miss at most.
    """
    dt_s = max(dt_s, LEAST_DT_S)
    predicted_at: list[float] = lane.tolist()
    sigma: list[float] = (prior.drift * math.sqrt(dt_s)).tolist()
    rows: list[list[float]] = prior.table.tolist()
    for k in (MIDDLE, WIDTH, HORIZON):  # a spiral begins and ends at once: it keeps its prior
        before, now = 1.0 / rows[k][SIGMA] ** 2, 1.0 / sigma[k] ** 2
        rows[k][MEAN] = (rows[k][MEAN] * before + predicted_at[k] * now) / (before + now)
        rows[k][SIGMA] = 1.0 / math.sqrt(before + now)
    for k in (VANISHING, BEND):  # the prior of a first frame, anew in every frame, would flatten every bend
        rows[k][MEAN], rows[k][SIGMA] = predicted_at[k], sigma[k]
    for k, rate_mps in ((MIDDLE, sideways_mps), (WIDTH, WIDENS_MPS)):
        reach = (rate_mps * dt_s + MARGIN_M) * prior.per_m
        _, _, low, high = rows[k]
        place = min(max(predicted_at[k], low), high)
        rows[k][LOW], rows[k][HIGH] = max(place - reach, low), min(place + reach, high)
    return np.array(rows)


def shift_m(lane: FloatArray, other: FloatArray, prior: LanePrior) -> float:
    """How far the boundary that differs more lies from that of another lane, beside the camera."""
    apart = abs(float(lane[MIDDLE] - other[MIDDLE])) + 0.5 * abs(float(lane[WIDTH] - other[WIDTH]))
    return apart / prior.per_m


def apart_m(lane: FloatArray, other: FloatArray, prior: LanePrior, height_px: int) -> float:
    """How far the boundary that differs more lies from that of another lane, near and 20 m ahead of a wide camera."""
    most = 0.0
    for share in APART_AT:
        h = share * (height_px - float(lane[HORIZON]))
        other_h = h + float(lane[HORIZON] - other[HORIZON])
        if other_h <= 0.0:
            return math.inf
        moved = boundaries_px(lane, h) - boundaries_px(other, other_h)
        most = max(most, float(np.abs(moved).max()) / h)
    return most / prior.per_m


def boundaries_px(lane: FloatArray, h: float) -> FloatArray:
    """Shape (2,): columns of both boundaries h rows below the lane's horizon; of a tight bend, of what touches it."""
    u0, middle, width, bend, _, spiral = lane.tolist()
    return np.asarray(u0 + np.array([middle - 0.5 * width, middle + 0.5 * width]) * h + (bend + spiral / h) / h)


def lines_at(lane: FloatArray, other: FloatArray, height_px: int) -> tuple[bool, bool]:
    """Whether a lane, or one beside it, has a line where the left and the right boundary of another one lie."""
    found = np.ones((2, len(LINES)), np.bool_)
    for share in APART_AT:
        h = share * (height_px - float(other[HORIZON]))
        own_h = h + float(other[HORIZON] - lane[HORIZON])
        if own_h <= 0.0:
            return False, False
        middle = float(boundaries_px(lane, own_h).mean())
        lines = middle + LINES * float(lane[WIDTH]) * own_h
        found &= np.abs(lines - boundaries_px(other, h)[:, None]) <= SAME_LINE * h
    return bool(found[0].any()), bool(found[1].any())


def change_between(lane: FloatArray, other: FloatArray) -> int:
    """Whether another lane is the next one to the left (1) or to the right (-1), and the car between them; else 0."""
    width = 0.5 * float(lane[WIDTH] + other[WIDTH])
    change = 1 if lane[MIDDLE] > other[MIDDLE] else -1
    apart = abs(float(lane[MIDDLE] - other[MIDDLE]))
    is_between = change * float(lane[MIDDLE]) > BETWEEN * width
    return change if is_between and abs(apart - width) < NEXT_SHARE * width else 0
