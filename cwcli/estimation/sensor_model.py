"""Errors of a source besides white noise, as states of the filter: slow errors, a scale, lever arms.

- A POSITION's errors stay for seconds (multipath, the atmosphere): a Gauss-Markov error of each axis.
- A forward accelerometer has gravity in it where the road rises: z = a + bias - g pitch. The pitch is a Gauss-Markov
  process with the time constant T that the pitch gyroscope q drives, p' = -p / T + q + w. By superposition it is the
  sum of u' = -u / T + q, which is computed beforehand and taken out of the values, and of a Gauss-Markov rest, which is
  a state. A bias stays far longer than T, so that the two part. A car that turns on a slope changes its pitch without
  a pitch rate, p' = q - yaw rate * roll; the roll is not known, and counts as noise by radian turned.
- A SPEED has a scale (the wheels' circumference) and, where the IMU has a pitch gyroscope, a lever arm: wheels a height
  l below the IMU move by l q slower while the body turns nose down. z = scale (v - l q).
- A sensor that stands ahead of the point whose course is the heading (about the rear axle) measures there: a POSITION
  p + R l, a VELOCITY v + w R (0, l), an ACCEL a - w^2 l, with the yaw rate w and l = (ahead, 0).

`sensor_search` says which of them a log shows.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import field
from typing import Literal

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.passes import MAX_PITCH_RATE_GAP_S, PitchRateSeries, SensorSeries
from cwcli.kernels.estimation import fading_integral
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

SPEED_SCALE_PRIOR_SIGMA = 0.02
"""One sigma of the scale of a speed. Chosen: tyres differ by wear, pressure and size by a couple of percent."""
IMU_HEIGHT_PRIOR_SIGMA_M = 1.0
"""One sigma of the height of an IMU above the wheels, m. Chosen: between the axles and a truck's roof."""
LEVER_ARM_AHEAD_PRIOR_SIGMA_M = 2.0
"""One sigma of the lever arm ahead, m. Chosen: an antenna stands between the front and the rear of a car."""
GRAVITY_CHANGE_SIGMA_PER_RADIAN_MPS2 = STANDARD_GRAVITY_MPS2 * 0.035
"""One sigma of the change of gravity's forward part while a car turns by a radian, m/s^2.

Chosen: roads are sloped by 2 degrees (one sigma) in both directions, and a turn on a slope causes no pitch rate."""
MAX_FILTER_STATES = 23
"""Greatest number of states: the 24 of the kernel less one that the search for a latency adds."""


SeriesIndexAndErrorName = tuple[int, Literal["slow", "scale", "lever", "ahead"]]
"""One error: the index of its series and its name."""


@dataclass(frozen=True)
class GaussMarkovError:
    """A Gauss-Markov error.

    Attributes:
        sigma: Stationary sigma in the unit of the source's kind.
        time_s: Time constant.
    """

    sigma: float
    time_s: float


@dataclass(frozen=True)
class SensorModel:
    """Selection of the modelled errors, by the index of the series.

    Attributes:
        slow: Slow errors of POSITION and ACCEL series.
        pitch_compensated: ACCEL series whose gravity is compensated with the pitch gyroscope; they have a slow error,
            too.
        scaled, levered: SPEED series with a scale, with a lever arm.
        ahead: POSITION, VELOCITY and ACCEL series that stand ahead of the point whose course is the heading.
    """

    slow: Mapping[int, GaussMarkovError] = field(default_factory=dict)
    pitch_compensated: frozenset[int] = frozenset()
    scaled: frozenset[int] = frozenset()
    levered: frozenset[int] = frozenset()
    ahead: frozenset[int] = frozenset()

    @property
    def modelled_errors(self) -> list[SeriesIndexAndErrorName]:
        """All modelled errors: index of the series and name."""
        return [
            *((i, "slow") for i in sorted(self.slow)),
            *((i, "scale") for i in sorted(self.scaled)),
            *((i, "lever") for i in sorted(self.levered)),
            *((i, "ahead") for i in sorted(self.ahead)),
        ]

    @property
    def lookup_key(self) -> Hashable:
        """What equal models have in common; unlike the models themselves it can be looked up."""
        return tuple(sorted(self.slow.items())), self.pitch_compensated, self.scaled, self.levered, self.ahead

    def without_error_of_sensor(self, error: SeriesIndexAndErrorName) -> SensorModel:
        """Return the model without one of its errors."""
        i, name = error
        if name == "slow":
            slow = {k: v for k, v in self.slow.items() if k != i}
            return replace(self, slow=slow, pitch_compensated=self.pitch_compensated - {i})
        if name == "scale":
            return replace(self, scaled=self.scaled - {i})
        if name == "ahead":
            return replace(self, ahead=self.ahead - {i})
        return replace(self, levered=self.levered - {i})


@dataclass(frozen=True)
class StateLayout:
    """Layout of the filter state: series and their parameter states.

    Attributes:
        series: With the indices of their states.
        parameters: Motion model with the states' time constants.
        walk, prior: Shape (n,): white noise behind the states (variance per second) and prior variances; zero for
            motion states.
    """

    series: list[SensorSeries]
    parameters: MotionParameters
    walk: FloatArray
    prior: FloatArray


def add_sensor_error_states(base: StateLayout, model: SensorModel) -> StateLayout:
    """Add the states of a sensor model; what does not fit into the kernel is left out.

    Args:
        base: Series with their biases as the only parameter states.
        model: Errors by the index of `base.series`.
    """
    series, walk, prior = list(base.series), base.walk.tolist(), base.prior.tolist()
    time_constant_s, turn_noise = dict(base.parameters.time_constant_s), dict(base.parameters.turn_noise)
    imu_rate = find_pitch_rate(series)

    def add(n: int, prior_variance: float, walk_variance: float, time_s: float = 0.0) -> int:
        """Lay n states of one kind behind each other; returns the first one's index, -1 where there is no room."""
        first = len(walk)
        if first + n > MAX_FILTER_STATES:
            return -1
        walk.extend([walk_variance] * n)
        prior.extend([prior_variance] * n)
        if time_s > 0.0:
            time_constant_s.update({first + k: time_s for k in range(n)})
        return first

    for i, s in enumerate(series):
        if i in model.slow and len(s):
            slow = model.slow[i]
            n = 2 if s.kind is Kind.POSITION else 1
            state = add(n, slow.sigma**2, 2.0 * slow.sigma**2 / slow.time_s, slow.time_s)
            series[i] = replace(s, slow_state=state)
            if s.kind is Kind.ACCEL and state >= 0:
                turn_noise[state] = GRAVITY_CHANGE_SIGMA_PER_RADIAN_MPS2**2
            if i in model.pitch_compensated and s.pitch_rate is not None:
                series[i] = remove_gravity_by_gyroscope_pitch(series[i], slow.time_s)
        if i in model.scaled and len(s):
            series[i] = replace(series[i], scale_state=add(1, SPEED_SCALE_PRIOR_SIGMA**2, 0.0))
        if i in model.levered and len(s) and imu_rate is not None:
            series[i] = replace(series[i], lever_state=add(1, IMU_HEIGHT_PRIOR_SIGMA_M**2, 0.0), pitch_rate=imu_rate)
        if i in model.ahead and len(s):
            series[i] = replace(series[i], ahead_state=add(1, LEVER_ARM_AHEAD_PRIOR_SIGMA_M**2, 0.0))
    parameters = replace(base.parameters, time_constant_s=time_constant_s, turn_noise=turn_noise)
    return StateLayout(series, parameters, np.array(walk), np.array(prior))


def find_pitch_rate(series: Sequence[SensorSeries]) -> PitchRateSeries | None:
    """Return the first IMU's pitch rate on the clock of the corrected stamps; None without one."""
    for s in series:
        if s.kind is Kind.ACCEL and s.pitch_rate is not None:
            return PitchRateSeries(s.pitch_rate.time_s - s.latency_s, s.pitch_rate.value_radps)
    return None


def remove_gravity_by_gyroscope_pitch(s: SensorSeries, pitch_decay_time_s: float) -> SensorSeries:
    """Subtract gravity from an ACCEL series by its pitch: the gyroscope integrated with time constant `time_s`."""
    if s.pitch_rate is None:
        return s
    rate = s.pitch_rate
    pitch = fading_integral(rate.time_s, rate.value_radps, decay_s=pitch_decay_time_s, max_gap_s=MAX_PITCH_RATE_GAP_S)
    values = s.values.copy()
    values[:, 0] += STANDARD_GRAVITY_MPS2 * np.interp(s.time_s, s.pitch_rate.time_s, pitch)
    return replace(s, values=values)
