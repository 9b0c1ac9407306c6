"""No written file is an input: every option that writes, of every command, under every name of the file."""

from __future__ import annotations

import ast
import os
import shutil
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import cwcli
from cwcli.cli.app import load_command
from cwcli.cli.commands import HELP_LINE_BY_COMMAND, reproduce
from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_NOT_WRITTEN, EXIT_USAGE
from cwcli.reproduction.findings import Curve, Plot, StudyPart
from cwcli.reproduction.findings_report import Reproduction, assemble_reproduction
from cwcli.stages import STAGES

ROOT = Path(__file__).parents[2]
FORBIDDEN = "the input itself"

ARGUMENTS = {
    **{stage: ["LOG"] for stage in STAGES},
    "join": ["LOG", "OTHER"],
    "calibrate": ["LOG"],
    "observe": ["LOG", "--vehicle", "CAR"],
    "run": ["LOG", "--observe-vehicle", "CAR"],
    "evaluate": ["LOG"],
    "compare": ["LOG", "OTHER"],
    "report": ["LOG"],
    "simulate": ["SCENARIO", "--actors", "LOG"],
    "reproduce": ["song2016"],
    "layout": ["LOG"],
    "export": ["LOG"],
    "import": ["TABLE"],
    "plot": ["LOG"],
    "view": ["LOG"],
    "cut": ["LOG", "--end", "1"],
    "find": ["LOG", "hard-brake"],
    "conform": ["nhtsa-fcw", "--log", "LOG"],
}
"""Each command with everything that it can read, beside the configuration."""
READING = {
    *("config", "file", "dbc", "expect", "vehicle", "observe__vehicle", "calibration", "labelled", "log", "actors"),
    *("model", "lanes__model", "mapping", "times"),
}
"""Parameters with a file that is read."""
FOLDERS = {"metrics_dir", "directory", "plots", "report", "clips"}
"""Each has tests of its own below."""


def file_parameters() -> Iterator[tuple[str, str, str]]:
    """Command, name and spelling of each option with a file or a folder."""
    for command in HELP_LINE_BY_COMMAND:
        for parameter in load_command(command).params:
            if parameter.metavar in {"FILE", "DIR", "LOG", "SOURCE", "BASELINE", "CANDIDATE"} and parameter.opts:
                yield command, str(parameter.name), max(parameter.opts, key=len)


WRITING = [
    (command, option)
    for command, name, option in file_parameters()
    if option.startswith("--") and name not in READING | FOLDERS
]
CASES = [
    (command, option, token, kind)
    for command, option in WRITING
    for token in (*(each for each in ARGUMENTS[command] if each.isupper()), "CONFIG")
    for kind in ("same", "symlink", "hard link", "descriptor")
    if not (command == "find" and kind == "descriptor")  # no table's name
    and not (option == "--metrics" and (kind == "descriptor" or (kind, token) == ("same", "CAR")))  # no table's name
    and command != "calibrate"  # below: its output ends in .toml
]


@pytest.fixture
def files(predicted: Path, tmp_path: Path) -> dict[str, Path]:
    """One file for each thing that can be read."""
    found = {token: tmp_path / f"{token}.csv" for token in ("LOG", "OTHER", "SCENARIO", "CONFIG")}
    found["CAR"] = tmp_path / "car.toml"
    for token in ("LOG", "OTHER"):
        shutil.copy(predicted, found[token])
    shutil.copy(ROOT / "sample_logs" / "straight.toml", found["SCENARIO"])
    shutil.copy(next((ROOT / "cwcli" / "dynamics" / "vehicles").glob("*.toml")), found["CAR"])
    found["CONFIG"].write_text("quiet = true\n")
    found["TABLE"] = tmp_path / "TABLE.csv"
    rows = [f"{1_700_000_000 + k},{48.0 + 1e-4 * k:.4f},11.0" for k in range(20)]
    found["TABLE"].write_text("\n".join(["unix_time_s,latitude_deg,longitude_deg", *rows]) + "\n")
    return found


def state(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Every file below a folder: its number and its bytes."""
    return {
        str(path.relative_to(folder)): (path.lstat().st_ino, path.read_bytes())
        for path in sorted(folder.rglob("*"))
        if stat.S_ISREG(path.stat().st_mode)
    }


def test_every_option_with_a_file_is_known() -> None:
    """Whoever adds an option with a file says here whether it is read or written."""
    names = {name for _, name, option in file_parameters() if option.startswith("--")}
    assert names == READING - {"file"} | FOLDERS | {"output", "metrics", "junit", "html", "markdown_file", "comment"}
    assert {command for command, _ in WRITING} == set(ARGUMENTS)


def test_an_option_that_writes_says_file_or_dir() -> None:
    for command in HELP_LINE_BY_COMMAND:
        for parameter in load_command(command).params:
            help_text = str(getattr(parameter, "help", "") or "")
            if help_text.startswith(("Write", "Draw")) and not getattr(parameter, "is_flag", False):
                assert parameter.metavar in {"FILE", "DIR"}, (command, parameter.name)


@pytest.mark.parametrize(("command", "option", "token", "kind"), CASES)
def test_an_input_is_no_output(
    files: dict[str, Path],
    tmp_path: Path,
    command: str,
    option: str,
    token: str,
    kind: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    target = str(tmp_path / "link.csv")
    with files[token].open("rb") as open_file:
        if kind == "same":
            target = str(files[token])
        elif kind == "symlink":
            Path(target).symlink_to(files[token])
        elif kind == "hard link":
            Path(target).hardlink_to(files[token])
        else:
            target = f"/dev/fd/{open_file.fileno()}"
        before = state(tmp_path)
        given = [str(files.get(each, each)) for each in ARGUMENTS[command]]
        code = run_command_line([command, *given, "--config", str(files["CONFIG"]), option, target, "--force"])
    error = capsys.readouterr().err
    assert code == EXIT_NOT_WRITTEN, error
    assert error.count("error: ") == 1
    assert FORBIDDEN in error
    assert state(tmp_path) == before


@pytest.mark.parametrize("kind", ["same", "symlink", "hard link"])
@pytest.mark.parametrize("token", ["LOG", "CONFIG"])
def test_a_calibration_is_no_input(
    files: dict[str, Path], tmp_path: Path, token: str, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    read = files[token].rename(tmp_path / f"{token}.toml")
    files = files | {token: read}
    target = read if kind == "same" else tmp_path / "link.toml"
    if kind != "same":
        target.symlink_to(read) if kind == "symlink" else target.hardlink_to(read)
    before = state(tmp_path)
    code = run_command_line(
        ["calibrate", str(files["LOG"]), "--config", str(files["CONFIG"]), "-o", str(target), "--force"]
    )
    assert code == EXIT_NOT_WRITTEN
    assert FORBIDDEN in capsys.readouterr().err
    assert state(tmp_path) == before


@pytest.mark.parametrize(("command", "first", "second"), [
    *((command, "-o", "--metrics") for command, option in WRITING if option == "--metrics" and command in STAGES),
    ("evaluate", "--junit", "--markdown"),
    ("evaluate", "--metrics", "--junit"),
    ("compare", "--metrics", "--markdown"),
])  # fmt: skip
@pytest.mark.parametrize("kind", ["same", "symlink", "hard link"])
def test_two_outputs_are_two_files(
    files: dict[str, Path],
    tmp_path: Path,
    command: str,
    first: str,
    second: str,
    kind: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    one, two = tmp_path / "one.csv", tmp_path / "two.csv"
    if kind == "same":
        two = tmp_path / "." / one.name
    else:
        one.write_text("old")
        two.symlink_to(one) if kind == "symlink" else two.hardlink_to(one)
    before = state(tmp_path)
    given = [str(files.get(each, each)) for each in ARGUMENTS[command]]
    assert run_command_line([command, *given, first, str(one), second, str(two), "--force"]) == EXIT_USAGE
    assert "two outputs are the same file" in capsys.readouterr().err
    assert state(tmp_path) == before


@pytest.mark.parametrize("command", ["run", "control"])
@pytest.mark.parametrize("kind", ["symlink", "hard link"])
def test_a_table_in_a_folder_is_no_input(
    files: dict[str, Path], tmp_path: Path, command: str, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "tables"
    arguments = [command, str(files["LOG"]), "--replace", "--metrics-dir", str(folder), "--force"]
    arguments += ["--stage", "predict"] if command == "run" else []
    warned = tmp_path / "warned.mcap"
    if command == "control":
        assert run_command_line(["warn", str(files["LOG"]), "-o", str(warned)]) == 0
        warned.rename(files["LOG"])
    assert run_command_line(arguments) == 0
    table = sorted(folder.iterdir())[-1]
    table.unlink()
    table.symlink_to(files["LOG"]) if kind == "symlink" else table.hardlink_to(files["LOG"])
    before = state(tmp_path)
    capsys.readouterr()
    assert run_command_line(arguments) == EXIT_NOT_WRITTEN
    assert FORBIDDEN in capsys.readouterr().err
    assert state(tmp_path) == before


def a_reproduction() -> Reproduction:
    plots = [
        Plot(name, "A line", "x", "y", (Curve("measured", np.arange(3.0), np.arange(3.0)),))
        for name in ("fig 1", "fig 2")
    ]
    return assemble_reproduction("song2016", [StudyPart((), tuple(plots))], "no seeds")


def test_a_figure_is_no_input(
    files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "plots"
    folder.mkdir()
    outcome = a_reproduction()
    monkeypatch.setattr(reproduce, "import_module_attribute", lambda name: lambda request: outcome)
    (folder / "fig-2.png").hardlink_to(files["CONFIG"])
    arguments = ["reproduce", "song2016", "--config", str(files["CONFIG"]), "--plots", str(folder)]
    before = state(tmp_path)
    assert run_command_line([*arguments, "--metrics", str(tmp_path / "numbers.csv"), "--force"]) == EXIT_NOT_WRITTEN
    assert FORBIDDEN in capsys.readouterr().err
    assert state(tmp_path) == before


@pytest.mark.parametrize("name", ["song2016.md", "figures/song2016/fig-2.png"])
def test_a_page_on_a_paper_is_no_input(
    name: str,
    files: dict[str, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path / "papers"
    (folder / "figures" / "song2016").mkdir(parents=True)
    made = a_reproduction()
    monkeypatch.setattr(reproduce, "import_module_attribute", lambda name: lambda request: made)
    (folder / name).hardlink_to(files["CONFIG"])
    before = state(tmp_path)
    arguments = ["reproduce", "song2016", "--config", str(files["CONFIG"]), "--report", str(folder)]
    assert run_command_line([*arguments, "--metrics", str(tmp_path / "numbers.csv"), "--force"]) == EXIT_NOT_WRITTEN
    assert FORBIDDEN in capsys.readouterr().err
    assert state(tmp_path) == before


@pytest.mark.parametrize("name", ["manifest.json", "run_times.json"])
@pytest.mark.parametrize("kind", ["same", "symlink", "hard link"])
@pytest.mark.parametrize("token", ["LOG", "CONFIG"])
def test_what_a_run_over_many_logs_writes_is_no_input(
    files: dict[str, Path], tmp_path: Path, name: str, kind: str, token: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    if kind == "same":
        files[token] = files[token].rename(out / name)
    elif kind == "symlink":
        (out / name).symlink_to(files[token])
    else:
        (out / name).hardlink_to(files[token])
    before = state(tmp_path)
    arguments = ["run", str(files["LOG"]), "-d", str(out), "--config", str(files["CONFIG"]), "--force"]
    assert run_command_line(arguments) == EXIT_NOT_WRITTEN
    assert FORBIDDEN in capsys.readouterr().err
    assert state(tmp_path) == before


@pytest.mark.parametrize("part", ["logs/LOG", "details", "tables"])
def test_what_a_run_over_many_logs_removes_is_no_input(
    files: dict[str, Path], tmp_path: Path, part: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out" / part
    folder.mkdir(parents=True)
    config = files["CONFIG"].rename(folder / "config.toml")
    before = state(tmp_path)
    assert (
        run_command_line(["run", str(files["LOG"]), "-d", str(tmp_path / "out"), "--config", str(config), "--force"])
        == EXIT_NOT_WRITTEN
    )
    assert "an input is in the folder of the results" in capsys.readouterr().err
    assert state(tmp_path) == before


def test_the_demo_does_not_overwrite_its_configuration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "intersection.annotated.mcap"
    config.write_text("quiet = true\n")
    assert run_command_line(["demo", "-d", str(tmp_path), "--config", str(config)]) == EXIT_NOT_WRITTEN
    assert FORBIDDEN in capsys.readouterr().err
    assert config.read_text() == "quiet = true\n"


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of a run."""
    folder = tmp_path_factory.mktemp("fleet")
    log = shutil.copy(ROOT / "sample_logs" / "straight.mcap", folder)
    assert run_command_line(["run", str(log), "-d", str(folder / "out"), "--jobs", "1", "--quiet"]) == 0
    return folder / "out"


ENTRIES = ("manifest.json", "logs/straight/entry.json")
METRICS_OF_LOG, ANNOTATED_LOG = "metrics.parquet", "logs/straight/annotated.mcap"
READ_OF_RUN = [
    (["evaluate", "OUT", "--junit"], (*ENTRIES, METRICS_OF_LOG)),
    (["evaluate", "OUT", "--truth", "none", "--markdown"], (*ENTRIES, METRICS_OF_LOG, ANNOTATED_LOG)),
    (["compare", "OUT", "OUT", "--markdown"], (*ENTRIES, METRICS_OF_LOG)),
]


@pytest.mark.parametrize(("arguments", "name"), [(given, name) for given, names in READ_OF_RUN for name in names])
def test_the_files_of_a_run_are_no_outputs(
    fleet: Path, name: str, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    before = state(fleet)
    given = [str(fleet) if each == "OUT" else each for each in arguments]
    assert run_command_line([*given, str(fleet / name), "--force"]) == EXIT_NOT_WRITTEN
    assert FORBIDDEN in capsys.readouterr().err
    assert state(fleet) == before


def in_shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    line = line.replace("cwcli", f"{sys.executable} -m cwcli")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=False, cwd=folder, env=environment)


@pytest.mark.parametrize("line", [
    "cwcli estimate - -o LOG.csv --force < LOG.csv",
    "cwcli estimate /dev/stdin -o LOG.csv --force < LOG.csv",
    "cwcli estimate LOG.csv -o /dev/fd/3 --force 3<> LOG.csv",
    "cwcli estimate LOG.csv -o /proc/self/fd/0 --force < LOG.csv",
    "cwcli estimate LOG.csv -o - >> LOG.csv",
    "cwcli evaluate LOG.csv --markdown - >> LOG.csv",
    "cwcli info LOG.csv >> LOG.csv",
    "cwcli info - < LOG.csv >> LOG.csv",
    "cwcli config CONFIG.csv >> CONFIG.csv",
])  # fmt: skip
def test_redirections_are_names_too(files: dict[str, Path], tmp_path: Path, line: str) -> None:
    before = state(tmp_path)
    done = in_shell(line, tmp_path)
    assert done.returncode == EXIT_NOT_WRITTEN, done.stderr
    assert FORBIDDEN in done.stderr
    assert state(tmp_path) == before


OPENERS = {
    "input.py": "reads every input",
    "output.py": "writes every output",
    "temporary.py": "a part of it",
    "array_memory.py": "a file without a name for the arrays of long logs",
    "report/pdf.py": "the page and its print in a temporary folder of the browser",
    "logs/read/source.py": "the pipe that a log comes from, and its copy without a name",
    "logs/read/remote.py": "a remote log, which is copied to a file without a name",
    "logs/read/sqlite_files.py": "a private copy of a database and its journals",
    "logs/read/http_blocks.py": "a remote log",
    "logs/read/reader_child.py": "the file without a name that its parent gave to it, and its own memory",
    "conformance/online.py": "a log in memory",
    "conformance/clause.py": "comes with cwcli",
    "simulate/sensor_log.py": "comes with cwcli",
    "fleet/inputs.py": "the copy of a remote log",
    "importing/bounded_import.py": "a pipe between the two processes of an import",
    "fleet/merge.py": "a log of a shard, which it copies where it can't be linked",
    "fleet/folder.py": "what an earlier run into the same folder has done",
    "fleet/tables.py": "both ends of the tables that an earlier run into the same folder has written",
    "fleet/run.py": "the lock of the output folder",
    "fleet/remote_folder.py": "the lock of a working folder of its own",
    "bounded_child.py": "a pipe to its parent, and the size of its own process",
    "cli/main.py": "the null device",
    "conformance/cache.py": "results of earlier trials, which only `cwcli conform --cache` writes",
    "registry.py": "what tells of a plug-in",
    "logs/encoders/schemas.py": "comes with cwcli",
    "export/osi.py": "what it has just written",
    "dynamics/vehicle.py": "comes with cwcli",
    "prediction/fleet.py": "comes with cwcli",
    "simulation/catalogue.py": "comes with cwcli",
    "report/page.py": "comes with cwcli",
    "signals/radio/program.py": "comes with cwcli",
    "signals/v2x_tables.py": "comes with cwcli",
    "reproduction/expectations.py": "comes with cwcli",
    **dict.fromkeys(
        (
            f"importing/{name}.py"
            for name in ("bounded_xml", "text_file", "readers/delimited", "readers/parquet", "readers/ubx")
        ),
        "a file that is imported, which `cwcli import` refuses as an output",
    ),
    "importing/readers/phone.py": "a file in the archive that is imported",
    "importing/temporary_log.py": "the log that it has just written",
}
"""Modules that open files themselves, and which."""
OPENING = {"open", "fdopen", "read_bytes", "read_text", "write_bytes", "write_text", "savefig", "mmap"}


def test_files_are_opened_in_known_places_only() -> None:
    """Whatever else reads or writes goes through `cwcli.input` and `cwcli.output`, so that no command can forget it."""
    package = Path(cwcli.__file__).parent
    found = set()
    for path in package.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and _opens(node):
                found.add(path.relative_to(package).as_posix())
    assert found == set(OPENERS)


def _opens(node: ast.Call) -> bool:
    owner, _, name = ast.unparse(node.func).rpartition(".")
    is_ours = owner in {"Log", "reader.Log", "InputFile", "cls"}
    is_in_memory = bool(node.args) and ast.unparse(node.args[0]).startswith(("io.BytesIO", "pa.BufferReader", "sink"))
    opens = (name in OPENING and not is_ours) or (owner, name) == ("parquet", "read_table")
    return opens and not is_in_memory
