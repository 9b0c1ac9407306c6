"""What was found of the sources against what such sensors can be: the last check, of the estimate's own numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from cwcli.estimation.contradiction import Contradiction, Quantity
from cwcli.estimation.measurements import Kind
from cwcli.estimation.result import SourceReport
from cwcli.estimation.sensor_limits import (
    ACCEL_BIAS, AHEAD, GRADE_SIGMA, LATENCY, SLOW_POSITION_SIGMA, SPEED_LEVER_ARM, SPEED_SCALE, STAMP_SIGMA,
    WHITE_NOISE, YAW_RATE_BIAS, Limit,
)  # fmt: skip


def beyond_limits(reports: Sequence[SourceReport]) -> tuple[Contradiction, ...]:
    return ()
