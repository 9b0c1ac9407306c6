"""What may be wrong with all rows of a source: one file for each kind of measurement, one line for each hypothesis."""

from __future__ import annotations

from collections.abc import Mapping

from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.hypotheses.heading import HEADING_HYPOTHESES
from cwcli.estimation.hypotheses.imu import IMU_HYPOTHESES
from cwcli.estimation.hypotheses.position import POSITION_HYPOTHESES
from cwcli.estimation.hypotheses.speed import SPEED_HYPOTHESES
from cwcli.estimation.hypotheses.velocity import VELOCITY_HYPOTHESES
from cwcli.estimation.hypotheses.yaw_rate import YAW_RATE_HYPOTHESES
from cwcli.estimation.measurements import Kind

HYPOTHESES: Mapping[Kind, tuple[Hypothesis, ...]] = {
    Kind.POSITION: POSITION_HYPOTHESES,
    Kind.VELOCITY: VELOCITY_HYPOTHESES,
    Kind.SPEED: SPEED_HYPOTHESES,
    Kind.HEADING: HEADING_HYPOTHESES,
    Kind.YAW_RATE: YAW_RATE_HYPOTHESES,
    Kind.IMU: IMU_HYPOTHESES,
}
"""Kind -> hypotheses, as `--as SOURCE=NAME` takes them; names of different groups can be joined by "+"."""
