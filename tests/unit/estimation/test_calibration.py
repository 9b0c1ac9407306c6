"""Calibration files: what is wrong is named in one line, and what was written is read back."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import pytest

from cwcli.errors import InputError, UsageError
from cwcli.estimation import Kind
from cwcli.estimation.calibration import (
    Calibration,
    Constant,
    ConstantStatus,
    format_calibration_toml,
    load_calibration,
    parse_calibration_table,
)

GOOD = """
cwcli_calibration = 1
logs = ["a.mcap"]
minutes = 4.5
distance_km = 3.0
["/gps/fix".position]
latency_s = { value = 0.12, sigma = 0.01, spread = 0.02 }
["/imu".accel]
bias = { status = "not observable", logs = 1, minutes = 4.5 }
["/imu".imu]
nose_up_rad = { value = 0.1 }
[motion]
jerk_sigma_mps3 = { value = 1.5, sigma = 0.1 }
"""


def from_text(text: str) -> Calibration:
    return parse_calibration_table(tomllib.loads(text), "car.toml")


def test_file_of_ones_own() -> None:
    car = from_text(GOOD)
    latency = car.find_constant_or_unknown("/gps/fix", Kind.POSITION, "latency_s")
    assert (latency.value, latency.sigma, latency.status) == (0.12, 0.01, ConstantStatus.FOUND)
    assert latency.sigma_in_another_drive == pytest.approx(math.hypot(0.01, 0.02))
    assert latency.interval_of_95_percent_of_drives == pytest.approx(
        (0.12 - 1.96 * math.hypot(0.01, 0.02), 0.12 + 1.96 * math.hypot(0.01, 0.02))
    )
    assert car.find_constant_or_unknown("/imu", "imu", "nose_up_rad").sigma == 0.0  # as if exact
    assert not car.find_constant_or_unknown("/imu", Kind.ACCEL, "bias").has_value
    assert not car.find_constant_or_unknown("/other", Kind.SPEED, "scale").has_value
    assert (car.logs, car.minutes, dict(car.evidence)) == (("a.mcap",), 4.5, {"distance_km": 3.0})


def test_what_is_written_is_read_back() -> None:
    odd = 'a "quoted"\\ topic\x7f'
    car = Calibration(
        "car.toml",
        {
            odd: {"speed": {"scale": Constant(ConstantStatus.DISAGREE, 0.99, 1e-5, 2e-4, 7.25, 3, 12.5)}},
            "/imu": {"yaw_rate": {"bias": Constant(n_logs=3, minutes=12.5)}},
        },
        {"jerk_sigma_mps3": Constant(ConstantStatus.FOUND, 2.0, 0.1, 0.0, math.nan, 1, 4.0)},
        ("x.mcap", "y.mcap"),
        12.5,
        {"distance_km": 8.0, "accel_rms_mps2": 0.5, "yaw_rate_rms_radps": 1e-7},
    )
    again = from_text(format_calibration_toml(car))
    assert again.sensors[odd] == car.sensors[odd]
    assert again.sensors["/imu"]["yaw_rate"]["bias"].n_logs == 3
    assert (again.logs, again.minutes, again.evidence) == (car.logs, car.minutes, car.evidence)
    assert format_calibration_toml(again) == format_calibration_toml(car)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        pytest.param("cwcli_calibration = 1", "", "this is not a calibration file", id="another file"),
        pytest.param("cwcli_calibration = 1", "cwcli_calibration = 2", "is 2; permitted: 1", id="new"),
        pytest.param("cwcli_calibration = 1", "cwcli_calibration = true", "cwcli_calibration is True", id="boolean"),
        pytest.param("value = 0.12", "value = nan", "/gps/fix.position.latency_s.value is nan; permitted", id="nan"),
        pytest.param("value = 0.12", "value = 1e9", "value is 1000000000.0; permitted: -3600 to 3600 s", id="huge"),
        pytest.param("value = 0.12, ", "", "latency_s.value is missing", id="no value"),
        pytest.param("sigma = 0.01", "sigma = -0.01", "sigma is -0.01; permitted: 0 to 7200 s", id="negative sigma"),
        pytest.param("{ value = 0.1 }", "0.1", "nose_up_rad is 0.1; permitted: a table", id="plain number"),
        pytest.param("latency_s", "latency_ms", "/gps/fix.position.latency_ms is unknown; permitted", id="constant"),
        pytest.param("sigma = 0.01", "sigme = 0.01", "latency_s.sigme is unknown; permitted: status", id="field"),
        pytest.param(".position]", ".place]", "/gps/fix.place is unknown; permitted: position", id="quantity"),
        pytest.param("minutes = 4.5", "hours = 4.5", "hours is unknown; permitted: cwcli_calibration", id="key"),
        pytest.param('"not observable"', '"fine"', "bias.status is 'fine'; permitted: reference, found", id="status"),
        pytest.param('["a.mcap"]', "[1]", "logs is [1]; permitted: a list of names", id="logs"),
        pytest.param("latency_s =", "scale =", "/gps/fix.position.scale is unknown", id="a position has no scale"),
    ],
)
def test_wrong_content_is_one_line_with_the_file_and_the_key(old: str, new: str, message: str) -> None:
    with pytest.raises(UsageError, match=r"^car\.toml: ") as found:
        from_text(GOOD.replace(old, new, 1))
    assert message in str(found.value)
    assert "\n" not in str(found.value)


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="can't be read"):
        load_calibration(tmp_path / "none.toml")
    file = tmp_path / "car.toml"
    file.write_text("not [ toml")
    with pytest.raises(UsageError, match="not TOML"):
        load_calibration(file)
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        load_calibration(file)
    file.write_text("cwcli_calibration = 1")
    with pytest.raises(UsageError, match="no source"):
        load_calibration(file)
