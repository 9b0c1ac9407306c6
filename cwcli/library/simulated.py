"""Writes a simulated log with known truth (`cwcli.simulate`)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from cwcli.errors import UsageError
from cwcli.input import remember_inputs
from cwcli.lazy_dataclass import dataclass
from cwcli.output import refuse_unwritable_targets
from cwcli.simulation.catalogue import scenario_names
from cwcli.simulation.road.names import ROAD_SCENARIOS

if TYPE_CHECKING:
    from cwcli.simulate.sensor_log import WrittenChannel


@dataclass(frozen=True)
class SimulatedLog:
    """A log that was simulated.

    Attributes:
        scenario: Name of the scenario.
        seed: Seed of all random draws.
        description: What happens, in one line.
        channels: The channels, with the numbers of their messages.
    """

    scenario: str
    seed: int
    description: str
    channels: tuple[WrittenChannel, ...]


def write_simulation(
    scenario: str | Path,
    target: str | Path,
    *,
    seed: int | None = None,
    values: Mapping[str, object] | None = None,
    weather: str | None = None,
    actors: str | Path | None = None,
    force: bool = False,
) -> Path:
    """Write a log with known truth from a scenario; the same scenario and seed give the same bytes.

    Args:
        scenario: Name or file of a scenario, or a name of `ROAD_SCENARIOS`: camera frames of a lane.
        target: The log.
        seed: Seed of all random draws; None: the scenario's own.
        values: Values of the scenario to change: `{"host.speed_mps": 15}`.
        weather: Weather of the road.
        actors: Log with the states of `cwcli estimate`, whose vehicles drive instead of those of the scenario; the
            sensors and the link are the scenario's.
        force: Overwrite a file that exists.

    Returns:
        The log's file.

    Raises:
        UsageError: There is no such scenario, or a value is wrong.
        MissingSignalError: The log of the actors lacks states.
        OutputError: The file exists, or can't be written.
    """
    overrides = tuple(f"{key}={value}" for key, value in (values or {}).items())
    name = f"./{target}" if str(target) == "-" else str(target)
    log = None if actors is None else str(actors)
    with remember_inputs():
        simulate_log(str(scenario), name, seed=seed, overrides=overrides, weather=weather, actors=log, force=force)
    return Path(target)


def simulate_log(
    scenario: str,
    target: str,
    *,
    seed: int | None,
    overrides: tuple[str, ...],
    weather: str | None,
    actors: str | None,
    force: bool,
) -> SimulatedLog:
    """Simulate and write a log; `cwcli.simulate` and the command come here.

    Args:
        scenario, seed, weather, actors, force: As in `write_simulation`.
        target: File, or `-` for standard output.
        overrides: `KEY=VALUE` of the scenario's values to change.

    Raises:
        CwcliError: As `write_simulation` does.
    """
    if seed is not None and seed < 0:
        raise UsageError(f"--seed {seed} must not be negative")
    is_file = scenario not in (*ROAD_SCENARIOS, *scenario_names())
    inputs = [*([scenario] if is_file else []), *([actors] if actors is not None else [])]
    refuse_unwritable_targets([target], force=force, inputs=inputs)
    if scenario in ROAD_SCENARIOS:
        if actors is not None:
            raise UsageError(f"--actors {actors}: a rendered drive has no vehicles", hint="name another scenario")
        return _write_rendered_road_log(
            scenario, target, weather, seed, (*ROAD_SCENARIOS[scenario], *overrides), force=force
        )
    if weather is not None:
        raise UsageError(
            f"--weather {weather}: only a rendered drive has a weather",
            hint=f"one of: {', '.join(ROAD_SCENARIOS)}",
        )
    from cwcli.simulate.sensor_log import write_simulated_log
    from cwcli.simulation.drive import simulate_scenario
    from cwcli.simulation.scenario import load_scenario

    checked = load_scenario(scenario, overrides)
    if actors is not None:
        from cwcli.simulate.log_actors import replace_vehicles_by_those_of_log

        checked = replace_vehicles_by_those_of_log(checked, actors)
    drive = simulate_scenario(checked, seed)
    simulated = write_simulated_log(drive, target, force=force)
    about = f"{drive.scenario.description}; seed {drive.seed}, {drive.scenario.duration_s:g} s"
    return SimulatedLog(drive.scenario.name, drive.seed, about, simulated)


def _write_rendered_road_log(
    name: str, target: str, weather: str | None, seed: int | None, overrides: tuple[str, ...], *, force: bool
) -> SimulatedLog:
    """Render a drive on a road and write its frames."""
    from cwcli.simulate.road_log import parse_road_log_config, plan_configured_drive, write_road_log

    config = parse_road_log_config(weather, seed, overrides)
    drive = plan_configured_drive(config)
    simulated = write_road_log(drive, config, target, force=force)
    about = (
        f"A rendered drive, {config.drive.weather}, {config.drive.road} road; {len(drive)} frames of "
        f"{config.size[0]} x {config.size[1]}; seed {config.drive.seed}, {config.drive.duration_s:g} s"
    )
    return SimulatedLog(name, config.drive.seed, about, simulated)
