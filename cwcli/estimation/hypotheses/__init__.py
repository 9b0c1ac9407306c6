"""What may be wrong with all rows of a source: one file for each kind of measurement, one line for each hypothesis."""

from __future__ import annotations

from collections.abc import Mapping

from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.hypotheses.heading import HEADING_UNIT_AND_CONVENTION_HYPOTHESES
from cwcli.estimation.hypotheses.imu import IMU_UNIT_SIGN_AND_AXES_HYPOTHESES
from cwcli.estimation.hypotheses.position import POSITION_AXES_HYPOTHESES
from cwcli.estimation.hypotheses.speed import SPEED_UNIT_AND_SIGN_HYPOTHESES
from cwcli.estimation.hypotheses.velocity import VELOCITY_UNIT_AND_AXES_HYPOTHESES
from cwcli.estimation.hypotheses.yaw_rate import YAW_RATE_UNIT_AND_SIGN_HYPOTHESES
from cwcli.estimation.measurements import Kind

UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND: Mapping[Kind, tuple[Hypothesis, ...]] = {
    Kind.POSITION: POSITION_AXES_HYPOTHESES,
    Kind.VELOCITY: VELOCITY_UNIT_AND_AXES_HYPOTHESES,
    Kind.SPEED: SPEED_UNIT_AND_SIGN_HYPOTHESES,
    Kind.HEADING: HEADING_UNIT_AND_CONVENTION_HYPOTHESES,
    Kind.YAW_RATE: YAW_RATE_UNIT_AND_SIGN_HYPOTHESES,
    Kind.IMU: IMU_UNIT_SIGN_AND_AXES_HYPOTHESES,
}
"""Kind -> hypotheses, as `--as SOURCE=NAME` takes them; names of different groups can be joined by "+"."""
