"""The true motion of one trial: the subject vehicle, its principal other vehicle, and what a clause asks of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.measures.outlines import LengthAndWidthM, outline_separation_m
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import ACCEL, HEADING, SPEED, X, Y

TRIAL_TRUTH_STEP_S = 0.01
"""Time step of the truth of simulated trials, s. Values between are interpolated. Chosen by hand: a car at 40 m/s moves
0.4 m in it, and interpolation errs by less than a millimetre."""
MAX_GAP_FOR_TTC_TEXT_M = 500.0
"""Gap up to which a text states the time to collision, m. Chosen by hand."""


@dataclass(frozen=True)
class Encounter:
    """The motion of two vehicles in one trial, as it really was.

    Attributes:
        time_s: Shape (k,), increasing, seconds of the trial.
        host, other: Shape (k, 8): states as `vehicle_state.STATE_NAMES`, map frame; headings are not wrapped.
        host_size, other_size: Length and width, m.
        other_id: Id of the other vehicle in warnings.
        event_s: When the trial's event begins, from which on a warning is about it.
    """

    time_s: FloatArray
    host: FloatArray
    other: FloatArray
    host_size: LengthAndWidthM
    other_size: LengthAndWidthM
    other_id: str
    event_s: float = 0.0

    @cached_property
    def gap_m(self) -> FloatArray:
        """Gap between the outlines along the host's heading, (k,); negative once they overlap in that direction."""
        dx, dy = self._offset_east_and_north_m
        cosine, sine = np.cos(self.host[:, HEADING]), np.sin(self.host[:, HEADING])
        turn = self.other[:, HEADING] - self.host[:, HEADING]
        extent = self.other_size[0] * np.abs(np.cos(turn)) + self.other_size[1] * np.abs(np.sin(turn))
        return np.asarray(dx * cosine + dy * sine - 0.5 * (self.host_size[0] + extent))

    @cached_property
    def lateral_offset_m(self) -> FloatArray:
        """Offset of the other's centre to the left of the host's heading, (k,)."""
        dx, dy = self._offset_east_and_north_m
        return np.asarray(dy * np.cos(self.host[:, HEADING]) - dx * np.sin(self.host[:, HEADING]))

    @cached_property
    def closing_mps(self) -> FloatArray:
        """Closing speed along the host's heading, (k,)."""
        turn = self.other[:, HEADING] - self.host[:, HEADING]
        return np.asarray(self.host[:, SPEED] - self.other[:, SPEED] * np.cos(turn))

    @cached_property
    def other_accel_mps2(self) -> FloatArray:
        """Acceleration of the other along the host's heading, (k,)."""
        turn = self.other[:, HEADING] - self.host[:, HEADING]
        return np.asarray(self.other[:, ACCEL] * np.cos(turn))

    @cached_property
    def ttc_s(self) -> FloatArray:
        """Time to collision at constant velocities, (k,): gap over closing speed, infinite while the gap opens."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.closing_mps > 0.0, np.maximum(self.gap_m, 0.0) / self.closing_mps, np.inf)

    @cached_property
    def ttc_with_accelerations_s(self) -> FloatArray:
        """Time to collision at constant accelerations, (k,); a vehicle that has stopped stays where it is."""
        return np.array(
            [
                time_to_close_gap_s(gap, own, own_accel, theirs, their_accel)
                for gap, own, own_accel, theirs, their_accel in zip(
                    np.maximum(self.gap_m, 0.0).tolist(),
                    self.host[:, SPEED].tolist(),
                    self.host[:, ACCEL].tolist(),
                    (self.host[:, SPEED] - self.closing_mps).tolist(),
                    self.other_accel_mps2.tolist(),
                    strict=True,
                )
            ]
        )

    @cached_property
    def separation_m(self) -> FloatArray:
        """Least distance by which the outlines are apart on the separating axes, (k,); 0 or less: they touch."""
        dx, dy = self._offset_east_and_north_m
        headings = self.host[:, HEADING], self.other[:, HEADING]
        return outline_separation_m(dx, dy, *headings, self.host_size, self.other_size)

    @cached_property
    def contact_s(self) -> float:
        """When the outlines touch first, s, linear between the samples; NaN if they never do."""
        touching = np.flatnonzero(self.separation_m <= 0.0)
        if not len(touching):
            return math.nan
        k = int(touching[0])
        if k == 0:
            return float(self.time_s[0])
        before, inside = float(self.separation_m[k - 1]), float(self.separation_m[k])
        share = before / (before - inside)
        return float(self.time_s[k - 1] + share * (self.time_s[k] - self.time_s[k - 1]))

    @cached_property
    def latest_warning_s_by_demand(self) -> dict[tuple[str, float], float]:
        """Latest warning that a judge found by search, by policy and impact speed: the same for all repetitions."""
        return {}

    def values_at(self, time_s: float) -> dict[str, float]:
        """Times to collision and gap at a time."""
        return {
            "ttc_s": self.value_at(self.ttc_s, time_s),
            "ttc_with_accelerations_s": self.value_at(self.ttc_with_accelerations_s, time_s),
            "gap_m": self.value_at(self.gap_m, time_s),
        }

    def warning_text(self, values: Mapping[str, float]) -> str:
        """When a warning came, in words."""
        ttc_s = min(values["ttc_s"], values["ttc_with_accelerations_s"])
        if math.isfinite(ttc_s) and abs(values["gap_m"]) < MAX_GAP_FOR_TTC_TEXT_M:
            return f"warned at TTC {ttc_s:.2f} s"
        return "warned"

    def value_at(self, values: FloatArray, time_s: float) -> float:
        """A value of the trial at a time, linear between the samples; infinity next to an infinite sample."""
        k = int(np.clip(np.searchsorted(self.time_s, time_s, side="right"), 1, len(self.time_s) - 1))
        share = (time_s - self.time_s[k - 1]) / (self.time_s[k] - self.time_s[k - 1])
        first, second = float(values[k - 1]), float(values[k])
        if share <= 0.0 or share >= 1.0:
            return first if share <= 0.0 else second
        return math.inf if math.isinf(first) or math.isinf(second) else first + float(share) * (second - first)

    def last_time_above_s(self, values: FloatArray, threshold: float) -> float:
        """Last time at which values that fall towards the contact are still at a threshold, s.

        It is sought from the contact (or the end) backwards; NaN if they never are.
        """
        end = len(self.time_s) if math.isnan(self.contact_s) else int(np.searchsorted(self.time_s, self.contact_s))
        above = np.flatnonzero(values[:end] >= threshold)
        if not len(above):
            return math.nan
        k = int(above[-1])
        if k + 1 >= len(self.time_s):
            return float(self.time_s[k])
        first, second = float(values[k]), float(values[k + 1])
        if not math.isfinite(first) or first == second:
            return float(self.time_s[k + 1]) if not math.isfinite(first) else float(self.time_s[k])
        share = min(1.0, (first - threshold) / (first - second))
        return float(self.time_s[k] + share * (self.time_s[k + 1] - self.time_s[k]))

    @property
    def _offset_east_and_north_m(self) -> tuple[FloatArray, FloatArray]:
        """The other's centre relative to the host's, map frame, (k,) each."""
        return self.other[:, X] - self.host[:, X], self.other[:, Y] - self.host[:, Y]


def time_to_close_gap_s(
    gap_m: float, own_mps: float, own_accel_mps2: float, other_mps: float, other_accel_mps2: float
) -> float:
    """Time until two vehicles on one line touch at constant accelerations, each of which stops at standstill.

    Args:
        gap_m: Gap, not negative.
        own_mps, own_accel_mps2: Of the vehicle behind; it does not drive backwards.
        other_mps, other_accel_mps2: Of the vehicle ahead. An oncoming one has a negative speed.

    Returns:
        Seconds; infinity if they never touch.
    """
    if gap_m <= 0.0:
        return 0.0
    own_stop, other_stop = (
        _time_to_standstill_s(own_mps, own_accel_mps2),
        _time_to_standstill_s(other_mps, other_accel_mps2),
    )
    start = 0.0
    own, theirs = own_mps, other_mps
    for end in sorted({own_stop, other_stop, math.inf}):
        a_own = 0.0 if start >= own_stop else own_accel_mps2
        a_other = 0.0 if start >= other_stop else other_accel_mps2
        own = 0.0 if start >= own_stop else own
        theirs = 0.0 if start >= other_stop else theirs
        root = _time_to_zero_gap_s(gap_m, theirs - own, a_other - a_own)
        if start + root <= end:
            return start + root
        if not math.isfinite(end):
            break
        span = end - start
        gap_m += (theirs - own) * span + 0.5 * (a_other - a_own) * span**2
        own, theirs, start = own + a_own * span, theirs + a_other * span, end
    return math.inf


def _time_to_standstill_s(speed_mps: float, accel_mps2: float) -> float:
    """When a vehicle comes to standstill, s; infinity if it does not."""
    if speed_mps == 0.0:
        return 0.0 if accel_mps2 < 0.0 else math.inf
    return -speed_mps / accel_mps2 if speed_mps * accel_mps2 < 0.0 else math.inf


def _time_to_zero_gap_s(gap_m: float, rate_mps: float, rate_change_mps2: float) -> float:
    """First t >= 0 with gap + rate t + rate_change t^2 / 2 = 0; infinity without one."""
    discriminant = rate_mps**2 - 2.0 * rate_change_mps2 * gap_m
    if discriminant < 0.0:
        return math.inf
    # 2 g / (-r + sqrt(r^2 - 2 a g)) is the smaller positive root, without cancellation for a near 0.
    below = math.sqrt(discriminant) - rate_mps
    return 2.0 * gap_m / below if below > 1e-12 else math.inf
