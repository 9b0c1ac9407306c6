"""What `cwcli estimate` makes of sensors that are not as they should be: exit code, words, errors against the truth."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import SAMPLES, Run
from tests.cli.rewritten_logs import Logged, read, write

FIX, SPEED, HEADING, IMU, TRUTH = "/gps/fix", "/vehicle/velocity", "/gps/heading", "/imu/data", "/truth/ego"
IMU_NUMBERS = 37  # doubles at the end: orientation 4, its covariance 9, gyroscope 3 + 9, accelerometer 3 + 9
Change = Callable[[list[Logged]], list[Logged]]


def imu_times(*factors: tuple[slice, np.ndarray | float]) -> Change:
    """The IMU's numbers multiplied, variances too."""

    def edit(each: Logged) -> Logged:
        if each.topic != IMU:
            return each
        numbers = np.frombuffer(each.data[-8 * IMU_NUMBERS :]).copy()
        for part, by in factors:
            numbers[part] *= by
        return replace(each, data=each.data[: -8 * IMU_NUMBERS] + numbers.tobytes())

    return lambda messages: [edit(each) for each in messages]


GYRO, GYRO_VARIANCE, FORCE, FORCE_VARIANCE = slice(13, 16), slice(16, 25), slice(25, 28), slice(28, 37)
IN_G = imu_times((FORCE, 1.0 / 9.80665), (FORCE_VARIANCE, 9.80665**-2))
IN_DEGREES = imu_times((GYRO, np.degrees(1.0)), (GYRO_VARIANCE, np.degrees(1.0) ** 2))
TURNED = np.array([1.0, -1.0, -1.0])
UPSIDE_DOWN = imu_times((GYRO, TURNED), (FORCE, TURNED))


def without(*topics: str) -> Change:
    return lambda messages: [each for each in messages if each.topic not in topics]


def between(topics: tuple[str, ...], begin_s: float, end_s: float) -> Change:
    """Without these topics in a span from the log's start."""

    def change(messages: list[Logged]) -> list[Logged]:
        first = messages[0].log_time_ns
        inside = [begin_s < (each.log_time_ns - first) / 1e9 < end_s for each in messages]
        return [each for each, gone in zip(messages, inside, strict=True) if not (gone and each.topic in topics)]

    return change


def swapped(messages: list[Logged]) -> list[Logged]:
    """The payloads of neighbouring fixes change places: stamps run back and forth."""
    fixes = [i for i, each in enumerate(messages) if each.topic == FIX]
    out = list(messages)
    for i, j in zip(fixes[::2], fixes[1::2], strict=False):
        out[i], out[j] = replace(out[i], data=messages[j].data), replace(out[j], data=messages[i].data)
    return out


def stuck(messages: list[Logged]) -> list[Logged]:
    """From 18 s on the speed is what it was, under new stamps (8 bytes behind the CDR header)."""
    first = messages[0].log_time_ns
    held: bytes | None = None
    out = []
    for each in messages:
        if each.topic == SPEED and (each.log_time_ns - first) / 1e9 > 18.0:
            held = held or each.data
            out.append(replace(each, data=each.data[:12] + held[12:]))
        else:
            out.append(each)
    return out


def twice(messages: list[Logged]) -> list[Logged]:
    return [again for each in messages for again in ((each, each) if each.topic == FIX else (each,))]


def zero_first(messages: list[Logged]) -> list[Logged]:
    """The first speed says 0: the last 12 bytes of a VelocityReport are three floats, the first the speed."""
    first = next(i for i, each in enumerate(messages) if each.topic == SPEED)
    data = messages[first].data
    wrong = replace(messages[first], data=data[:-12] + b"\0\0\0\0" + data[-8:])
    return [*messages[:first], wrong, *messages[first + 1 :]]


@dataclass(frozen=True)
class Case:
    """What is changed, what is said (in notes or the verdict), and bounds of the errors, 1 sigma.

    Attributes:
        change: Of the log.
        said: Parts of the notes and of the verdict.
        position_m, speed_mps: Largest errors; the log as it is has 0.06 m and 0.04 m/s.
        heading_deg: The same; 0.1 degrees.
    """

    change: Change
    said: tuple[str, ...]
    position_m: float = 0.12
    speed_mps: float = 0.08
    heading_deg: float = 0.25


CASES = {
    "as it is": Case(lambda messages: messages, ()),
    "fixes alone": Case(without(SPEED, HEADING, IMU), (), 0.35, 0.35, 3.5),
    "no fixes but an IMU and a speed": Case(without(HEADING), (), 0.15, 0.08, 0.3),
    "five seconds": Case(between((FIX, SPEED, HEADING, IMU, TRUTH), 5.0, 99.0), (), 0.25, 0.2, 0.6),
    "gaps of all sensors": Case(between((FIX, SPEED, HEADING, IMU), 8.0, 12.0), ("gap",), 0.8, 0.3, 0.6),
    "stamps out of order": Case(swapped, ()),
    "IMU in g": Case(IN_G, ("measures acceleration in g, not m/s^2: converted",)),
    "gyroscope in degrees": Case(IN_DEGREES, ("measures turn rates in degrees/s, not rad/s",)),
    "IMU in g and degrees": Case(
        lambda messages: IN_G(IN_DEGREES(messages)),
        ("measures acceleration in g, not m/s^2", "measures turn rates in degrees/s, not rad/s"),
    ),
    "IMU upside down": Case(UPSIDE_DOWN, ("is mounted with x forward, -y left and -z up",)),
    "speed that sticks": Case(stuck, ("repeats one value for long",)),
    "fixes twice": Case(twice, ("duplicate message",)),
    "first speed 0": Case(zero_first, ("the first speed row contradicts the following rows",)),
}


@pytest.mark.parametrize("name", CASES)
def test_odd_sensors(name: str, cwcli: Run, tmp_path: Path) -> None:
    case = CASES[name]
    log = tmp_path / "odd.mcap"
    write(log, case.change(read(SAMPLES / "curve.mcap")))
    done = cwcli("estimate", log, "--json")
    assert done.returncode == 0, done.stderr.decode()
    summary = json.loads(done.stdout)["stages"]["estimate"]
    rejected = [reason for each in summary["inputs"] for reason in each["rejected"]]
    told = " ".join([*summary["notes"], *rejected, summary["verdict"]])
    for part in case.said:
        assert part in told
    errors = {row["error_of"]: row["estimated"] for row in summary["sections"]["errors"]}
    assert errors["position on one axis"] < case.position_m
    assert errors["speed"] < case.speed_mps
    assert errors["heading"] < case.heading_deg


def test_a_parked_car_stays_where_it_is_and_no_latency_is_found(cwcli: Run, tmp_path: Path) -> None:
    log = tmp_path / "parked.mcap"
    assert cwcli("simulate", "straight", "--set", "vehicles.host.speed_mps=0", "-o", log).returncode == 0
    done = cwcli("estimate", log, "--json")
    assert done.returncode == 0, done.stderr.decode()
    summary = json.loads(done.stdout)["stages"]["estimate"]
    assert "applied" not in {row["latency_status"] for row in summary["sections"]["sources"]}
    errors = {row["error_of"]: row["estimated"] for row in summary["sections"]["errors"]}
    assert errors["position on one axis"] < 0.2
    assert errors["speed"] < 0.05


def test_a_log_without_a_position_is_refused_in_words(cwcli: Run, tmp_path: Path) -> None:
    log = tmp_path / "imu.mcap"
    write(log, without(FIX, SPEED, HEADING)(read(SAMPLES / "curve.mcap")))
    done = cwcli("estimate", log)
    assert done.returncode == 4
    assert b"no channel holds the ego position" in done.stderr
