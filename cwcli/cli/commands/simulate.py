"""`cwcli simulate`."""

from __future__ import annotations

from typing import Annotated

from cwcli.cli.console import Console, replace_stdout_path_by_dash
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ForceOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.tables import format_table
from cwcli.cli.text import escape_control_characters, wrap_paragraph
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.library.simulated import simulate_log
from cwcli.simulation.catalogue import scenario_names
from cwcli.simulation.road.names import ROAD_SCENARIOS, WEATHER_NAMES
from cwcli.work_share import part_of_work, report_work_share_to

EXAMPLES = (
    "cwcli simulate intersection -o intersection.mcap",
    "cwcli simulate rear-end --seed 7 --set host.speed_mps=15 -o - | cwcli run -",
    "cwcli simulate road --weather rain --seed 3 --set size=640x480 -o road.mcap",
    "cwcli simulate departure --set drift=0.3 -o departure.mcap",
    "cwcli simulate xiang2019-turn -o - | cwcli track - --filter ukf",
    "cwcli simulate rear-end --actors log.mcap --set v2x.delay_s=0.3 -o late.mcap",
)
"""Command lines at the end of the command's `--help`."""


def _complete_scenarios(incomplete: str) -> list[str]:
    return [name for name in (*scenario_names(), *ROAD_SCENARIOS) if name.startswith(incomplete)]


def _complete_weathers(incomplete: str) -> list[str]:
    return [name for name in WEATHER_NAMES if name.startswith(incomplete)]


@dataclass(frozen=True)
class ChangeOptions:
    """What is other than in the scenario."""

    seed: Annotated[
        int | None,
        typer.Option("--seed", metavar="N", show_default="the scenario's own", help="Seed of all random draws."),
    ] = None
    override: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a value of the scenario. Repeatable.")
    ] = None
    weather: Annotated[
        str | None,
        typer.Option(
            "--weather",
            metavar="NAME",
            show_default="clear",
            autocompletion=_complete_weathers,
            help=f"Weather of a rendered drive: {', '.join(WEATHER_NAMES)}.",
        ),
    ] = None
    actors: Annotated[
        str | None,
        typer.Option(
            "--actors",
            metavar="LOG",
            show_default="the scenario's vehicles",
            help="Drive the vehicles of this annotated log as they were recorded, with the sensors and the V2X link of "
            "the scenario.",
        ),
    ] = None


def command(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            autocompletion=_complete_scenarios,
            help=f"A scenario: {', '.join(scenario_names())}; or a scenario file; or a rendered drive with "
            f"camera frames of a lane: {', '.join(ROAD_SCENARIOS)}.",
        ),
    ],
    talk: TalkOptions,
    change: ChangeOptions,
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="FILE", help="Write the log here; - is standard output.")
    ] = None,
    force: ForceOption = False,
) -> None:
    """Make a log with known truth from a scenario.

    The same scenario and seed give the same bytes.
    """
    output = replace_stdout_path_by_dash(output)
    if output is None:
        raise UsageError("simulate needs a file to write", hint="name it with -o; - is standard output")
    if output == "-" and talk.json:
        raise UsageError("--json and -o - both want standard output", hint="write the log to a file")
    with (
        Progress(quiet=talk.quiet) as progress,
        report_work_share_to(progress.show_share),
        part_of_work(0.0, 1.0, "messages"),
    ):
        progress.begin_step(f"simulating {scenario}")
        simulated = simulate_log(
            scenario,
            output,
            seed=change.seed,
            overrides=tuple(change.override or ()),
            weather=change.weather,
            actors=change.actors,
            force=force,
        )
    if talk.json:
        document = {
            "scenario": simulated.scenario,
            "seed": simulated.seed,
            "output": output,
            "channels": [
                {"topic": entry.topic, "schema": entry.schema_name, "messages": entry.n_messages, "lost": entry.n_lost}
                for entry in simulated.channels
            ],
        }
        Console(quiet=talk.quiet).print_document("simulate", document)
        return
    console = Console(quiet=talk.quiet, summary_to_stderr=output == "-")
    console.print_heading(f"simulate {simulated.scenario}")
    console.print_summary(wrap_paragraph(escape_control_characters(simulated.description)))
    console.print_summary("")
    rows = [(entry.topic, entry.schema_name, entry.n_messages, entry.n_lost) for entry in simulated.channels]
    console.print_summary(format_table(("topic", "schema", "messages", "messages lost on the link"), rows))
    console.print_summary("")
    print_written_files(console, [output] if output != "-" else [])
