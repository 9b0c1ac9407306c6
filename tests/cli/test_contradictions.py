"""One sensor that lies: it is named in the verdict, it moves nothing, and `--strict` ends with 5."""

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


def test_a_speed_in_km_h_is_named_and_left_out(right: Path) -> None:
    summary = _estimate(right, *IN_KMH)
    told = re.fullmatch(
        rf"not consistent: (ego_speed \({SPEED}\) contradicts ego_position \({FIX}\): the car covered (\S+) times the "
        rf"distance between the fixes, as if km/h were taken for m/s) \(imu accel \({IMU}\) agrees with ego_position "
        rf"\({FIX}\); ego_speed \({SPEED}\) is left out of the estimate\).*",
        summary["verdict"],
    )
    assert told is not None
    assert float(told[2]) == pytest.approx(3.6, abs=0.05)
    assert summary["contradictions"] == [told[1]]
    assert any(note.startswith(f"ego_speed ({SPEED}) contradicts") for note in summary["notes"])
    assert f"{SPEED} speed" not in _used(summary)
    assert _error_m(summary) < MOST_M["full"]


@pytest.mark.parametrize("sensors", ["full", "lean"])
@pytest.mark.parametrize(
    ("change", "named", "left_out"),
    [
        (sign_turned, f"imu yaw rate ({IMU}) contradicts ego_position ({FIX}): it turns the other way", {"yaw rate"}),
        (
            upright,
            f"imu ({IMU}) contradicts gravity: on average it reads 9.8 m/s^2 along its forward axis and",
            {"yaw rate", "accel"},
        ),
    ],
    ids=["gyroscope's sign turned", "IMU upright"],
)
def test_a_wrong_imu_is_named_and_left_out(
    sensors: str,
    change: Change,
    named: str,
    left_out: set[str],
    right: Path,
    tmp_path: Path,
) -> None:
    log = tmp_path / "wrong.mcap"
    messages = imu_changed(change)(read(right))
    write(log, lean(messages) if sensors == "lean" else messages)
    summary = _estimate(log)
    assert summary["verdict"].startswith(f"not consistent: {named}")
    assert not {f"{IMU} {quantity}" for quantity in left_out} & _used(summary)
    parameters = summary["sections"].get("parameters", [])
    statuses = {row["status"] for row in parameters if row["source"] == IMU}
    assert "contradicts" not in statuses  # nothing was absorbed that would have to be refused
    assert _error_m(summary) < MOST_M[sensors]


def test_strict_ends_with_5_and_writes_nothing(cwcli: Run, right: Path, tmp_path: Path) -> None:
    target = tmp_path / "strict.mcap"
    done = cwcli("estimate", right, *IN_KMH, "--strict", "-o", target)
    assert done.returncode == 5
    assert b"contradicts ego_position" in done.stderr
    assert not target.exists()
    assert cwcli("estimate", right, "--strict", "-o", target).returncode == 0


def test_latency_none_and_no_sensor_model_say_so_too(right: Path) -> None:
    for option in (("--latency", "none"), ("--sensor-model", "none"), ("--causal", "--latency", "none")):
        assert "contradicts ego_position" in _estimate(right, *IN_KMH, *option)["verdict"]
