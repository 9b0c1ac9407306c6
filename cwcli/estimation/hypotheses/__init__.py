"""What may be wrong with all rows of a source: one file for each kind of measurement, one line for each hypothesis."""

from __future__ import annotations

from collections.abc import Mapping

from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.hypotheses.heading import HEADING
from cwcli.estimation.hypotheses.imu import IMU
from cwcli.estimation.hypotheses.position import POSITION
from cwcli.estimation.hypotheses.speed import SPEED
from cwcli.estimation.hypotheses.velocity import VELOCITY
from cwcli.estimation.hypotheses.yaw_rate import YAW_RATE
from cwcli.estimation.measurements import Kind

HYPOTHESES: Mapping[Kind, tuple[Hypothesis, ...]] = {
    Kind.POSITION: POSITION,
    Kind.VELOCITY: VELOCITY,
    Kind.SPEED: SPEED,
    Kind.HEADING: HEADING,
    Kind.YAW_RATE: YAW_RATE,
    Kind.IMU: IMU,
}
"""Kind -> hypotheses, as `--as SOURCE=NAME` takes them; names of different groups can be joined by "+"."""
