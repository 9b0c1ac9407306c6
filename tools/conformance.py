"""Writes the generated part of docs/conformance.md: every clause with each rule, and the failures of the default.

python -m tools.conformance              # as many repetitions as each clause says; minutes
python -m tools.conformance --seeds 10 nhtsa-fcw un-r131   # these rows alone
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


def clause_block(results: dict[str, list[ClauseResult]], before: str = "") -> str:
    """The tables: one row a clause, then one row a failed trial of the default; other clauses' rows stay as before."""
    measured = {result.clause.name for result in results[DEFAULT_RULE]}
    kept = [tuple(cell.strip() for cell in line.strip("| ").split(" | ")) for line in before.splitlines()]
    kept = [row for row in kept if row[0] in set(clause_names()) - measured]
    rows = [row for row in kept if len(row) == len(COLUMNS)]
    for of_rules in zip(*(results[rule] for rule in RULES), strict=True):
        clause = of_rules[0].clause
        cells = [_cell(result) for result in of_rules]
        is_of_lanes = all(trial.scene == LANE_SCENE for trial in clause.trials)
        of_all = ["-"] * len(RULES) + cells[:1] if is_of_lanes else [*cells, "-"]
        basis = clause.basis_text.removeprefix("numbers ")
        rows.append((clause.name, basis, str(of_rules[0].n_repetitions), *of_all))
    failures = [row for row in kept if len(row) != len(COLUMNS)]
    failures += [
        (result.clause.name, trial.trial.name, trial.margin_text, trial.worst_repetition.verdict.text)
        for result in results[DEFAULT_RULE]
        for trial in result.trials
        if trial.outcome == FAILED and trial.worst_repetition is not None and trial.worst_repetition.verdict is not None
    ]
    return "\n\n".join(
        [
            format_markdown_table(COLUMNS, sorted(rows)),
            "What the default fails:",
            format_markdown_table(("clause", "trial", "worst margin", "what happened"), sorted(failures)),
        ]
    )


def _cell(result: ClauseResult) -> str:
    """Outcome, trials passed, and the worst margin."""
    margin = f", {result.worst_margin_text}" if result.worst_margin_text else ""
    return f"{result.outcome}, {result.passed_text}{margin}"


def main() -> None:
    """Run every clause with every rule, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clauses", nargs="*", default=clause_names(), help="clauses that are run; all without one")
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cache", help="folder of finished repetitions")
    options = parser.parse_args()
    hide_plugins()
    cache = RepetitionCache(options.cache) if options.cache else None
    config = ConformConfig(options.seeds, options.jobs)
    write_page(run_clauses_with_rules(options.clauses, config, RULES, cache=cache))


def write_page(results: dict[str, list[ClauseResult]]) -> None:
    """Write the rows of the clauses that were run into the page."""
    text = PAGE.read_text(encoding="utf-8")
    block = text.partition("<!-- clauses -->")[2].partition("<!-- end -->")[0]
    PAGE.write_text(replace_marked_block(text, "clauses", clause_block(results, block)), encoding="utf-8")


if __name__ == "__main__":
    main()
