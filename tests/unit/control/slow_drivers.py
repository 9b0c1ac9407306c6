"""A cut-in, one case and one moment at a time: the driver models of UN R157 and its study, written out anew.

UN R157, annex 4, appendix 3 (the careful and competent human) and 5.2.5.2 (the criterion of avoidable crashes);
Shalev-Shwartz et al. 2017 (RSS); Mattas et al. 2020 (the fuzzy safety model). 10 Hz, two cars of 4.3 by 1.9 m.
"""

from __future__ import annotations

import math

LENGTH_M, WIDTH_M, BESIDE_M = 4.3, 1.9, 1.6
HZ = 10
LIMIT = 0.774 * 9.81
REACTION_S = {"CC_human_driver": 0.75, "Reg157": 0.35, "RSS": 0.75, "FSM": 0.75}


def crashes(model: str, own_mps: float, other_mps: float, gap_m: float, lateral_mps: float, n_steps: int = 350) -> bool:
    """Whether the driver hits one that comes over from the next lane, and has reached its lateral speed at that gap."""
    ramp, speed = [], 0.0
    while lateral_mps > 0.0 and speed < lateral_mps - 1e-12:
        ramp.append(speed)
        speed += 1.5 / HZ
    before = len(ramp)
    x, own_x, own = gap_m + LENGTH_M - before * other_mps / HZ, -before * own_mps / HZ, own_mps
    y = BESIDE_M + WIDTH_M + sum(ramp) / HZ
    moving = int(HZ * (BESIDE_M + WIDTH_M) // lateral_mps + 1) if lateral_mps else 0
    across = [*ramp, lateral_mps, *[lateral_mps] * moving]
    waited, braking, last = REACTION_S[model], 0.0, own
    for step in range(n_steps + before):
        sideways = across[step] if step < len(across) else 0.0
        gap, beside = abs(x - own_x) - LENGTH_M, abs(y) - WIDTH_M
        ttc = abs(gap / (own - other_mps)) if own != other_mps else math.inf
        wanted = 0.0
        if x >= own_x:
            if model == "CC_human_driver" and beside <= 0.0 and ttc > 2.0:
                return False  # it came over with time enough
            wanted = wish(model, gap, beside, own, other_mps, sideways, (own - last) * HZ, ttc)
        if gap < 0.0 and beside < 0.0:
            return True
        last = own
        if wanted > 0.0:
            if waited > 0.0:
                waited -= 1.0 / HZ
                braking = 0.4 if model == "CC_human_driver" else 0.0
            else:
                braking = 6.0 if model == "Reg157" else min(braking + 12.65 / HZ, wanted)
            own = max(own - braking / HZ, 0.0)
        own_x += own / HZ
        following = across[step + 1] if step + 1 < len(across) else 0.0
        x, y = x + other_mps / HZ, y - (following if step >= before else sideways) / HZ
    return False


def wish(
    model: str, gap: float, beside: float, own: float, other: float, sideways: float, accel: float, ttc: float
) -> float:
    """The deceleration that a driver wants at a moment; 0: it sees no danger."""
    if model == "CC_human_driver":
        return LIMIT if beside <= 0.0 and ttc <= 2.0 else 0.0
    if model == "Reg157":
        return 6.0 if beside <= 0.5 and ttc <= (own - other) / 12.0 + 0.35 + 0.1 else 0.0
    if model == "RSS":
        after = own + 0.75 * 3.0
        along = own * 0.75 + 3.0 * 0.75**2 / 2.0 + after**2 / 12.0 - other**2 / 12.0
        left = 0.3 + (2.0 * sideways + 0.75) * 0.75 / 2.0 + (sideways + 0.75) ** 2 / 2.0
        return LIMIT if gap < along and beside < left else 0.0
    if beside > 0.0 and (sideways <= 0.0 or beside / sideways > (gap + 2.0 * LENGTH_M) / (own - other) + 0.1):
        return 0.0
    critical = cfs(gap, own, other, accel)
    return 4.0 + 2.0 * critical if critical > 0.0 else 4.0 * pfs(gap, own, other)


def pfs(gap: float, own: float, other: float) -> float:
    """Of the gap less 2 m: what is unsafe if the one ahead brakes with 7 m/s^2."""
    unsafe = own * 0.75 + own**2 / 12.0 - other**2 / 14.0
    safe = own * 0.75 + own**2 / 8.0 - other**2 / 14.0 + 2.0
    return share(gap - 2.0, unsafe, safe)


def cfs(gap: float, own: float, other: float, accel: float) -> float:
    """At the other's present speed; the acceleration goes on during the reaction."""
    if own <= other:
        return 0.0
    accel = max(accel, -4.0)
    after = own + accel * 0.75
    way = (own + after) / 2.0 * 0.75 - other * 0.75
    if after < other:
        caught = (own - other) ** 2 / abs(2.0 * accel)
        return 1.0 if gap < caught else 0.0
    return share(gap, way + (after - other) ** 2 / 12.0, way + (after - other) ** 2 / 8.0)


def share(value: float, unsafe: float, safe: float) -> float:
    """1 below what is unsafe, 0 above what is safe, linear between."""
    if value < unsafe:
        return 1.0
    if value > safe:
        return 0.0
    return (safe - value) / (safe - unsafe) if safe > unsafe else 1.0
