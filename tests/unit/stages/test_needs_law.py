"""The registry of needs against the stages themselves: a stage misses a signal exactly where the registry says so."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cwcli.channels.binding import ALL_ROLE_NAMES, bind_roles
from cwcli.errors import MissingSignalError
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import Selection, StageCall
from cwcli.pipeline.execute import SkipRules, run_stages
from cwcli.pipeline.missing import SignalCheck
from cwcli.pipeline.needs import readiness_of_each_stage
from cwcli.stages import STAGES
from tests.unit.stages.lateral_logs import IMU, SPEED, STEERING, drive, ego_state_channel, write_lane_log

SAMPLES = Path(__file__).parents[3] / "sample_logs"
DRIVE = drive(seconds=4.0)


def call(name: str) -> StageCall:
    """The stage as its command runs it without options."""
    return StageCall(STAGES[name], STAGES[name].configuration_class())


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
        before = ("observe", "predict-lane")
    with Log.open(path) as opened:
        log = opened
        if kind == "lanes-and-state":
            log = log.with_channels([ego_state_channel(DRIVE)])
        for name in before:
            result = call(name)(log, Selection())
            log = log.with_channels(result.channels, {f"cwcli.run.{result.stage}": result.metadata})
        yield log


KINDS = ("straight", "intersection", "estimated", "predicted", "lanes", "lanes-alone", "lanes-and-state", "observed")


@pytest.mark.parametrize("kind", KINDS)
def test_a_stage_misses_a_signal_exactly_where_the_registry_says_so(kind: str, tmp_path: Path) -> None:
    runs: dict[str, bool] = {}
    with log_of(kind, tmp_path) as log:
        bound = bind_roles(log.channels, {}, required=(), optional=ALL_ROLE_NAMES).by_role
        for name in STAGES:
            try:
                call(name)(log, Selection())
                runs[name] = True
            except MissingSignalError:
                runs[name] = False
    assert runs == {entry.stage.name: entry.is_ready for entry in readiness_of_each_stage(set(bound), STAGES)}


def test_run_observes_with_the_speed_of_the_ego_state(tmp_path: Path) -> None:
    calls = {"observe": call("observe")}
    with log_of("lanes-and-state", tmp_path) as log:
        outcome, _ = run_stages(log, calls, Selection(), skip=SkipRules(SignalCheck(STAGES), True))
    assert [result.stage for result in outcome.results] == ["observe"]


def test_run_says_that_nothing_tells_the_speed(tmp_path: Path) -> None:
    with log_of("lanes-alone", tmp_path) as log:
        lack = SignalCheck(STAGES)("observe", log, Selection())
    assert lack is not None
    assert lack.reason == "no channel holds the ego speed"


@pytest.mark.parametrize(
    ("stage", "ways"), [("predict", "observe,predict-lane"), ("warn", "observe,predict-lane,warn-lane")]
)
def test_run_names_the_stages_that_do_without_a_position(stage: str, ways: str, tmp_path: Path) -> None:
    """The file of this log holds lanes and sensors; what `observe` made is in memory."""
    with log_of("observed", tmp_path) as log:
        lack = SignalCheck(STAGES)(stage, log, Selection())
    assert lack is not None
    assert lack.reason == f"no channel holds the ego state (another way: --stage {ways})"
