"""The collision rules: one file each, and one line here. Other packages add theirs in the group `cwcli.rules`."""

from __future__ import annotations

from cwcli.registry import Plugin, Registry, accept_dataclass_of
from cwcli.warning.rule_inputs import describe_problem_with_measure_names
from cwcli.warning.rules.base import Rule, check_decision


def _accept_plugin_rule(entry: object, plugin: Plugin) -> Rule:
    """Check a plug-in's rule, its measures and its words, guard its function, and return it."""
    rule = accept_dataclass_of(Rule, {"decide": check_decision})(entry, plugin)
    problem = describe_problem_with_measure_names(rule.measures)
    if problem:
        raise plugin.plugin_error(problem)
    try:
        rule.words.format(other="")
    except (ValueError, LookupError, AttributeError):
        raise plugin.plugin_error(f"has words = {rule.words!r}, where {{other}} alone may stand in braces") from None
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
    _accept_plugin_rule,
    reserved_names=("lane-departure",),
)
DEFAULT_RULE = "cwcli"
"""Name of the rule that is used where the user names none."""
