"""`cwcli simulate`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from cwcli import __version__
from cwcli.cli.console import Console, stdout_or_file
from cwcli.cli.options.shared import ForceOption, TalkOptions
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written
from cwcli.cli.tables import table
from cwcli.cli.text import paragraph, printable
from cwcli.errors import UsageError
from cwcli.simulation.scenario import scenario_names

EXAMPLES = (
    "cwcli simulate intersection -o intersection.mcap",
    "cwcli simulate rear-end --seed 7 --set host.speed_mps=15 -o - | cwcli run -",
)


def _names(incomplete: str) -> list[str]:
    return [name for name in scenario_names() if name.startswith(incomplete)]


def command(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            show_default=False,
            autocompletion=_names,
            help=f"A scenario: {', '.join(scenario_names())}; or a scenario file.",
        ),
    ],
    talk: TalkOptions,
    output: Annotated[
        str | None,
        typer.Option(
            "--output", "-o", metavar="FILE", show_default=False, help="Write the log here; - is standard output."
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option("--seed", metavar="N", show_default="the scenario's own", help="Seed of all random draws."),
    ] = None,
    override: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", show_default=False, help="Change a value of the scenario. Repeatable."
        ),
    ] = None,
    force: ForceOption = False,
) -> None:
    """Make a log with known truth from a scenario.

    The same scenario and seed give the same bytes.
    """
    output = stdout_or_file(output)
    if output is None:
        raise UsageError("simulate needs a file to write", hint="name it with -o; - is standard output")
    if output == "-" and talk.json:
        raise UsageError("--json and -o - both want standard output", hint="write the log to a file")
    if seed is not None and seed < 0:
        raise UsageError(f"--seed {seed} must not be negative")
    from cwcli.output import check_target
    from cwcli.simulation.drive import simulate
    from cwcli.simulation.scenario import load_scenario
    from cwcli.stages.simulate import write_log

    check_target(output, force=force, inputs=[Path(scenario)] if Path(scenario).is_file() else [])
    with Progress(quiet=talk.quiet) as progress:
        progress.step(f"simulating {scenario}")
        drive = simulate(load_scenario(scenario, tuple(override or ())), seed)
        written = write_log(drive, output, force=force)
    if talk.json:
        document = {
            "cwcli": __version__,
            "command": "simulate",
            "scenario": drive.scenario.name,
            "seed": drive.seed,
            "output": output,
            "channels": [
                {"topic": entry.topic, "schema": entry.schema_name, "messages": entry.n_messages, "lost": entry.n_lost}
                for entry in written
            ],
        }
        typer.echo(json.dumps(document, indent=2))
        return
    console = Console(quiet=talk.quiet, summary_to_stderr=output == "-")
    console.heading(f"simulate {drive.scenario.name}")
    about = f"{drive.scenario.description}; seed {drive.seed}, {drive.scenario.duration_s:g} s"
    console.summary(paragraph(printable(about)))
    console.summary("")
    rows = [(entry.topic, entry.schema_name, entry.n_messages, entry.n_lost) for entry in written]
    console.summary(table(("topic", "schema", "messages", "lost on the link"), rows))
    console.summary("")
    print_written(console, [output] if output != "-" else [])
