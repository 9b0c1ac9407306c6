"""Take the acceleration of a drive that ends faster or slower than it began out of the mounting of its IMUs.

The mean specific force of a drive holds, beside gravity g, its mean forward acceleration a = (v_end - v_start) / T.
That turns it by atan(a / g) in the vertical plane ahead. From 0 to 20 m/s in 20 s it looks like a mount that is tilted
by 5.8 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from cwcli.estimation.result import SourceReport
from cwcli.lazy_dataclass import replace
from cwcli.signals.columns import Int64Array, StateRows
from cwcli.signals.units import NS_PER_S, STANDARD_GRAVITY_MPS2
from cwcli.signals.vehicle_state import SPEED


def reports_without_net_acceleration(
    reports: Sequence[SourceReport], stamp_ns: Int64Array, state: StateRows
) -> tuple[SourceReport, ...]:
    """Return the reports with mountings that hold gravity alone.

    Args:
        reports: Reports whose mountings were found by the mean specific force of the drive.
    """
    duration_s = float(stamp_ns[-1] - stamp_ns[0]) / NS_PER_S if len(stamp_ns) else 0.0
    if not duration_s > 0.0:
        return tuple(reports)
    mean_accel_mps2 = float(state[-1, SPEED] - state[0, SPEED]) / duration_s
    turn_rad = math.atan2(mean_accel_mps2, STANDARD_GRAVITY_MPS2)
    return tuple(
        replace(r, mounting=replace(r.mounting, nose_up_rad=r.mounting.nose_up_rad - turn_rad)) if r.mounting else r
        for r in reports
    )
