"""`cwcli calibrate`, and `--calibration` of the commands that use it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.estimation.calibration import load_calibration

LATENCY_S = 0.15


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Two simulated drives of a car with a late receiver, and its calibration."""
    folder = tmp_path_factory.mktemp("calibrate")
    logs = [str(folder / f"drive{seed}.mcap") for seed in (1, 2)]
    for seed, log in enumerate(logs, 1):
        late = f"sensors.gnss.latency_s={LATENCY_S}"
        assert run_command_line(["simulate", "city", "--seed", str(seed), "--set", late, "-o", log, "-q"]) == 0
    car = str(folder / "car.toml")
    assert run_command_line(["calibrate", *logs, "-o", car, "-q"]) == 0
    return [*logs, car]


ESTIMATE = ("estimate", "--details")


def test_calibration_of_two_drives_has_what_was_planted(drives: list[str]) -> None:
    car = load_calibration(drives[-1])
    latency = car.find_constant_or_unknown("/gps/fix", "position", "latency_s")
    assert latency.n_logs == 2
    assert abs(latency.value - LATENCY_S) < 3.0 * latency.sigma < 0.05
    assert car.logs == ("drive1.mcap", "drive2.mcap")


def test_order_of_the_logs_does_not_matter_and_the_file_is_the_same_again(drives: list[str], tmp_path: Path) -> None:
    again, other = str(tmp_path / "again.toml"), str(tmp_path / "other.toml")
    assert run_command_line(["calibrate", *drives[:2], "-o", again, "-q"]) == 0
    assert Path(again).read_bytes() == Path(drives[-1]).read_bytes()
    assert run_command_line(["calibrate", *drives[1::-1], "-o", other, "-q"]) == 0
    assert load_calibration(other).sensors["/gps/fix"] == load_calibration(again).sensors["/gps/fix"]


def test_table_and_json(drives: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["calibrate", drives[0]]) == 0
    shown = capsys.readouterr()
    assert "latency_s" in shown.out
    assert "one log: the spread between drives is unknown" in shown.err
    assert max(map(len, shown.out.splitlines())) <= 80
    assert run_command_line(["calibrate", drives[0], "--json", "-q"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["sensors"]["/gps/fix"]["position"]["latency_s"]["n_logs"] == 1


def test_reference_is_called_one_and_has_no_value_in_the_table(
    drives: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["calibrate", drives[0], "--json", "-q"]) == 0
    latency = json.loads(capsys.readouterr().out)["sensors"]["/imu/data"]["accel"]["latency_s"]
    assert (latency["status"], latency["value"]) == ("reference", 0.0)
    assert run_command_line(["calibrate", drives[0]]) == 0
    shown = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["/imu/data", "accel", "latency_s", "-", "-", "1", "-"] in [line[:7] for line in shown]
    assert any(line[-1:] == ["reference"] for line in shown)


def test_drives_that_disagree_are_named_and_not_used_in_the_next_one(
    drives: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    third, other, car = (str(tmp_path / name) for name in ("third.mcap", "in_time.mcap", "car.toml"))
    for seed, log in ((3, third), (4, other)):
        assert run_command_line(["simulate", "city", "--seed", str(seed), "-o", log, "-q"]) == 0
    assert run_command_line(["calibrate", drives[0], other, "-o", car]) == 0
    shown = capsys.readouterr()
    told = " ".join(shown.err.split())
    assert "/gps/fix: latency_s of position: the logs disagree (drive1.mcap 0.1" in told
    assert ", in_time.mcap " in told
    assert "it will not be used" in told
    assert "logs disagree (I^2 " in shown.out
    assert run_command_line([*ESTIMATE, third, "--calibration", car, "-o", str(tmp_path / "out.mcap")]) == 0
    shown = capsys.readouterr()
    assert "disagree on the latency of position" in " ".join(shown.err.split())
    assert "jumped" not in shown.out


def test_calibration_that_does_not_fit_a_log_is_told_on_it(
    drives: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = str(tmp_path / "in_time.mcap")
    assert run_command_line(["simulate", "city", "--seed", "4", "-o", other, "-q"]) == 0
    assert (
        run_command_line(
            ["estimate", "--details", other, "--calibration", drives[-1], "-o", str(tmp_path / "out.mcap")]
        )
        == 0
    )
    told = " ".join(capsys.readouterr().err.split())
    assert "makes this log worse" in told
    assert "latency of /gps/fix position found on it: " in told
    assert (
        run_command_line(
            ["estimate", "--details", drives[0], "--calibration", drives[-1], "-o", str(tmp_path / "out2.mcap")]
        )
        == 0
    )
    assert "worse" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "more"), [("estimate", ["--causal"]), ("run", ["--estimate-causal", "--stage", "estimate"])]
)
def test_calibration_is_used(
    command: str, more: list[str], drives: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out.mcap")
    assert run_command_line([command, drives[0], "--calibration", drives[-1], *more, "--json", "-q", "-o", out]) == 0
    assert "calibrated" in json.dumps(json.loads(capsys.readouterr().out)["stages"]["estimate"])
    assert run_command_line(["info", out, "--json", "-q"]) == 0


@pytest.mark.parametrize(
    ("content", "code", "message"),
    [
        (None, 3, "can't be read"),
        ("[[[", 2, "not TOML"),
        ("a = 1", 2, "this is not a calibration file"),
        ('cwcli_calibration = 1\n["/gps/fix".position]\nlatency_s = { value = nan }', 2, "value is nan; permitted"),
        ('cwcli_calibration = 1\n["/gps/fix".position]\ncolour = { value = 1 }', 2, "colour is unknown; permitted"),
        (
            'cwcli_calibration = 1\n["/her/gps".position]\nlatency_s = { value = 1 }',
            2,
            "not the calibration of this car",
        ),
    ],
    ids=["none", "no TOML", "another file", "not a number", "unknown key", "another car"],
)
def test_calibration_that_can_not_be_used_is_told_in_one_line(
    content: str | None, code: int, message: str, drives: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    car, out = tmp_path / "her.toml", tmp_path / "out.mcap"
    if content is not None:
        car.write_text(content)
    assert run_command_line(["estimate", drives[0], "--calibration", str(car), "-o", str(out)]) == code
    error = capsys.readouterr().err
    assert message in error
    assert error.startswith(f"error: {car}")
    assert not out.exists()


def test_log_that_fails_is_told_and_left_out(
    drives: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    none, car = str(tmp_path / "none.mcap"), tmp_path / "car.toml"
    assert run_command_line(["calibrate", drives[0], none, "-o", str(car)]) == 3
    assert "left out" in capsys.readouterr().err
    assert load_calibration(car).logs == ("drive1.mcap",)
    assert run_command_line(["calibrate", none, "-o", str(tmp_path / "other.toml")]) == 3
    assert not (tmp_path / "other.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["{0}", "{0}"], 2, "named twice"),
        (["{0}", "-o", "car.json"], 2, "must end in .toml"),
        (["{0}", "-o", "{2}"], 6, "exists"),
    ],
)
def test_wrong_arguments(
    arguments: list[str], code: int, message: str, drives: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["calibrate", *(each.format(*drives) for each in arguments)]) == code
    assert message in capsys.readouterr().err


def test_papers_filter_takes_no_calibration(drives: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["estimate", drives[0], "--calibration", drives[-1], "--model", "song2016"]) == 2
    assert "--calibration is not for --model song2016" in capsys.readouterr().err
