"""The measures of two vehicles by their actual motion: one file each or each family, and one line each here.

Other packages add theirs in the group `cwcli.measures`. Tables, definitions of a conflict, the report, the help and
docs/measures.md take them from here.
"""

from __future__ import annotations

from cwcli.measures.base import Measure, is_column_named_by_measure, require_one_value_per_stamp_or_one
from cwcli.registry import Plugin, Registry, accept_dataclass_of


def _accept_plugin_measure(entry: object, plugin: Plugin) -> Measure:
    """Check a plug-in's measure, guard its function, and return it; its column must be named after it."""
    measure = accept_dataclass_of(Measure, {"compute": require_one_value_per_stamp_or_one})(entry, plugin)
    if not is_column_named_by_measure(plugin.name, measure.column):
        raise plugin.plugin_error(f"calls its column {measure.column}, not by its own name and a unit")
    return measure


MEASURES: Registry[Measure] = Registry(
    "measure",
    "cwcli.measures",
    {
        "distance": "cwcli.measures.distance:MEASURE",
        "gap": "cwcli.measures.gap:MEASURE",
        "ttc": "cwcli.measures.ttc:MEASURE",
        "mttc": "cwcli.measures.mttc:MEASURE",
        "pttc": "cwcli.measures.pttc:MEASURE",
        "ittc": "cwcli.measures.ittc:MEASURE",
        "ttc-star": "cwcli.measures.ttc_star:MEASURE",
        "ttce": "cwcli.measures.ttce:MEASURE",
        "dce": "cwcli.measures.dce:MEASURE",
        "headway": "cwcli.measures.headway:MEASURE",
        "thw": "cwcli.measures.thw:MEASURE",
        "wttc": "cwcli.measures.wttc:MEASURE",
        "ttb": "cwcli.measures.time_to_react:TTB",
        "ttk": "cwcli.measures.time_to_react:TTK",
        "tts": "cwcli.measures.time_to_react:TTS",
        "ttr": "cwcli.measures.time_to_react:TTR",
        "pet": "cwcli.measures.pet:MEASURE",
        "ppet": "cwcli.measures.ppet:MEASURE",
        "et": "cwcli.measures.et:MEASURE",
        "gap-time": "cwcli.measures.gap_time:MEASURE",
        "tet": "cwcli.measures.exposure:TET",
        "tit": "cwcli.measures.exposure:TIT",
        "drac": "cwcli.measures.drac:MEASURE",
        "mdrac": "cwcli.measures.mdrac:MEASURE",
        "a-long-req": "cwcli.measures.a_long_req:MEASURE",
        "a-lat-req": "cwcli.measures.a_lat_req:MEASURE",
        "a-req": "cwcli.measures.a_req:MEASURE",
        "btn": "cwcli.measures.btn:MEASURE",
        "stn": "cwcli.measures.stn:MEASURE",
        "dst": "cwcli.measures.dst:MEASURE",
        "msd": "cwcli.measures.msd:MEASURE",
        "psd": "cwcli.measures.psd:MEASURE",
        "picud": "cwcli.measures.picud:MEASURE",
        "crash-index": "cwcli.measures.crash_index:MEASURE",
        "delta-v": "cwcli.measures.delta_v:MEASURE",
        "cpi": "cwcli.measures.cpi:MEASURE",
        "ci": "cwcli.measures.ci:MEASURE",
        "long-jerk": "cwcli.measures.jerk:LONG_JERK",
        "lat-jerk": "cwcli.measures.jerk:LAT_JERK",
        "rss-long": "cwcli.measures.rss_long:MEASURE",
        "rss-lat": "cwcli.measures.rss_lat:MEASURE",
        "rss-response": "cwcli.measures.rss_response:MEASURE",
        "p-mc": "cwcli.measures.p_mc:MEASURE",
        "p-contact": "cwcli.measures.p_contact:MEASURE",
        "pfs": "cwcli.measures.fuzzy_safety:PFS",
        "cfs": "cwcli.measures.fuzzy_safety:CFS",
    },
    _accept_plugin_measure,
)
