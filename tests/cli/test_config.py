"""`cwcli config`: the pipeline file as it will be used."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from cwcli.cli.app import load_command
from cwcli.cli.commands import HELP_LINE_BY_COMMAND
from cwcli.cli.commands.config import format_toml
from cwcli.cli.main import run_command_line
from cwcli.cli.options.configfile import WRITING_PARAMETERS as READ_WRITES
from cwcli.errors import EXIT_USAGE
from tests.cli.conftest import SAMPLES, Run


def test_defaults_come_back_as_they_were(cwcli: Run, tmp_path: Path) -> None:
    printed = cwcli("config")
    assert (printed.returncode, printed.stderr) == (0, b"")
    (tmp_path / "all.toml").write_bytes(printed.stdout)
    assert cwcli("config", "all.toml").stdout == printed.stdout
    document = tomllib.loads(printed.stdout.decode())
    assert document["run"]["stages"] == ["estimate", "track", "lanes", "observe", "predict", "warn"]
    assert document["estimate"]["rate"] == 20.0


def test_file_and_environment_are_in_it(cwcli: Run, tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text(
        'strict = true\ngates = ["a.b < 1"]\n[run]\nstages = ["warn", "estimate"]\n[warn]\nrule = "ttc"\n'
    )
    done = cwcli("config", "p.toml", "--json", env={"CWCLI_ESTIMATE_MODEL": "song2016"})
    document = json.loads(done.stdout)
    assert document["strict"] is True
    assert document["gates"] == ["a.b < 1"]
    assert document["run"]["stages"] == ["estimate", "warn"]
    assert document["warn"]["rule"] == "ttc"
    assert document["estimate"]["model"] == "song2016"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[estimate]\nrate = "fast"', ["estimate.rate = 'fast'", "hint:  see --estimate-rate"]),
        ("[estimate]\nratee = 1", ["unknown key estimate.ratee", "did you mean rate"]),
        ("[estimate]\nrate = 0", ["--rate 0 must be above 0"]),
        ('[estimate]\nmodel = "x"', ["estimate.model = 'x'", "cwcli"]),
        ("[estimate]\nrate = [1]", ["estimate.rate must not be a list"]),
        ("[estimate]\nrate = {a = 1}", ["estimate.rate must be a value"]),
        ('[lanes]\nmethod = "x"', ["there is no lane method 'x'", "hint:  one of: cwcli"]),
        ("[lanes]\npreview = -4", ["--preview -4 must be positive"]),
        ('run = {stages = ["control"]}\n[control]\nduration = 0', ["a duration of 0 s is not between"]),
        ("[estimat]\nrate = 1", ["unknown key [estimat]", "did you mean estimate"]),
        ("speed = 1", ["unknown key speed"]),
        ('gates = "a < 1"', ["gates must be a list"]),
        ('gates = ["a <"]', ["can't read the gate `a <`", "hint:"]),
        ('[run]\nstages = ["estimat"]', ["there is no stage estimat", "did you mean estimate"]),
        ('topic = ["ego=/gps"]', ["topic = ego=/gps: there is no role ego", "hint:  roles: ego_position, "]),
        ('topic = ["/gps"]', ["topic = /gps: expected ROLE=/topic", "hint:  roles: ego_position, "]),
        ('topic = ["imu=/a", "imu=/b"]', ["topic = imu is given twice"]),
        ('start = "noon"', ["start = 'noon' is neither seconds nor an ISO 8601 time", "hint:  for example 12.5"]),
        ("end = -1", ["end = -1 is not a time in the log: give seconds from its start, or ISO 8601"]),
        ("start = 5\nend = 2.5", ["end = 2.5 is not after start = 5"]),
        ("[run]\njobs = 1.5", ["run.jobs = '1.5'"]),
        ("[run", ["not TOML"]),
    ],
)
def test_wrong_files_are_one_line_with_file_key_and_hint(
    cwcli: Run, tmp_path: Path, text: str, words: list[str]
) -> None:
    (tmp_path / "p.toml").write_text(text + "\n")
    done = cwcli("config", "p.toml")
    shown = done.stderr.decode()
    assert (done.returncode, done.stdout) == (2, b""), shown
    assert shown.startswith("error: p.toml: ")
    assert all(word in shown for word in words), shown
    assert len(shown.splitlines()) <= 2
    run = cwcli("run", "drive.mcap", "-d", "out", "--config", "p.toml")
    assert run.returncode == 2
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("CWCLI_TOPIC", "ego=/gps", "--topic ego=/gps: there is no role ego"),
        ("CWCLI_START", "noon", "--start 'noon' is neither seconds nor an ISO 8601 time"),
    ],
)
def test_values_of_the_environment_are_checked_too(cwcli: Run, name: str, value: str, words: str) -> None:
    done = cwcli("config", env={name: value})
    assert (done.returncode, done.stdout) == (2, b"")
    assert words in done.stderr.decode()


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("CWCLI_ESTIMATE_MODEL", "foo", "CWCLI_ESTIMATE_MODEL=foo: it must be one of cwcli, song2016"),
        ("CWCLI_QUIET", "maybe", "CWCLI_QUIET=maybe: it must be true or false"),
        ("CWCLI_START", "noon", "hint: --start comes from the environment variable CWCLI_START; for example 12.5"),
        ("CWCLI_START", "50", "hint: --start comes from the environment variable CWCLI_START; the log lasts 10.0 s"),
    ],
)
def test_a_wrong_value_of_the_environment_names_its_variable(cwcli: Run, name: str, value: str, words: str) -> None:
    log = SAMPLES / "intersection.mcap"
    done = cwcli("estimate", log, "-o", "out.mcap", env={name: value})
    assert done.returncode == EXIT_USAGE
    assert words in " ".join(done.stderr.decode().split())
    if name == "CWCLI_START":  # the command line counts more: the variable is not to blame
        done = cwcli("estimate", log, "-o", "out.mcap", "--start", "60", env={name: value})
        assert "--start 60" in done.stderr.decode() and name not in done.stderr.decode()


def test_a_wrong_value_of_a_file_that_only_a_log_tells_names_file_and_key(cwcli: Run, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("start = 50\n")
    done = cwcli("estimate", SAMPLES / "intersection.mcap", "-o", "out.mcap", "--config", "c.toml")
    assert done.returncode == EXIT_USAGE
    assert "--start comes from start in c.toml; the log lasts 10.0 s" in " ".join(done.stderr.decode().split())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["estimate", "LOG", "--topic", "ego_postion=/gps/fix"], "did you mean ego_position?"),
        (["estimate", "LOG", "--map", "ego_sped=/gps/fix:a"], "did you mean ego_speed?"),
        (["report", "LOG", "-o", "r.html", "--topic", "warnng=/a"], "did you mean warning?"),
        (["export", "LOG", "--what", "warnngs"], "did you mean warnings?"),
        (["export", "LOG", "--format", "geojsn"], "did you mean geojson?"),
        (["reproduce", "song2015"], "did you mean song2016?"),
        (["predict", "LOG", "--model", "ctrw"], "did you mean ctrv"),
        (["estimate", "LOG", "--model", "cwclj"], "did you mean cwcli?"),
    ],
)
def test_a_misspelt_name_gets_the_closest_one(cwcli: Run, arguments: list[str], words: str) -> None:
    log = SAMPLES / "intersection.mcap"
    done = cwcli(*(log if each == "LOG" else each for each in arguments))
    assert done.returncode == EXIT_USAGE
    assert words in " ".join(done.stderr.decode().split())


def test_times_of_two_kinds_can_only_be_compared_in_a_log(cwcli: Run, tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text("start = 2026-05-01T12:00:00Z\nend = 3\n")
    document = json.loads(cwcli("config", "p.toml", "--json").stdout)
    assert (document["start"], document["end"]) == ("2026-05-01 12:00:00+00:00", "3")


def test_toml_of_awkward_text() -> None:
    document = {
        "a": 'quote " back \\ tab \t bell \x07 del \x7f é 🚗',
        "b": [],
        "t": {"x": None, "y": [1.5, True], "z": 1e-9},
    }
    read = tomllib.loads(format_toml(document))
    assert read == {"a": document["a"], "b": [], "t": {"y": [1.5, True], "z": 1e-9}}


WRITES = {
    "estimate": ("output", "force", "metrics", "metrics-dir"),
    "run": ("output", "force", "metrics_dir", "directory"),
    "evaluate": ("force", "metrics", "junit", "markdown_file"),
    "compare": ("force", "metrics", "markdown_file"),
    "report": ("output", "force"),
    "simulate": ("output", "force"),
    "layout": ("output", "force"),
    "calibrate": ("output", "force"),
    "reproduce": ("force", "metrics", "plots"),
    "demo": ("directory",),
}


@pytest.mark.parametrize(("command", "key"), [(each, key) for each, keys in WRITES.items() for key in keys])
def test_a_file_says_not_what_is_written(
    command: str, key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Neither in the command's table nor at the top."""
    path, target = tmp_path / "c.toml", tmp_path / "target"
    target.write_text("mine")
    value = "true" if key == "force" else f'"{target}"'
    arguments = (
        ["LOG"] if command not in ("run", "compare", "demo") else ["LOG", "OTHER"] if command == "compare" else []
    )
    for text in (f"[{command}]\n{key} = {value}\n", f"{key} = {value}\n"):
        path.write_text(text)
        assert run_command_line([command, *arguments, "--config", str(path)]) == EXIT_USAGE
        assert f"{key} is for the command line" in capsys.readouterr().err
    assert target.read_text() == "mine"
    assert [each.name for each in tmp_path.iterdir() if each != target] == ["c.toml"]


def test_every_option_that_writes_is_known_as_one() -> None:
    """By what its help says: a new one must be in the list, or be told from those here that write nothing."""
    wrote = set()
    for command in HELP_LINE_BY_COMMAND:
        for each in load_command(command).params:
            words = str(getattr(each, "help", "") or "")
            if words.startswith(("Write ", "Overwrite ")) or each.name in ("directory", "plots"):
                wrote.add(each.name)
    assert wrote == READ_WRITES


def test_the_nearest_file_is_found_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    inner = tmp_path / "drives/monday"
    inner.mkdir(parents=True)
    (tmp_path / "cwcli.toml").write_text('[estimate]\nmodel = "song2016"\n')
    monkeypatch.chdir(inner)
    assert run_command_line(["config", "--json"]) == 0
    found = capsys.readouterr()
    assert json.loads(found.out)["estimate"]["model"] == "song2016"
    assert f"note: defaults from {tmp_path}/cwcli.toml" in found.err.replace("\n      ", "").replace(
        "from", "from "
    ).replace("  ", " ")
    (inner / "cwcli.toml").write_text("[estimate]\nrate = 10\n")
    assert run_command_line(["config", "--json"]) == 0
    nearest = capsys.readouterr()
    document = json.loads(nearest.out)["estimate"]
    assert (document["model"], document["rate"]) == ("cwcli", 10)
    assert "defaults from cwcli.toml" in nearest.err


def test_no_file_is_found_from_a_deleted_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert run_command_line(["config"]) == 0
    assert "defaults from" not in capsys.readouterr().err


def test_no_file_is_found_in_a_closed_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def closed(path: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Path, "is_file", closed)
    assert run_command_line(["config"]) == 0


def test_a_found_file_is_silent_when_quiet_and_can_be_left_out(cwcli: Run, tmp_path: Path) -> None:
    (tmp_path / "cwcli.toml").write_text("strict = 7\n")
    assert cwcli("simulate", "straight", "-o", "drive.mcap").stderr == b""  # it has no such option
    estimate = ("estimate", "drive.mcap", "-o", "estimated.mcap")
    refused = cwcli(*estimate)
    assert refused.returncode == EXIT_USAGE and b"strict must be true or false" in refused.stderr
    (tmp_path / "cwcli.toml").write_text("strict = true\n")
    assert cwcli(*estimate, "-q").stderr == b""
    assert b"defaults from cwcli.toml" in cwcli(*estimate, "-f").stderr
    assert b"cwcli.toml" not in cwcli(*estimate, "-f", "--config", "none").stderr
