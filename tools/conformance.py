"""Writes the generated part of docs/conformance.md: every clause with each rule, and the failures of the default.

python -m tools.conformance              # as many repetitions as each clause says; minutes
python -m tools.conformance --seeds 10
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cwcli.cli.markdown import format_markdown_table, replace_marked_block
from cwcli.conformance.cache import RepetitionCache
from cwcli.conformance.clause import clause_names
from cwcli.conformance.results import FAILED, ClauseResult
from cwcli.conformance.run import ConformConfig, run_clauses_with_rules
from cwcli.registry import hide_plugins
from cwcli.warning.rules import DEFAULT_RULE

PAGE = Path(__file__).parents[1] / "docs" / "conformance.md"
RULES = (DEFAULT_RULE, "song2016", "ttc", "path-ttc")
LANE_SCENE = "lane-drift"
LANE_COLUMN = "lane departure"
COLUMNS = ("clause", "numbers", "runs", *RULES, LANE_COLUMN)


def clause_block(results: dict[str, list[ClauseResult]]) -> str:
    """The tables: one row a clause, then one row a failed trial of the default."""
    rows = []
    for of_rules in zip(*(results[rule] for rule in RULES), strict=True):
        clause = of_rules[0].clause
        cells = [_cell(result) for result in of_rules]
        is_of_lanes = all(trial.scene == LANE_SCENE for trial in clause.trials)
        of_all = ["-"] * len(RULES) + cells[:1] if is_of_lanes else [*cells, "-"]
        basis = clause.basis_text.removeprefix("numbers ")
        rows.append((clause.name, basis, str(of_rules[0].n_repetitions), *of_all))
    failures = [
        (result.clause.name, trial.trial.name, trial.margin_text, trial.worst_repetition.verdict.text)
        for result in results[DEFAULT_RULE]
        for trial in result.trials
        if trial.outcome == FAILED and trial.worst_repetition is not None and trial.worst_repetition.verdict is not None
    ]
    return "\n\n".join(
        [
            format_markdown_table(COLUMNS, rows),
            "What the default fails:",
            format_markdown_table(("clause", "trial", "worst margin", "what happened"), failures),
        ]
    )


def _cell(result: ClauseResult) -> str:
    """Outcome, trials passed, and the worst margin."""
    margin = f", {result.worst_margin_text}" if result.worst_margin_text else ""
    return f"{result.outcome}, {result.passed_text}{margin}"


def main() -> None:
    """Run every clause with every rule, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cache", help="folder of finished repetitions")
    options = parser.parse_args()
    hide_plugins()
    cache = RepetitionCache(options.cache) if options.cache else None
    results = run_clauses_with_rules(clause_names(), ConformConfig(options.seeds, options.jobs), RULES, cache=cache)
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(replace_marked_block(text, "clauses", clause_block(results)), encoding="utf-8")


if __name__ == "__main__":
    main()
