"""The collision rules: one file each, and one line here. Other packages add theirs in the group `cwcli.rules`."""

from __future__ import annotations

from cwcli.registry import Registry, plugin_entry
from cwcli.warning.rules.base import Rule, check_decision

RULES: Registry[Rule] = Registry(
    "warning rule",
    "cwcli.rules",
    {
        "cwcli": "cwcli.warning.rules.cwcli:RULE",
        "song2016": "cwcli.warning.rules.song2016:RULE",
        "ttc": "cwcli.warning.rules.ttc:RULE",
        "path-ttc": "cwcli.warning.rules.path_ttc:RULE",
    },
    plugin_entry(Rule, {"decide": check_decision}),
    taken=("lane-departure",),
)
DEFAULT_RULE = "cwcli"
