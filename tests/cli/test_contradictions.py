"""One sensor that lies: its fault is said first and corrected, it moves nothing, and `--strict` ends with 5."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.simulate.sensor_log import write_simulated_log
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import load_scenario
from tests.cli.conftest import ROOT, TIMEOUT_S, Run
from tests.cli.rewritten_logs import Logged, read, write

FIX, SPEED, HEADING, IMU = "/gps/fix", "/vehicle/velocity", "/gps/heading", "/imu/data"
IN_KMH = ("--map", f"ego_speed={SPEED}:longitudinal_velocity*3.6")
IMU_NUMBERS = 37  # doubles at the end: orientation 4, its covariance 9, gyroscope 3 + 9, accelerometer 3 + 9
GYRO, FORCE = slice(13, 16), slice(25, 28)
MOST_M = {"full": 0.1, "lean": 0.2}
"""Error of the position on one axis; the fixes themselves err by 0.52 m, a drive without a fault by 0.07 and 0.08 m."""
Change = Callable[[np.ndarray], None]


def sign_turned(numbers: np.ndarray) -> None:
    numbers[GYRO] *= -1.0


def upright(numbers: np.ndarray) -> None:
    """Turned by 90 degrees about y: what was up is forward, what was forward is down."""
    for part in (GYRO, FORCE):
        x, _, z = numbers[part].copy()
        numbers[part.start], numbers[part.start + 2] = z, -x


def imu_changed(change: Change) -> Callable[[list[Logged]], list[Logged]]:
    def edit(each: Logged) -> Logged:
        if each.topic != IMU:
            return each
        numbers = np.frombuffer(each.data[-8 * IMU_NUMBERS :]).copy()
        change(numbers)
        return replace(each, data=each.data[: -8 * IMU_NUMBERS] + numbers.tobytes())

    return lambda messages: [edit(each) for each in messages]


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive of four minutes without a fault: `cwcli simulate city --seed 9301`."""
    log = tmp_path_factory.mktemp("contradictions") / "right.mcap"
    write_simulated_log(simulate_scenario(load_scenario("city"), 9301), log)
    return log


def lean(messages: list[Logged]) -> list[Logged]:
    """Fixes and an IMU alone, and the truth."""
    return [each for each in messages if each.topic not in (SPEED, HEADING)]


def _estimate(log: Path, *options: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "cwcli", "estimate", str(log), "--json", *options]
    done = subprocess.run(command, capture_output=True, check=False, cwd=ROOT, timeout=TIMEOUT_S)
    assert done.returncode == 0, done.stderr.decode()
    found = json.loads(done.stdout)["stages"]["estimate"]
    assert isinstance(found, dict)
    return found


def _error_m(summary: dict[str, Any]) -> float:
    rows = {row["error_of"]: row["estimated"] for row in summary["sections"]["errors"]}
    return float(rows["position on one axis"])


def _used(summary: dict[str, Any]) -> set[str]:
    """Sources and quantities of which a row was used."""
    return {f"{row['source']} {row['quantity']}" for row in summary["sections"]["sources"] if row["used"]}


@pytest.mark.parametrize("sensors", ["full", "lean"])
def test_without_a_fault_nothing_is_named(sensors: str, right: Path, tmp_path: Path) -> None:
    log = tmp_path / "right.mcap"
    messages = read(right)
    write(log, lean(messages) if sensors == "lean" else messages)
    summary = _estimate(log)
    assert "contradicts" not in summary["verdict"]
    assert "contradictions" not in summary
    assert _error_m(summary) < MOST_M[sensors]


def test_a_speed_in_km_h_is_said_first_converted_and_counted(right: Path) -> None:
    summary = _estimate(right, *IN_KMH)
    told = re.match(
        rf"input corrected: (ego_speed \({SPEED}\) is in km/h, not m/s: converted \(log-likelihood ratio (\d+) by "
        rf"{FIX}, {IMU}; --trust {SPEED} leaves it unchanged\))\. With that: consistent",
        summary["verdict"],
    )
    assert told is not None
    assert float(told[2]) > 100.0
    assert summary["corrections"] == [told[1]] == summary["notes"][:1]
    assert "contradictions" not in summary
    (speed,) = (each for each in summary["inputs"] if each["topic"] == SPEED)
    assert speed["repaired"] == {"is in km/h, not m/s": speed["used"]}
    assert f"{SPEED} speed" in _used(summary)
    assert _error_m(summary) < MOST_M["full"]


def test_a_trusted_speed_is_kept_and_what_the_user_says_is_done(right: Path) -> None:
    kept = _estimate(right, *IN_KMH, "--trust", SPEED)
    assert "corrections" not in kept
    assert re.match(rf"not consistent: .*contradicts ego_speed \({SPEED}\)", kept["verdict"])
    assert f"{SPEED} speed" in _used(kept)
    by_hand = _estimate(right, *IN_KMH, "--as", f"{SPEED}=km/h")
    assert by_hand["notes"][0] == f"ego_speed ({SPEED}) is in km/h, not m/s: converted, as --as says"
    assert "corrections" not in by_hand
    assert by_hand["verdict"].startswith("consistent")
    assert _error_m(by_hand) < MOST_M["full"]


def test_options_for_topics_and_units_that_are_not_there_are_refused(cwcli: Run, right: Path) -> None:
    for option, words in (
        (("--trust", "/speed"), b"--trust /speed: the log has no topic /speed"),
        (("--as", "/speed=km/h"), b"--as /speed: the log has no topic /speed"),
        (("--as", f"{SPEED}=g"), b"there is no such fault of /vehicle/velocity"),
    ):
        done = cwcli("estimate", right, *option)
        assert done.returncode == 2
        assert words in done.stderr


@pytest.mark.parametrize("sensors", ["full", "lean"])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (sign_turned, f"imu ({IMU}) has a gyroscope with the wrong sign: reversed (by its own accelerometer and "),
        (upright, f"imu ({IMU}) is mounted with -z forward, y left and x up, not x, y and z: turned (log-likelihood"),
    ],
    ids=["gyroscope's sign turned", "IMU upright"],
)
def test_a_wrong_imu_is_said_first_and_corrected(
    sensors: str, change: Change, said: str, right: Path, tmp_path: Path
) -> None:
    log = tmp_path / "wrong.mcap"
    messages = imu_changed(change)(read(right))
    write(log, lean(messages) if sensors == "lean" else messages)
    summary = _estimate(log)
    assert summary["verdict"].startswith(f"input corrected: {said}")
    assert {f"{IMU} accel", f"{IMU} yaw rate"} <= _used(summary)
    statuses = {row["status"] for row in summary["sections"].get("parameters", []) if row["source"] == IMU}
    assert "contradicts" not in statuses  # nothing was absorbed that would have to be refused
    assert _error_m(summary) < MOST_M[sensors]


def test_strict_ends_with_5_and_writes_nothing(cwcli: Run, right: Path, tmp_path: Path) -> None:
    target = tmp_path / "strict.mcap"
    done = cwcli("estimate", right, *IN_KMH, "--strict", "-o", target)
    assert done.returncode == 5
    assert b"is in km/h, not m/s: converted" in done.stderr
    assert not target.exists()
    assert cwcli("estimate", right, "--strict", "-o", target).returncode == 0


def test_latency_none_and_no_sensor_model_say_so_too(right: Path) -> None:
    for option in (("--latency", "none"), ("--sensor-model", "none")):
        assert _estimate(right, *IN_KMH, *option)["verdict"].startswith(f"input corrected: ego_speed ({SPEED})")
    # Here no state may depend on the whole log: it is told, and nothing is changed.
    assert "contradicts ego_position" in _estimate(right, *IN_KMH, "--causal", "--latency", "none")["verdict"]


def test_online_states_that_may_not_depend_on_the_whole_log_are_told_to_be_uncorrected(right: Path) -> None:
    notes = _estimate(right, *IN_KMH, "--latency", "none")["notes"]
    assert (
        f"the online states use ego_speed ({SPEED}) as it is, because they may depend on no later message; "
        f"--as {SPEED}=km/h corrects them, too"
    ) in notes
