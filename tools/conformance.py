"""Writes the generated part of docs/conformance.md: every clause with each rule, and the failures of the default.

python -m tools.conformance              # as many repetitions as each clause says; minutes
python -m tools.conformance --seeds 10
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cwcli.cli.markdown import format_markdown_table, replace_marked_block
from cwcli.conformance.cache import RepetitionCache
from cwcli.conformance.clause import clause_names, load_clause
from cwcli.conformance.results import FAILED, ClauseResult
from cwcli.conformance.run import ConformConfig, run_clauses
from cwcli.registry import hide_plugins
from cwcli.warning.rules import DEFAULT_RULE

PAGE = Path(__file__).parents[1] / "docs" / "conformance.md"
RULES = (DEFAULT_RULE, "song2016", "ttc", "path-ttc")
LANE_SCENE = "lane-drift"
MAX_COMPARED_TRIALS = 10
"""Number of trials up to which other rules run a clause; larger grids would take most of the time."""
COLUMNS = ("clause", *RULES)


def clause_block(results: dict[str, dict[str, ClauseResult]]) -> str:
    """The tables: one row a clause, then one row a failed trial of the default."""
    rows = []
    for name in clause_names():
        is_of_lanes = all(trial.scene == LANE_SCENE for trial in load_clause(name).trials)
        cells = [_cell(results.get(column, {}).get(name)) for column in COLUMNS[1:]]
        rows.append((name, f"{cells[0]} (lane departure)" if is_of_lanes else cells[0], *cells[1:]))
    failures = [
        (name, trial.trial.name, trial.margin_text, trial.worst.verdict.text)
        for name, result in results[DEFAULT_RULE].items()
        for trial in result.trials
        if trial.outcome == FAILED and trial.worst is not None and trial.worst.verdict is not None
    ]
    return "\n\n".join(
        [
            format_markdown_table(COLUMNS, rows),
            "What the default fails:",
            format_markdown_table(("clause", "trial", "worst margin", "what happened"), failures),
        ]
    )


def _cell(result: ClauseResult | None) -> str:
    """Outcome, trials passed, and the worst margin."""
    if result is None:
        return ""
    driven = result.driven_trials
    passed = sum(trial.outcome == "pass" for trial in driven)
    margin = "" if result.worst_trial is None else f", {result.worst_trial.margin_text}"
    return f"{result.outcome}, {passed} of {len(driven)}{margin}".removesuffix(", ")


def _is_compared(name: str) -> bool:
    """Whether other rules run a clause too: one about pairs of vehicles, and no large grid."""
    trials = load_clause(name).trials
    return len(trials) <= MAX_COMPARED_TRIALS and any(trial.scene != LANE_SCENE for trial in trials)


def main() -> None:
    """Run every clause with every rule, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cache", help="folder of finished repetitions")
    options = parser.parse_args()
    hide_plugins()
    others = [name for name in clause_names() if _is_compared(name)]
    results: dict[str, dict[str, ClauseResult]] = {}
    for column in COLUMNS[1:]:
        names = list(clause_names()) if column == DEFAULT_RULE else others
        config = ConformConfig(options.seeds, options.jobs, column)
        cache = RepetitionCache(options.cache) if options.cache else None
        results[column] = {found.clause.name: found for found in run_clauses(names, config, cache=cache)}
        print(f"{column} is done", flush=True)
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(replace_marked_block(text, "clauses", clause_block(results)), encoding="utf-8")


if __name__ == "__main__":
    main()
