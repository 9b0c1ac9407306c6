"""The warning rules: one file each, and one line here."""

from __future__ import annotations

from cwcli.warning.rules import cwcli, path_ttc, song2016, ttc
from cwcli.warning.rules.base import Rule

RULES: dict[str, Rule] = {
    "cwcli": cwcli.RULE,
    "song2016": song2016.RULE,
    "ttc": ttc.RULE,
    "path-ttc": path_ttc.RULE,
}
DEFAULT_RULE = "cwcli"
