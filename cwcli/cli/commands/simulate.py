"""`cwcli simulate`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from cwcli.cli.console import Console, normalise_stdout_name
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ForceOption
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.tables import format_table
from cwcli.cli.text import escape_control_characters, wrap_paragraph
from cwcli.errors import UsageError
from cwcli.simulation.catalogue import scenario_names
from cwcli.simulation.road.names import WEATHER_NAMES

if TYPE_CHECKING:
    from cwcli.simulate.sensor_log import WrittenChannel

ROAD_SCENARIO = "road"
"""Name that selects a rendered drive on a road instead of a scenario."""

EXAMPLES = (
    "cwcli simulate intersection -o intersection.mcap",
    "cwcli simulate rear-end --seed 7 --set host.speed_mps=15 -o - | cwcli run -",
    "cwcli simulate road --weather rain --seed 3 --set size=640x480 -o road.mcap",
)
"""Command lines at the end of the command's `--help`."""


def _complete_scenarios(incomplete: str) -> list[str]:
    return [name for name in (*scenario_names(), ROAD_SCENARIO) if name.startswith(incomplete)]


def _complete_weathers(incomplete: str) -> list[str]:
    return [name for name in WEATHER_NAMES if name.startswith(incomplete)]


def command(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            show_default=False,
            autocompletion=_complete_scenarios,
            help=f"A scenario: {', '.join(scenario_names())}; or a scenario file; or {ROAD_SCENARIO}: camera frames "
            "of a lane.",
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
    weather: Annotated[
        str | None,
        typer.Option(
            "--weather",
            metavar="NAME",
            show_default="clear",
            autocompletion=_complete_weathers,
            help=f"Weather of the {ROAD_SCENARIO}: {', '.join(WEATHER_NAMES)}.",
        ),
    ] = None,
    force: ForceOption = False,
) -> None:
    """Make a log with known truth from a scenario.

    The same scenario and seed give the same bytes.
    """
    output = normalise_stdout_name(output)
    if output is None:
        raise UsageError("simulate needs a file to write", hint="name it with -o; - is standard output")
    if output == "-" and talk.json:
        raise UsageError("--json and -o - both want standard output", hint="write the log to a file")
    if seed is not None and seed < 0:
        raise UsageError(f"--seed {seed} must not be negative")
    from cwcli.output import check_targets

    check_targets([output], force=force, inputs=[] if scenario in (ROAD_SCENARIO, *scenario_names()) else [scenario])
    if scenario == ROAD_SCENARIO:
        _simulate_road(output, weather, seed, tuple(override or ()), talk, force=force)
        return
    if weather is not None:
        raise UsageError(
            f"--weather {weather}: only the {ROAD_SCENARIO} has a weather",
            hint=f"cwcli simulate {ROAD_SCENARIO} -o ...",
        )
    from cwcli.simulate.sensor_log import write_simulated_log
    from cwcli.simulation.drive import simulate_scenario
    from cwcli.simulation.scenario import load_scenario

    with Progress(quiet=talk.quiet) as progress:
        progress.begin_step(f"simulating {scenario}")
        drive = simulate_scenario(load_scenario(scenario, tuple(override or ())), seed)
        written = write_simulated_log(drive, output, force=force)
    about = f"{drive.scenario.description}; seed {drive.seed}, {drive.scenario.duration_s:g} s"
    _print_written_channels(talk, drive.scenario.name, drive.seed, output, about, written)


def _simulate_road(
    output: str, weather: str | None, seed: int | None, override: tuple[str, ...], talk: TalkOptions, *, force: bool
) -> None:
    from cwcli.simulate.road_log import parse_road_log_config, plan_configured_drive, write_road_log

    config = parse_road_log_config(weather, seed, override)
    drive = plan_configured_drive(config)
    with Progress(quiet=talk.quiet) as progress:
        progress.begin_step(f"rendering {len(drive)} frames")
        written = write_road_log(drive, config, output, force=force)
    about = (
        f"A rendered drive, {config.drive.weather}, {config.drive.road} road; {len(drive)} frames of "
        f"{config.size[0]} x {config.size[1]}; seed {config.drive.seed}, {config.drive.duration_s:g} s"
    )
    _print_written_channels(talk, ROAD_SCENARIO, config.drive.seed, output, about, written)


def _print_written_channels(
    talk: TalkOptions, name: str, seed: int, output: str, about: str, written: Sequence[WrittenChannel]
) -> None:
    if talk.json:
        document = {
            "scenario": name,
            "seed": seed,
            "output": output,
            "channels": [
                {"topic": entry.topic, "schema": entry.schema_name, "messages": entry.n_messages, "lost": entry.n_lost}
                for entry in written
            ],
        }
        Console(quiet=talk.quiet).print_document("simulate", document)
        return
    console = Console(quiet=talk.quiet, summary_to_stderr=output == "-")
    console.print_heading(f"simulate {name}")
    console.print_summary(wrap_paragraph(escape_control_characters(about)))
    console.print_summary("")
    rows = [(entry.topic, entry.schema_name, entry.n_messages, entry.n_lost) for entry in written]
    console.print_summary(format_table(("topic", "schema", "messages", "lost on the link"), rows))
    console.print_summary("")
    print_written_files(console, [output] if output != "-" else [])
