"""The generated parts of docs/evaluation.md: the list of metrics, the grammars of gates and conditions."""

from __future__ import annotations

import re
from types import ModuleType

from cwcli.cli.markdown import replace_marked_block


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
    for metric in METRICS:
        name = f"**`{metric.name}`**" if metric.is_compared else f"`{metric.name}`"
        better = f"near {metric.target:g}" if metric.better == "near" else metric.better
        rows.append(f"| {name} | {metric.unit} | {metric.pool} | {better} | {metric.doc} |")
    return "\n".join(rows)


def _grammar(module: ModuleType) -> str:
    """The rules in a module's docstring."""
    lines = (module.__doc__ or "").splitlines()
    return "\n".join(f"    {line.strip()}" for line in lines if re.match(r"\w+ += ", line))
