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
        "distance": "cwcli.measures.distances:DISTANCE",
        "gap": "cwcli.measures.distances:GAP",
        "ttc": "cwcli.measures.collision_time:TTC",
        "mttc": "cwcli.measures.collision_time:MTTC",
        "pttc": "cwcli.measures.collision_time:PTTC",
        "ittc": "cwcli.measures.collision_time:ITTC",
        "ttc-star": "cwcli.measures.collision_time:TTC_STAR",
        "ttce": "cwcli.measures.closest_encounter:TTCE",
        "dce": "cwcli.measures.closest_encounter:DCE",
        "headway": "cwcli.measures.distances:HEADWAY",
        "thw": "cwcli.measures.distances:THW",
        "wttc": "cwcli.measures.collision_time:WTTC",
        "ttb": "cwcli.measures.time_to_react:TTB",
        "ttk": "cwcli.measures.time_to_react:TTK",
        "tts": "cwcli.measures.time_to_react:TTS",
        "ttr": "cwcli.measures.time_to_react:TTR",
        "pet": "cwcli.measures.encroachment:PET",
        "ppet": "cwcli.measures.crossing:PPET",
        "et": "cwcli.measures.encroachment:ET",
        "gap-time": "cwcli.measures.crossing:GAP_TIME",
        "pri": "cwcli.measures.crossing:PRI",
        "tet": "cwcli.measures.exposure:TET",
        "tit": "cwcli.measures.exposure:TIT",
        "drac": "cwcli.measures.deceleration:DRAC",
        "mdrac": "cwcli.measures.deceleration:MDRAC",
        "a-long-req": "cwcli.measures.required_acceleration:A_LONG_REQ",
        "a-lat-req": "cwcli.measures.required_acceleration:A_LAT_REQ",
        "a-req": "cwcli.measures.required_acceleration:A_REQ",
        "btn": "cwcli.measures.required_acceleration:BTN",
        "stn": "cwcli.measures.required_acceleration:STN",
        "dst": "cwcli.measures.deceleration:DST",
        "msd": "cwcli.measures.stopping_distance:MSD",
        "contact-psd": "cwcli.measures.stopping_distance:CONTACT_PSD",
        "picud": "cwcli.measures.stopping_distance:PICUD",
        "crash-index": "cwcli.measures.severity:CRASH_INDEX",
        "delta-v": "cwcli.measures.severity:DELTA_V",
        "cpi": "cwcli.measures.cpi:MEASURE",
        "ci": "cwcli.measures.severity:CI",
        "long-jerk": "cwcli.measures.jerk:LONG_JERK",
        "lat-jerk": "cwcli.measures.jerk:LAT_JERK",
        "rss-long": "cwcli.measures.safe_distance:RSS_LONG",
        "rss-lat": "cwcli.measures.safe_distance:RSS_LAT",
        "rss-response": "cwcli.measures.safe_distance:RSS_RESPONSE",
        "p-mc": "cwcli.measures.p_mc:MEASURE",
        "p-contact": "cwcli.measures.p_contact:MEASURE",
        "pfs": "cwcli.measures.fuzzy_safety:PFS",
        "cfs": "cwcli.measures.fuzzy_safety:CFS",
    },
    _accept_plugin_measure,
)
