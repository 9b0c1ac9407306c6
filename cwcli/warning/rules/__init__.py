"""The collision rules: one file each, and one line here. Other packages add theirs in the group `cwcli.rules`."""

from __future__ import annotations

from cwcli.registry import Plugin, Registry, plugin_entry
from cwcli.warning.rule_inputs import problem_of
from cwcli.warning.rules.base import Rule, check_decision


def _accept(entry: object, plugin: Plugin) -> Rule:
    """Check a plug-in's rule, its measures and its words, guard its function, and return it."""
    rule = plugin_entry(Rule, {"decide": check_decision})(entry, plugin)
    problem = problem_of(rule.measures)
    if problem:
        raise plugin.error(problem)
    try:
        rule.words.format(other="")
    except (ValueError, LookupError, AttributeError):
        raise plugin.error(f"has words = {rule.words!r}, where {{other}} alone may stand in braces") from None
    return rule


RULES: Registry[Rule] = Registry(
    "warning rule",
    "cwcli.rules",
    {
        "cwcli": "cwcli.warning.rules.cwcli:RULE",
        "song2016": "cwcli.warning.rules.song2016:RULE",
        "ttc": "cwcli.warning.rules.ttc:RULE",
        "path-ttc": "cwcli.warning.rules.path_ttc:RULE",
        "eebl": "cwcli.warning.rules.eebl:RULE",
    },
    _accept,
    taken=("lane-departure",),
)
DEFAULT_RULE = "cwcli"
"""Name of the rule that is used where the user names none."""
