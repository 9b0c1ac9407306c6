"""The generated parts of docs/evaluation.md: the list of metrics, the grammars of gates and conditions."""

from __future__ import annotations

import re
import textwrap
from types import ModuleType

from cwcli.cli.markdown import replace_marked_block

REPEATED_METRICS = {
    "ego.online_": ("ego.", "Of the online states, against the truth or else hindsight, as without `online_`"),
    "prediction.remote.": ("prediction.ego.", "Of remote vehicles, as of the ego"),
    "warnings.<rule>.": ("warnings.", "Of one of several rules, as without `<rule>.`"),
    "system.": ("", "Of another system, as without `system.`"),
}
"""Beginning of metrics that mean what others mean -> the beginning of those others, and of whom they are."""


def evaluation_page(text: str) -> str:
    """The page with its generated parts as they are now."""
    from cwcli.metrics import gate_syntax
    from cwcli.signals import field_condition

    text = replace_marked_block(text, "metrics", _metrics())
    return replace_marked_block(
        replace_marked_block(text, "grammar", _grammar(gate_syntax)), "conditions", _grammar(field_condition)
    )


def _metrics() -> str:
    from cwcli.metrics.headline import METRICS

    rows = ["| metric | unit | pool | better | what it is |", "|---|---|---|---|---|"]
    named = {metric.name for metric in METRICS}
    repeated: dict[str, list[str]] = {prefix: [] for prefix in REPEATED_METRICS}
    for metric in METRICS:
        name = f"**`{metric.name}`**" if metric.is_compared else f"`{metric.name}`"
        prefix = next((each for each in REPEATED_METRICS if metric.name.startswith(each)), "")
        if prefix and metric.name.replace(prefix, REPEATED_METRICS[prefix][0], 1) in named:
            repeated[prefix].append(name)
            continue
        better = f"near {metric.target:g}" if metric.better == "near" else metric.better
        rows.append(f"| {name} | {metric.unit} | {metric.pool} | {better} | {metric.doc} |")
    for prefix, names in repeated.items():
        text = f"{REPEATED_METRICS[prefix][1]}: {', '.join(names)}."
        rows += ["", textwrap.fill(text, 120, break_long_words=False, break_on_hyphens=False)]
    return "\n".join(rows)


def _grammar(module: ModuleType) -> str:
    """The rules in a module's docstring."""
    lines = (module.__doc__ or "").splitlines()
    return "\n".join(f"    {line.strip()}" for line in lines if re.match(r"\w+ += ", line))
