"""Options of the commands that read results of runs: evaluate, compare, report."""

from __future__ import annotations

from typing import Annotated

from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.complete import complete_system_topics

GatesOption = Annotated[
    list[str] | None,
    typer.Option(
        "--gate",
        metavar="EXPR",
        help="A condition that must hold, in addition to those of the run's manifest; for each log unless it says "
        "otherwise (docs/evaluation.md). Repeatable.",
    ),
]
TruthOption = Annotated[
    str,
    typer.Option(
        "--truth", metavar="auto|none|/TOPIC", help="The ego's truth: the log's own truth channel, none, or this topic."
    ),
]
MarkdownOption = Annotated[
    str | None,
    typer.Option("--markdown", metavar="FILE", help="Write a summary in GitHub's Markdown here; - is standard output."),
]
PageAddressOption = Annotated[
    str | None,
    typer.Option(
        "--report-at",
        metavar="PAGE",
        help="Address of the page that `cwcli report` writes for this run, e.g. report.html: --junit and "
        "--markdown link to its warnings and conflicts.",
    ),
]
GithubOption = Annotated[
    bool, typer.Option("--github", help="Print each failure on stderr as an annotation of GitHub Actions, too.")
]
AllOption = Annotated[bool, typer.Option("--all", help="Print every metric, not only the headline metrics.")]
SystemOption = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="ROLE=/NAME",
        autocompletion=complete_system_topics,
        help="Judge another system in the log too: warning=/adas/fcw:data==true, ego_path=/planning/trajectory, "
        "ego_state=/odometry (docs/evaluation.md). Repeatable.",
    ),
]
