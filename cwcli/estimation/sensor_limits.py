"""Ranges of the constants that a sensor of a car can have; values found from a log must lie within.

A scale, a bias or a noise outside its range is no property of such a sensor. It is the sign of a wrong unit, sign, axis
or time, and is told as a contradiction instead of being used. docs/estimation.md shows the same table.
"""

from __future__ import annotations

from collections.abc import Mapping

from cwcli.estimation.measurements import Kind
from cwcli.lazy_dataclass import dataclass


@dataclass(frozen=True)
class ParameterRange:
    """The range of a parameter.

    Attributes:
        low, high: Bounds of the value.
        unit: Unit of both, "" for a ratio.
        source: Why no sensor lies outside.
    """

    low: float
    high: float
    unit: str
    source: str

    def contains_or_is_nan(self, value: float) -> bool:
        """Whether a value lies inside; True for NaN, which means that none was found."""
        return not (value <= self.low or value >= self.high)


SPEED_SCALE_RANGE = ParameterRange(
    0.85,
    1.2,
    "",
    "UN R39: a speedometer reads 0 to 10 % + 4 km/h too much, 20 % at 40 km/h; wheels of another size "
    "and worn tyres read less, by a few percent each",
)
"""Range of the scale of a speed; its field `source` has the reasons, as in all ranges here."""
ACCEL_BIAS_RANGE = ParameterRange(
    -1.5,
    1.5,
    "m/s^2",
    "zero-g offset of consumer MEMS accelerometers: 0.4 m/s^2 (Bosch BMI160) to 0.8 m/s^2 (InvenSense MPU-6050, "
    "vertical axis); beside it 0.7 m/s^2 of a road that rises by 7 % on the whole",
)
"""Bias without gravity through the mounting of the IMU, which `imu.ImuMounting` has."""
YAW_RATE_BIAS_RANGE = ParameterRange(
    -0.1,
    0.1,
    "rad/s",
    "zero-rate offset of a phone's MEMS gyroscope (Bosch BMI160): 3 degrees/s, 0.05 rad/s; twice that",
)
"""Range of the bias of a gyroscope, rad/s; its field `source` gives the reason."""
SLOW_POSITION_SIGMA_RANGE = ParameterRange(
    0.0,
    10.0,
    "m",
    "GPS Standard Positioning Service (2020), section 3.8: 15 m in 95 % at the worst site, 6 m on each axis; the rest "
    "is room for reflections between houses",
)
"""Range of the sigma of a slow error of positions, m, per axis; its field `source` gives the reason."""
ROAD_GRADE_ACCEL_SIGMA_RANGE = ParameterRange(
    0.0, 1.2, "m/s^2", "gravity through a road whose grade scatters by 12 %: the steepest roads of a hilly town"
)
"""Range of the sigma of gravity through the grade of the road, m/s^2; its field `source` gives the reason."""
LATENCY_RANGE = ParameterRange(
    -0.5,
    1.25,
    "s",
    "a receiver that reports and smooths once a second is 1.0 s late (balzer-dresden-2014-03-26, velocity); nothing is "
    "early by more than the period of half a second that slow buses have",
)
"""Range of a latency, s; positive is late; its field `source` gives the reason."""
LATENCY_CHANGE_PER_SECOND_RANGE = ParameterRange(
    -1e-3, 1e-3, "", "twice the 500 ppm by which NTP slews a clock at most (RFC 5905); quartz drifts by 100 ppm"
)
"""Range of the change of a latency in a second, s/s; its field `source` gives the reason."""
UNKNOWN_DELAY_SIGMA_S = 0.05
"""One sigma of the delay of a source of which nothing is known, s: a receiver with ten fixes a second computes for 30
to 100 ms before it sends, a car's bus and an operating system delay by 5 to 50 ms. Chosen as a round number of
these."""
UNKNOWN_DELAY_SIGMA_IN_STAMP_SIGMAS = 2.0
"""One sigma of the unknown delay of a source, in sigmas of its stamp errors. A delay that varies from 0 on has a mean
of 1 (exponential) to 1.7 (even) of its own sigma, and most have a part beside it that is constant."""
STAMP_SIGMA_RANGE = ParameterRange(
    0.0, 0.2, "s", "twice the interval of fixes ten times a second: more than that are fixes that are repeated or stall"
)
"""Range of the sigma of stamp errors, s; its field `source` gives the reason."""
ESTIMATED_POINT_ABOVE_SPEED_POINT_RANGE = ParameterRange(-3.0, 3.0, "m", "from the road to the roof of a van")
"""Range of the height, m, of the estimated point above the point of a speed; its field `source` gives the reason."""
LONGITUDINAL_LEVER_ARM_RANGE = ParameterRange(
    -6.0, 6.0, "m", "from the rear axle to the front of a van; a longer vehicle needs --lever-arm"
)
"""Range of the lever arm ahead, m; its field `source` gives the reason."""
WHITE_NOISE_RANGE_BY_KIND: Mapping[Kind, ParameterRange] = {
    Kind.POSITION: ParameterRange(
        0.0, 30.0, "m", "a phone's fix by cells and wireless networks; GNSS alone has 1 to 5 m"
    ),
    Kind.VELOCITY: ParameterRange(0.0, 3.0, "m/s", "ten times that of a GNSS velocity by Doppler shifts in a town"),
    Kind.SPEED: ParameterRange(0.0, 3.0, "m/s", "ten times the 1 km/h to which a bus rounds a speed"),
    Kind.HEADING: ParameterRange(0.0, 0.5, "rad", "a magnetic compass beside a car's iron errs by up to 30 degrees"),
    Kind.ACCEL: ParameterRange(0.0, 5.0, "m/s^2", "half of gravity: an IMU on a shaking mount"),
    Kind.YAW_RATE: ParameterRange(0.0, 0.3, "rad/s", "as much as a car turns at a street corner"),
}
"""Range of the noise sigma of each kind."""


def range_of_sensor_error(name: str, kind: Kind) -> ParameterRange:
    """Return the range of an error of the sensor model, by its name in `sensor_model`, for a source of a kind."""
    if name == "slow":
        return ROAD_GRADE_ACCEL_SIGMA_RANGE if kind is Kind.ACCEL else SLOW_POSITION_SIGMA_RANGE
    return {
        "scale": SPEED_SCALE_RANGE,
        "lever": ESTIMATED_POINT_ABOVE_SPEED_POINT_RANGE,
        "ahead": LONGITUDINAL_LEVER_ARM_RANGE,
    }[name]
