"""The generated parts of docs/evaluation.md: the list of metrics and the grammar of gates."""

from __future__ import annotations

from cwcli.cli.markdown import filled


def evaluation_page(text: str) -> str:
    """The page with its generated parts as they are now."""
    return filled(filled(text, "metrics", _metrics()), "grammar", _grammar())


def _metrics() -> str:
    from cwcli.metrics.headline import METRICS

    rows = ["| metric | unit | pool | better | what it is |", "|---|---|---|---|---|"]
    for metric in METRICS:
        name = f"**`{metric.name}`**" if metric.is_compared else f"`{metric.name}`"
        better = f"near {metric.target:g}" if metric.better == "near" else metric.better
        rows.append(f"| {name} | {metric.unit} | {metric.pool} | {better} | {metric.doc} |")
    return "\n".join(rows)


def _grammar() -> str:
    from cwcli.metrics import gate_syntax

    lines = (gate_syntax.__doc__ or "").splitlines()
    return "\n".join(f"    {line.strip()}" for line in lines if " = " in line)
