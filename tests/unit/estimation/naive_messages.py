"""Plain Python twin of `cwcli/kernels/ekf_messages.pxd`: whether a message agrees with the last believed one."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Message:
    """Position, speed and heading at one time (s, m, m/s, rad), with their sigmas."""

    time_s: float
    x_m: float
    y_m: float
    speed_mps: float
    heading_rad: float
    position_sigma_m: float
    speed_sigma_mps: float
    heading_sigma_rad: float


@dataclass
class Sender:
    """All messages since the last believed one, which is the first."""

    since_believed: list[Message] = field(default_factory=list)

    def agrees(self, new: Message) -> bool:
        """Whether a car where the believed message said can be where the new one says."""
        if not self.since_believed:
            return False
        chain = [*self.since_believed, new]
        old, gap_s = chain[0], new.time_s - chain[0].time_s
        if gap_s > 2.0:
            return False
        x, y, slack = old.x_m, old.y_m, 0.0
        for a, b in itertools.pairwise(chain):
            dt = b.time_s - a.time_s
            for each in (a, b):
                x += each.speed_mps * math.cos(each.heading_rad) * dt / 2
                y += each.speed_mps * math.sin(each.heading_rad) * dt / 2
            slack += 12.0 * dt**2 / 4  # full throttle for half of the time, then full braking
        speed_sigma = math.hypot(old.speed_sigma_mps, new.speed_sigma_mps)
        position_sigma = math.hypot(old.position_sigma_m, new.position_sigma_m, gap_s * speed_sigma / math.sqrt(2))
        heading_sigma = math.hypot(old.heading_sigma_rad, new.heading_sigma_rad)
        change = new.heading_rad - old.heading_rad
        turned = abs(math.atan2(math.sin(change), math.cos(change)))
        fastest = max(abs(old.speed_mps), abs(new.speed_mps))
        turn_rate = min(1.0, 12.0 / fastest) if fastest else 1.0
        return (
            abs(new.speed_mps - old.speed_mps) <= 12.0 * gap_s + 4 * speed_sigma
            and turned <= turn_rate * gap_s + 4 * heading_sigma
            and math.hypot(new.x_m - x, new.y_m - y) <= slack + 4 * position_sigma
        )

    def add(self, new: Message, *, believed: bool) -> None:
        """Remember a message."""
        if believed:
            self.since_believed = [new]
        elif self.since_believed:
            self.since_believed.append(new)
