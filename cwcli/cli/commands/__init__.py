"""The commands: those of stages are generated from the table of stages, each other one has a module here.

A module holds `command`, whose docstring is the help, and `EXAMPLES`. Importing this table imports none of them.
"""

from __future__ import annotations

from cwcli.stages import STAGES

HELP_LINE_BY_COMMAND = {
    "import": "Make a log of files that are no logs: CSV, GPX, NMEA and others.",
    "info": "List what a log holds and what cwcli can do with it.",
    **{name: stage.help for name, stage in STAGES.items()},
    "cut": "Write a part of a log: a span of time, some topics, or both.",
    "join": "Make one log of two cars' logs.",
    "calibrate": "Find the constants of a car's sensors from many drives.",
    "run": "Run every stage that a log, or each of many, has the signals for.",
    "merge": "Merge the shards of a run into one output folder.",
    "config": "Print a pipeline file with every option resolved and checked.",
    "evaluate": "Score one log or many, and check gates.",
    "find": "Find moments in logs: named events, or expressions over time.",
    "compare": "Say what got better and what got worse between two runs.",
    "report": "Make one HTML page of a run, or of one annotated log.",
    "simulate": "Make a log with known truth from a scenario.",
    "reproduce": "Reproduce a paper's tables and figures, and compare the numbers.",
    "conform": "Judge warnings by the trials of public standards.",
    "export": "Write states, paths, warnings or measures as a file of another tool.",
    "plot": "Draw one plot of an annotated log as an image.",
    "view": "Show an annotated log in Rerun, or write a recording for it.",
    "layout": "Make a viewer layout that shows every channel of cwcli.",
    "demo": "Estimate, predict and warn on two bundled logs.",
}
"""Name of a command -> its line of help, in the order of `cwcli --help`."""
