"""The measures of two vehicles, by what they really did: one file each, and one line here.

Other packages add theirs in the group `cwcli.measures`. Tables, definitions of a conflict, the report's words, the help
and docs/measures.md take them from here.
"""

from __future__ import annotations

from cwcli.measures.base import Measure, check_values, is_column_of
from cwcli.registry import Plugin, Registry, plugin_entry


def _accept(entry: object, plugin: Plugin) -> Measure:
    """A plug-in's measure, with its functions guarded, and a column that no other measure has."""
    measure = plugin_entry(Measure, {"of": check_values})(entry, plugin)
    if not is_column_of(plugin.name, measure.column):
        raise plugin.error(f"calls its column {measure.column}, not by its own name and a unit")
    return measure


MEASURES: Registry[Measure] = Registry(
    "measure",
    "cwcli.measures",
    {
        "distance": "cwcli.measures.distance:MEASURE",
        "gap": "cwcli.measures.gap:MEASURE",
        "ttc": "cwcli.measures.ttc:MEASURE",
        "pet": "cwcli.measures.pet:MEASURE",
        "drac": "cwcli.measures.drac:MEASURE",
    },
    _accept,
)
