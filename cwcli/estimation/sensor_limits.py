"""What a sensor of a car can be: the ranges that nothing found from a log may leave.

A scale, a bias or a noise outside its range is no property of such a sensor. It is the sign of a wrong unit, sign, axis
or time, and is told as a contradiction instead of being used. docs/estimation.md shows the same table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cwcli.estimation.measurements import Kind


@dataclass(frozen=True)
class Limit:
    """The range of a parameter.

    Attributes:
        low, high: What a value has to lie between.
        unit: Of both, "" for a ratio.
        source: Why no sensor lies outside.
    """

    low: float
    high: float
    unit: str
    source: str

    def holds(self, value: float) -> bool:
        """Whether a value lies inside; NaN, which stands for nothing found, does."""
        return not (value <= self.low or value >= self.high)


SPEED_SCALE = Limit(
    0.85,
    1.2,
    "",
    "UN R39: a speedometer reads 0 to 10 % + 4 km/h too much, 20 % at 40 km/h; wheels of another size "
    "and worn tyres read less, by a few percent each",
)
ACCEL_BIAS = Limit(
    -1.5,
    1.5,
    "m/s^2",
    "zero-g offset of consumer MEMS accelerometers: 0.4 m/s^2 (Bosch BMI160) to 0.8 m/s^2 (InvenSense MPU-6050, "
    "vertical axis); beside it 0.7 m/s^2 of a road that rises by 7 % on the whole",
)
"""Beside gravity through the pitch at which the IMU is mounted, which `imu.ImuMounting` knows."""
YAW_RATE_BIAS = Limit(
    -0.1,
    0.1,
    "rad/s",
    "zero-rate offset of a phone's MEMS gyroscope (Bosch BMI160): 3 degrees/s, 0.05 rad/s; twice that",
)
SLOW_POSITION_SIGMA = Limit(
    0.0,
    10.0,
    "m",
    "GPS Standard Positioning Service (2020), section 3.8: 15 m in 95 % at the worst site, 6 m on each axis; the rest "
    "is room for reflections between houses",
)
GRADE_SIGMA = Limit(
    0.0, 1.2, "m/s^2", "gravity through a road whose grade scatters by 12 %: the steepest roads of a hilly town"
)
LATENCY = Limit(
    -0.5,
    1.25,
    "s",
    "a receiver that reports and smooths once a second is 1.0 s late (balzer-dresden-2014-03-26, velocity); nothing is "
    "early by more than the period of half a second that slow buses have",
)
STAMP_SIGMA = Limit(
    0.0, 0.2, "s", "twice the interval of fixes ten times a second: more than that are fixes that are repeated or stall"
)
SPEED_LEVER_ARM = Limit(-3.0, 3.0, "m", "from the road to the roof of a van")
AHEAD = Limit(-6.0, 6.0, "m", "from the rear axle to the front of a van; a longer vehicle needs --lever-arm")
WHITE_NOISE: Mapping[Kind, Limit] = {
    Kind.POSITION: Limit(0.0, 30.0, "m", "a phone's fix by cells and wireless networks; GNSS alone has 1 to 5 m"),
    Kind.VELOCITY: Limit(0.0, 3.0, "m/s", "ten times that of a GNSS velocity by Doppler shifts in a town"),
    Kind.SPEED: Limit(0.0, 3.0, "m/s", "ten times the 1 km/h to which a bus rounds a speed"),
    Kind.HEADING: Limit(0.0, 0.5, "rad", "a magnetic compass beside a car's iron errs by up to 30 degrees"),
    Kind.ACCEL: Limit(0.0, 5.0, "m/s^2", "half of gravity: an IMU on a shaking mount"),
    Kind.YAW_RATE: Limit(0.0, 0.3, "rad/s", "as much as a car turns at a street corner"),
}
"""One sigma by kind."""


def limit_of_error(name: str, kind: Kind) -> Limit:
    """The range of an error of the sensor model (`sensor_model.Part`) of a source of this kind."""
    if name == "slow":
        return GRADE_SIGMA if kind is Kind.ACCEL else SLOW_POSITION_SIGMA
    return {"scale": SPEED_SCALE, "lever": SPEED_LEVER_ARM, "ahead": AHEAD}[name]
