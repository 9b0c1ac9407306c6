"""The registry of needs against the stages themselves: a stage misses a signal exactly where the registry says so."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from cwcli.channels.binding import EVERY_ROLE, bind
from cwcli.cli.commands.run import default_options
from cwcli.cli.options.shared import SensorOptions
from cwcli.errors import MissingSignalError
from cwcli.logs.log import Log
from cwcli.pipeline.call import Selection, StageCall
from cwcli.pipeline.execute import run_stages
from cwcli.pipeline.missing import signals_for
from cwcli.pipeline.needs import NEEDS, PREDICT_FROM_OBSERVER, WARN_OF_LANE_DEPARTURE, WARN_OF_TARGETS, readiness
from tests.unit.stages.lateral_logs import IMU, SPEED, STEERING, drive, ego_state_channel, write_lane_log

SAMPLES = Path(__file__).parents[3] / "sample_logs"
DRIVE = drive(seconds=4.0)
OPTIONS = {
    PREDICT_FROM_OBSERVER: {"origin": "observer"},
    WARN_OF_TARGETS: {"source": "targets"},
    WARN_OF_LANE_DEPARTURE: {"rules": "lane-departure"},
}


def call(command: str) -> StageCall:
    """The stage as this command line runs it."""
    options = default_options().of_stages[command.split(maxsplit=1)[0]]
    options = replace(options, **OPTIONS.get(command, {}))
    made: StageCall = options.make(SensorOptions()) if options.stage in ("estimate", "track") else options.make()
    return made


@contextmanager
def log_of(kind: str, folder: Path) -> Iterator[Log]:
    """A log of each kind that the stages tell apart."""
    path = folder / "log.mcap"
    if kind in ("intersection", "estimated", "predicted"):
        path = SAMPLES / "intersection.mcap"
    elif kind == "straight":
        path = SAMPLES / "straight.mcap"
    else:
        write_lane_log(path, DRIVE, without=() if kind in ("lanes", "observed") else (SPEED, IMU, STEERING))
    before = {"estimated": ("estimate",), "predicted": ("estimate", "predict")}.get(kind, ())
    if kind == "observed":
        before = ("observe", PREDICT_FROM_OBSERVER)
    with Log.open(path) as opened:
        log = opened
        if kind == "lanes-and-state":
            log = log.with_channels([ego_state_channel(DRIVE)])
        for command in before:
            result = call(command)(log, Selection())
            log = log.with_channels(result.channels, {f"cwcli.run.{result.stage}": result.metadata})
        yield log


KINDS = ("straight", "intersection", "estimated", "predicted", "lanes", "lanes-alone", "lanes-and-state", "observed")


@pytest.mark.parametrize("kind", KINDS)
def test_a_stage_misses_a_signal_exactly_where_the_registry_says_so(kind: str, tmp_path: Path) -> None:
    runs: dict[str, bool] = {}
    with log_of(kind, tmp_path) as log:
        bound = bind(log.channels, {}, required=(), optional=EVERY_ROLE).by_role
        for command in NEEDS:
            try:
                call(command)(log, Selection())
                runs[command] = True
            except MissingSignalError:
                runs[command] = False
    assert runs == {entry.command: entry.is_ready for entry in readiness(set(bound))}


def test_run_observes_with_the_speed_of_the_ego_state(tmp_path: Path) -> None:
    calls = {"observe": call("observe")}
    with log_of("lanes-and-state", tmp_path) as log:
        outcome, _ = run_stages(log, calls, Selection(), missing=signals_for(calls, None), lenient=True)
    assert [result.stage for result in outcome.results] == ["observe"]


def test_run_says_that_nothing_tells_the_speed(tmp_path: Path) -> None:
    with log_of("lanes-alone", tmp_path) as log:
        lack = signals_for({"observe": call("observe")}, None)("observe", log, Selection())
    assert lack is not None
    assert lack.reason == "no channel holds the ego speed"


@pytest.mark.parametrize(
    ("stage", "options"),
    [("predict", "--predict-from observer"), ("warn", "--predict-from observer --warn-rules lane-departure")],
)
def test_run_names_the_options_that_do_without_a_position(stage: str, options: str, tmp_path: Path) -> None:
    with log_of("observed", tmp_path) as log:
        lack = signals_for({stage: call(stage)}, None)(stage, log, Selection())
    assert lack is not None
    assert lack.reason == f"no channel holds the ego state (from the camera: {options})"
