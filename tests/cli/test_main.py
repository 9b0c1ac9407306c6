"""Whatever happens becomes a documented exit code and the right lines on stderr."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from cwcli import errors
from cwcli.cli import app, main
from cwcli.cli.commands import HELP_LINE_BY_COMMAND
from cwcli.cli.console import format_error
from cwcli.stages import STAGES

PYTHON = sys.executable
ROOT = Path(__file__).parents[2]


def cwcli(*arguments: str, **settings: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [PYTHON, "-m", "cwcli", *arguments], capture_output=True, text=True, check=False, timeout=600, **settings
    )


def test_error_has_the_documented_form() -> None:
    error = errors.MissingSignalError(
        "no channel holds the ego state (needed by `cwcli predict`)",
        where="drive.mcap",
        found=("/gps/fix (sensor_msgs/msg/NavSatFix)", "/camera/front (foxglove.CompressedImage)"),
        hint="run `cwcli estimate drive.mcap -o estimated.mcap` first",
    )
    assert format_error(error) == (
        "error: drive.mcap: no channel holds the ego state (needed by `cwcli predict`)\n"
        "  found: /gps/fix (sensor_msgs/msg/NavSatFix), /camera/front (foxglove.CompressedImage)\n"
        "  hint:  run `cwcli estimate drive.mcap -o estimated.mcap` first"
    )


def test_error_lists_much_found_on_several_lines() -> None:
    error = errors.MissingSignalError("none", found=tuple(f"/topic/{i} (package/msg/Type)" for i in range(9)))
    lines = format_error(error).split("\n")
    assert lines[0] == "error: none"
    assert lines[1] == "  found: /topic/0 (package/msg/Type), /topic/1 (package/msg/Type), /topic/2 (package/msg/Type),"
    assert lines[2].startswith("         /topic/3 (package/msg/Type), ")
    assert len(lines) == 4


def test_error_fits_the_terminal() -> None:
    error = errors.MissingSignalError(
        "no channel holds the ego position (needed by `cwcli run`)",
        where="../shared/logs/psu-testtrack-1obu.mcap",
        found=("/v2x/bsm (BasicSafetyMessage)", "/v2x/bsm/second/channel (BasicSafetyMessage)"),
        hint="name it: --ego-station 2a3c600d",
    )
    assert format_error(error, 80) == (
        "error: ../shared/logs/psu-testtrack-1obu.mcap: no channel holds the ego\n"
        "         position (needed by `cwcli run`)\n"
        "  found: /v2x/bsm (BasicSafetyMessage), /v2x/bsm/second/channel\n"
        "         (BasicSafetyMessage)\n"
        "  hint:  name it: --ego-station 2a3c600d"
    )


def test_error_escapes_control_characters() -> None:
    error = errors.InputError("bad\x1b[2J", where="a\nb", found=("\x07",), hint="\x9b")
    assert format_error(error) == "error: a\\nb: bad\\x1b[2J\n  found: \\x07\n  hint:  \\x9b"


@pytest.mark.parametrize(
    ("raised", "code"),
    [
        (errors.UsageError("usage"), 2),
        (errors.InputError("input"), 3),
        (errors.MissingSignalError("missing"), 4),
        (errors.DataError("data"), 5),
        (errors.OutputError("output"), 6),
        (KeyboardInterrupt(), 130),
        (BrokenPipeError(32, "Broken pipe"), 141),
        (ValueError("a bug"), 70),
        (MemoryError(), 70),
        (RecursionError("deep"), 70),
        (GeneratorExit(), 70),
    ],
    ids=lambda value: value if isinstance(value, int) else type(value).__name__,
)
def test_exit_codes(
    raised: BaseException, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def dispatch(arguments: list[str]) -> int:
        raise raised

    monkeypatch.setattr(app, "dispatch_command", dispatch)
    assert main.run_command_line([]) == code
    printed = capsys.readouterr()
    assert printed.out == ""
    assert ("Traceback" in printed.err) == (code == 70)
    if isinstance(raised, errors.CwcliError):
        assert printed.err == f"error: {raised.what}\n"
    if code == 70:
        assert "a bug in cwcli" in printed.err
        assert "please report it" in printed.err
    if code == 141:
        assert printed.err == ""


@pytest.mark.parametrize(("raised", "code"), [(errors.Terminated(), 143), (KeyboardInterrupt(), 130)])
def test_signal_that_python_turned_into_another_error_ends_the_run(
    raised: BaseException, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Python 3.11 raises a RuntimeError for what comes while it makes a class: SIGTERM ended with exit code 70."""

    def dispatch(arguments: list[str]) -> int:
        raise RuntimeError("Error calling __set_name__") from raised

    monkeypatch.setattr(app, "dispatch_command", dispatch)
    try:
        assert main.run_command_line([]) == code
    except errors.Terminated as ended:
        assert ended.code == code
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        *(
            ["evaluate", "NAME"],
            ["compare", "NAME", "NAME"],
            ["report", "NAME", "-o", "out.html"],
            ["find", "NAME", "all"],
        ),
        *(["simulate", "NAME", "-o", "out.mcap"], ["conform", "NAME"], ["view", "NAME"], ["estimate", "NAME"]),
        ["find", "log.mcap", "NAME"],
    ],
    ids=" ".join,
)
def test_name_that_is_too_long_for_a_file_is_no_bug(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Python raises an OSError for a name of more than 255 octets, as an expression of `find` easily is."""
    monkeypatch.chdir(tmp_path)
    assert main.run_command_line(["n" * 300 if each == "NAME" else each for each in arguments]) in (2, 3)
    assert capsys.readouterr().err.startswith("error: ")


def kinds_of_errors(kind: type[errors.CwcliError] = errors.CwcliError) -> set[type[errors.CwcliError]]:
    return {kind}.union(*(kinds_of_errors(each) for each in kind.__subclasses__()))


def test_every_exit_code_stands_in_the_one_table() -> None:
    assert {value for name, value in vars(errors).items() if re.fullmatch(r"EXIT_(?!CODES)\w+", name)} == {
        *errors.EXIT_CODES
    }
    assert {kind.exit_code for kind in kinds_of_errors()} <= {*errors.EXIT_CODES}
    others = [path for path in (ROOT / "cwcli").rglob("*.py") if path.name != "errors.py"]
    assert [
        path for path in others if re.search(r"^EXIT_\w+ = \d", path.read_text(encoding="utf-8"), re.MULTILINE)
    ] == []


def test_every_exit_code_that_the_docs_name_is_in_the_table() -> None:
    named = set()
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        named |= {int(code) for code in re.findall(r"[Ee]xit code (?:is )?(\d+)", page.read_text(encoding="utf-8"))}
    assert len(named) >= 6
    assert named <= {*errors.EXIT_CODES}


def test_help_and_docs_say_what_the_table_says(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run_command_line(["--help"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    commands = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    for code, (meaning, more) in errors.EXIT_CODES.items():
        assert f"{code} {meaning}" in told and f"{code} {meaning}" in readme
        assert f"| {code} | {meaning} | {more} |" in commands


def test_help_needs_no_command_module() -> None:
    found = subprocess.run(
        [PYTHON, "-X", "importtime", "-m", "cwcli", "--help"], capture_output=True, text=True, check=True
    )
    assert all(f" {module}" not in found.stderr for module in ("cwcli.cli.commands.", "cwcli.stages.", "numpy"))
    for name in HELP_LINE_BY_COMMAND:
        assert f"  {name} " in found.stdout


def test_version() -> None:
    assert cwcli("--version").stdout == "cwcli 0.1.0\n"


def test_no_command_prints_the_help_on_stderr() -> None:
    done = cwcli()
    assert done.returncode == 2
    assert done.stdout == ""
    assert "Usage: cwcli" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "line", "hint"),
    [
        (["inf"], "error: no such command 'inf'. Did you mean 'info'?", "cwcli --help"),
        (["info"], "error: missing argument 'LOG'", "cwcli info --help"),
        (["info", "a.mcap", "--nothing"], "error: no such option: --nothing", "cwcli info --help"),
        (["layout", "a.mcap", "b.mcap"], "error: got unexpected extra argument", "cwcli layout --help"),
        (["--nothing"], "error: no such option: --nothing", "cwcli --help"),
    ],
)
def test_usage_errors_leave_with_2(arguments: list[str], line: str, hint: str) -> None:
    done = cwcli(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(line)
    assert done.stderr.endswith(f"\n  hint:  see `{hint}`\n")
    assert done.stderr.count("\n") == 2


@pytest.mark.parametrize("name", ["", *HELP_LINE_BY_COMMAND])
def test_help_has_an_example_and_fits_80_columns(name: str) -> None:
    done = cwcli(*name.split(), "--help", env={**os.environ, "COLUMNS": "200"})
    assert done.returncode == 0
    assert done.stderr == ""
    assert "Example" in done.stdout
    assert f"  cwcli {name}" in done.stdout
    assert "\x1b" not in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 80


@pytest.mark.parametrize("name", [*HELP_LINE_BY_COMMAND])
def test_examples_parse(name: str) -> None:
    import shlex

    command = app.load_command(name)
    examples = [line for line in command.epilog.splitlines() if line.startswith("  ")]
    assert examples
    for example in examples:
        for part in example.split("|"):
            words = shlex.split(part.partition(">")[0] if name == "config" else part, comments=True)
            if words[:2] == ["cwcli", name]:
                command.make_context(name, words[2:])


@pytest.mark.parametrize(
    ("command", "headings"),
    [
        ("run", ["Arguments", "Pipeline", "Many logs", "Output", "Input", "General", *(f"Stage {s}" for s in STAGES)]),
        ("warn", ["Arguments", "Options", "Output", "Input", "General"]),
        ("estimate", ["Arguments", "Options", "Output", "Input", "General"]),
        ("compare", ["Arguments", "Options", "General", "Output"]),
        ("info", ["Arguments", "Options", "Input", "General"]),
        ("join", ["Arguments", "Options"]),
    ],
)
def test_many_options_stand_under_headings(
    command: str, headings: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run_command_line([command, "--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line[:-1] for line in lines if line.endswith(":") and line[0] != " "][: len(headings)] == headings


def test_an_option_stands_under_the_heading_of_its_group(capsys: pytest.CaptureFixture[str]) -> None:
    main.run_command_line(["run", "--help"])
    groups = {part.split(":")[0]: part for part in capsys.readouterr().out.split("\n\n")}
    for heading, flags in {
        "Pipeline": ["--stage", "--tables", "--gate"],
        "Many logs": ["--directory", "--jobs", "--ray"],
        "Output": ["--output", "--force", "--metrics-dir"],
        "Input": ["--topic", "--start", "--clock", "--ego-station"],
        "General": ["--json", "--quiet", "--config", "--help"],
        "Stage warn": ["--warn-rule", "--warn-horizon"],
    }.items():
        assert all(flag in groups[heading] for flag in flags), heading
        assert ("--warn-" in groups[heading]) == (heading == "Stage warn")


def test_help_into_a_closed_pipe_leaves_with_141() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [PYTHON, "-m", "cwcli", "--help"], stdout=writer, stderr=subprocess.PIPE, text=True, check=False
    )
    os.close(writer)
    assert done.returncode == 141
    assert done.stderr == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_full_disk_behind_stdout_leaves_with_6() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [PYTHON, "-m", "cwcli", "--help"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 6
    assert done.stderr == "error: can't write the output: No space left on device\n"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_script(shell: str) -> None:
    done = cwcli(env={**os.environ, "_CWCLI_COMPLETE": f"source_{shell}"})
    assert done.returncode == 0
    assert "_CWCLI_COMPLETE=complete_" + shell in done.stdout.replace(" ", "").replace('"', "") or shell in done.stdout


def test_completion_of_commands_and_options() -> None:
    def complete(words: str, index: int) -> list[str]:
        done = cwcli(
            env={**os.environ, "_CWCLI_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(index)}
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    assert complete("cwcli in", 1) == ["info"]
    assert "--strict" in complete("cwcli info --s", 2)
    assert complete("cwcli info --clock ", 3) == ["stamp", "log"]


LOG = ROOT / "sample_logs" / "intersection.mcap"


def offered(shell: str, *words: str) -> list[str]:
    """What a shell is told at the end of the last word. Bash takes `a=b` for three words, each on a line."""
    asked = {"_CWCLI_COMPLETE": f"complete_{shell}"}
    if shell == "bash":
        parts = [part for word in words for part in re.split("(=)", word) if part or not word]
        asked |= {"COMP_WORDS": "\n".join(parts), "COMP_CWORD": str(len(parts) - 1)}
    else:
        line = " ".join(words)
        asked |= {
            "_TYPER_COMPLETE_ARGS": line,
            "_TYPER_COMPLETE_FISH_ACTION": "get-args",
            "_TYPER_COMPLETE_WORD_TO_COMPLETE": words[-1],
        }
    done = cwcli(env={**os.environ, **asked})
    assert (done.returncode, done.stderr) == (0, "")
    return [line.split("\t")[0] for line in done.stdout.splitlines() if line]


def test_roles_and_the_topics_of_the_log_are_completed() -> None:
    roles = offered("fish", "cwcli", "estimate", str(LOG), "--topic", "")
    assert roles[:3] == ["ego_position=", "ego_velocity=", "ego_speed="]
    topics = ["/gps/fix", "/gps/heading"]
    assert offered("fish", "cwcli", "estimate", str(LOG), "--topic", "ego_pos=/gps") == [
        f"ego_pos={each}" for each in topics
    ]
    assert offered("bash", "cwcli", "estimate", str(LOG), "--topic", "ego_position=/gps") == topics
    everything = offered(
        "bash", "cwcli", "run", "-o", "out.mcap", str(LOG), "--topic", "imu=/imu/data", "--topic", "ego_position="
    )
    assert everything == sorted(
        [*topics, "/vehicle/velocity", "/imu/data", "/v2x/bsm", "/truth/ego", "/simulation/vehicles"]
    )
    assert offered("bash", "cwcli", "evaluate", str(LOG), "--topic", "w") == [f"warning={each}" for each in everything]


def test_completion_of_topics_never_fails_or_talks(tmp_path: Path) -> None:
    """Of no log, and of one that is none, was cut, or has a damaged summary."""
    whole = LOG.read_bytes()
    damaged = {
        "text": b"no log",
        "empty": b"",
        "cut": whole[:-500],
        "wrong": whole[:-400] + b"\xff" * 300 + whole[-100:],
    }
    for name, content in damaged.items():
        (tmp_path / f"{name}.mcap").write_bytes(content)
        assert offered("bash", "cwcli", "info", str(tmp_path / f"{name}.mcap"), "--topic", "imu=/") in (
            [],
            ["/imu/data"],
        )
    for words in (["-"], [str(tmp_path / "none.mcap")], ["https://localhost:1/log.mcap"], []):
        assert offered("bash", "cwcli", "info", *words, "--topic", "imu=/") == []
    assert offered("bash", "cwcli", "info", "--topic", "im") == ["imu="]


@pytest.mark.parametrize(
    ("moment", "code"),
    [("raise KeyboardInterrupt", 130), ("atexit.register(os.kill, os.getpid(), signal.SIGINT)", 0)],
    ids=["while the last lines are printed", "after the exit code is settled"],
)
def test_ctrl_c_at_the_very_end_prints_no_traceback(moment: str, code: int) -> None:
    program = f"""
import atexit, os, signal
from cwcli.cli import main
def run_command_line(arguments):
    {moment}
    return 0
main.run_command_line = run_command_line
main.main()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False, timeout=600)
    assert (done.returncode, done.stderr) == (code, b"")
