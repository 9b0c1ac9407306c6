"""`cwcli.v1.Measures`: how critical the ego and each other vehicle are to each other, moment by moment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cwcli.channels.output import output
from cwcli.channels.published import MEASURED
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.signals.columns import OutputChannel

COLUMNS = (
    "distance_m",
    "gap_m",
    "ttc_s",
    "mttc_s",
    "ttc_star_s",
    "ttce_s",
    "dce_m",
    "headway_m",
    "thw_s",
    "wttc_s",
    "ttb_s",
    "ttk_s",
    "tts_s",
    "ttr_s",
    "ppet_s",
    "gap_time_s",
    "drac_mps2",
    "mdrac_mps2",
    "a_long_req_mps2",
    "a_lat_req_mps2",
    "a_req_mps2",
    "btn",
    "stn",
    "dst_mps2",
    "msd_m",
    "psd",
    "delta_v_mps",
    "long_jerk_mps3",
    "lat_jerk_mps3",
    "rss_long_m",
    "rss_lat_m",
    "rss_response_mps2",
    "pfs",
    "cfs",
)
"""The measures of the message. Others, a package's or those that are sampled, are in the table alone."""


def write_measures(ego: VehicleStates, columns: Mapping[str, Any]) -> OutputChannel:
    """One message a moment of a pair, known when the ego's state was.

    Args:
        ego: Its states, in order of the stamps, each once.
        columns: `ego_id`, `other_id`, `stamp_ns` and the measures, n rows each; what is not computed is NaN.
    """
    stamp_ns = columns["stamp_ns"]
    unknown = np.full(len(stamp_ns), np.nan)
    fields = {name: columns[name] for name in ("stamp_ns", "ego_id", "other_id")}
    fields.update({name: columns.get(name, unknown) for name in COLUMNS})
    return output(MEASURED, ego.log_time_ns[np.searchsorted(ego.stamp_ns, stamp_ns)], fields)
