"""The stages from the command line: files, pipes, JSON, refusals, and what ends a run early."""

from __future__ import annotations

import hashlib
import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tests.cli.conftest import ROOT, Run

STATE_TOPICS = {"/cwcli/ego/state", "/cwcli/remote/state"}
PATH_TOPICS = {"/cwcli/ego/path", "/cwcli/remote/path", "/cwcli/paths/scene"}
WARNING_TOPICS = {"/cwcli/warnings", "/cwcli/log"}


def messages(data: bytes) -> list[tuple[str, int, bytes]]:
    """Topic, log time and payload of every message, by the official reader with CRC validation."""
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    return [(channel.topic, message.log_time, message.data) for _, channel, message in reader.iter_messages()]


def topics(path: Path) -> set[str]:
    return {topic for topic, _, _ in messages(path.read_bytes())}


def test_run_adds_channels_and_keeps_every_message(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    done = cwcli("run", intersection, "-o", "out.mcap", "--metrics-dir", "metrics")
    assert done.returncode == 0, done.stderr.decode()
    before = messages(intersection.read_bytes())
    after = messages((tmp_path / "out.mcap").read_bytes())
    added = [entry for entry in after if entry[0].startswith("/cwcli/")]
    assert sorted(entry for entry in after if not entry[0].startswith("/cwcli/")) == sorted(before)
    assert {topic for topic, _, _ in added} >= STATE_TOPICS | PATH_TOPICS | WARNING_TOPICS
    shown = done.stdout.decode()
    assert max(map(len, shown.splitlines())) <= 80
    assert "\x1b" not in shown + done.stderr.decode()
    assert "wrote out.mcap" in shown
    for path in (tmp_path / "metrics").iterdir():
        assert f"wrote metrics/{path.name}" in shown
    assert {"estimate.parquet", "prediction.parquet"} & {path.name for path in (tmp_path / "metrics").iterdir()}


def test_pipe_gives_the_same_as_run(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    command = f"{sys.executable} -m cwcli"
    done = subprocess.run(
        [
            "bash",
            "-o",
            "pipefail",
            "-c",
            f"{command} estimate {intersection} -o - | {command} predict - -o - | "
            f"{command} warn - -o {tmp_path}/w.mcap",
        ],
        capture_output=True,
        check=False,
        cwd=ROOT,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr.decode()
    assert cwcli("run", intersection, "-o", "r.mcap", "--quiet").returncode == 0
    assert sorted(messages((tmp_path / "w.mcap").read_bytes())) == sorted(messages((tmp_path / "r.mcap").read_bytes()))


def test_fewer_paths_in_the_log_leave_warnings_and_metrics_as_they_are(
    cwcli: Run, intersection: Path, tmp_path: Path
) -> None:
    for name, more in (("all", ("--predict-path-rate", "1000")), ("some", ())):
        done = cwcli("run", intersection, "-q", "-o", f"{name}.mcap", "--metrics-dir", name, *more)
        assert done.returncode == 0, done.stderr.decode()
    whole, fewer = ((tmp_path / f"{name}.mcap").read_bytes() for name in ("all", "some"))
    topics = {"/cwcli/ego/path", "/cwcli/remote/path"}
    every, some = ([each for each in messages(data) if each[0] in topics] for data in (whole, fewer))
    assert 0 < len(some) < 0.4 * len(every)
    assert set(some) <= set(every)
    others = ([each for each in messages(data) if each[0] not in topics] for data in (whole, fewer))
    assert sorted(next(others)) == sorted(next(others))
    assert len(fewer) < 0.9 * len(whole)  # a path with points a quarter of a second apart is small
    for table in sorted((tmp_path / "all").iterdir()):
        assert table.read_bytes() == (tmp_path / "some" / table.name).read_bytes(), table.name


def test_output_to_stdout_keeps_tables_off_it(cwcli: Run, intersection: Path) -> None:
    done = cwcli("estimate", intersection, "-o", "-")
    assert done.returncode == 0
    assert {topic for topic, _, _ in messages(done.stdout)} >= STATE_TOPICS
    assert b"Input messages" in done.stderr


def test_json_is_the_only_thing_on_stdout(cwcli: Run, intersection: Path) -> None:
    done = cwcli("run", intersection, "--json")
    document = json.loads(done.stdout, parse_constant=pytest.fail)
    assert done.returncode == 0
    assert list(document["stages"]) == ["estimate", "predict", "warn"]
    for stage in document["stages"].values():
        for entry in stage["inputs"]:
            assert entry["read"] >= entry["used"] >= 0


def test_quiet_prints_nothing(cwcli: Run, intersection: Path) -> None:
    done = cwcli("estimate", intersection, "-o", "e.mcap", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


def test_metadata_holds_the_resolved_configuration(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text('[estimate]\nrate = 10\nmodel = "cwcli"\n')
    done = cwcli(
        "estimate", intersection, "-o", "e.mcap", "--config", "c.toml", "--causal", env={"CWCLI_ESTIMATE_GATE": "0.99"}
    )
    assert done.returncode == 0, done.stderr.decode()
    with (tmp_path / "e.mcap").open("rb") as file:
        records = {record.name: record.metadata for record in make_reader(file).iter_metadata()}
    record = records["cwcli.run.estimate"]
    configuration = json.loads(record["configuration"])
    assert record["input_sha256"] == hashlib.sha256(intersection.read_bytes()).hexdigest()
    assert record["version"] == "0.1.0"
    assert configuration["rate_hz"] == 10
    assert configuration["estimator"]["causal"] is True
    assert configuration["estimator"]["gate_probability"] == 0.99


def test_start_and_end_limit_the_messages(cwcli: Run, intersection: Path) -> None:
    done = cwcli("estimate", intersection, "--start", "2", "--end", "4", "--json")
    stage = json.loads(done.stdout)["stages"]["estimate"]
    fixes = next(entry for entry in stage["inputs"] if entry["topic"] == "/gps/fix")
    assert fixes["read"] == pytest.approx(40, abs=1)


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_metrics_file(cwcli: Run, predicted: Path, tmp_path: Path, suffix: str) -> None:
    from pyarrow import csv, parquet

    done = cwcli("warn", predicted, "--metrics", f"w{suffix}")
    assert done.returncode == 0, done.stderr.decode()
    path = tmp_path / f"w{suffix}"
    table = parquet.read_table(path) if suffix == ".parquet" else csv.read_csv(path)
    assert table.num_columns > 3


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["estimate", "LOG", "-o", "there.mcap"], 6, "exists"),
        (["estimate", "LOG", "-o", "."], 6, "directory"),
        (["estimate", "LOG", "-o", "none/out.mcap"], 6, "does not exist"),
        (["estimate", "LOG", "-o", "LOG", "--force"], 6, "input itself"),
        (["estimate", "LOG", "--metrics", "m.txt"], 2, "Parquet or CSV"),
        (["estimate", "LOG", "--metrics", "x.csv", "-o", "x.csv"], 2, "same file"),
        (["estimate", "LOG", "--metrics", "there.csv"], 6, "exists"),
        (["estimate", "LOG", "-o", "-", "--json"], 2, "standard output"),
        (["estimate", "LOG", "--start", "5", "--end", "4"], 2, "not after"),
        (["estimate", "LOG", "--start", "soon"], 2, "ISO 8601"),
        (["estimate", "LOG", "--topic", "imu"], 2, "ROLE=/topic"),
        (["estimate", "LOG", "--topic", "sonar=/gps/fix"], 2, "sonar"),
        (["estimate", "LOG", "--topic", "imu=/none"], 2, "/none"),
        (["estimate", "LOG", "--latency", "fast"], 2, "--latency"),
        (["estimate", "LOG", "--rate", "0"], 2, "--rate"),
        (["estimate", "LOG", "--latency", "/gps/fix=1e300"], 2, "--latency"),
        (["estimate", "LOG", "--latency", "/none=5"], 2, "no topic /none"),
        (["estimate", "LOG", "--start", "99"], 2, "is after the end of the log"),
        (["estimate", "LOG", "-o", "new/"], 6, "directory"),
        (["predict", "LOG", "--model", "warp", "--horizon", "2"], 2, "warp"),
        (["predict", "LOG"], 4, "cwcli estimate"),
        (["warn", "LOG"], 4, "cwcli"),
        (["run", "LOG", "--metrics-dir", "there.mcap"], 6, "not a folder"),
        (["run", "LOG", "--metrics-dir", "x" * 300], 6, "too long"),
        (["run", "LOG", "--metrics-dir", "x", "-o", "x"], 2, "same file"),
        (["reproduce", "song2016", "--plots", "none/plots"], 6, "does not exist"),
        (["reproduce", "song2016", "--plots", "plots", "--plot-format", "exe"], 2, "exe"),
        (["simulate", "straight"], 2, "-o"),
        (["simulate", "none", "-o", "x.mcap"], 2, "none"),
        (["simulate", "straight", "-o", "there.mcap"], 6, "exists"),
        (["simulate", "straight", "-o", "x.mcap", "--seed", "-1"], 2, "--seed"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_refusals(cwcli: Run, intersection: Path, tmp_path: Path, arguments: list[str], code: int, words: str) -> None:
    names = {"LOG": str(intersection)}
    before = intersection.read_bytes()
    for name in ("there.mcap", "there.csv"):
        (tmp_path / name).write_text("mine")
    done = cwcli(*(names.get(argument, argument) for argument in arguments))
    shown = done.stderr.decode()
    assert done.returncode == code, shown
    assert done.stdout == b""
    assert shown.startswith("error: ")
    assert words in shown
    assert "Traceback" not in shown
    assert sorted(path.name for path in tmp_path.iterdir()) == ["there.csv", "there.mcap"]
    assert (tmp_path / "there.mcap").read_text() == (tmp_path / "there.csv").read_text() == "mine"
    assert intersection.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["predict", "LOG", "--replace", "--start", "99"], 2, "is after the end of the log"),
        (["warn", "LOG", "--start", "99"], 2, "is after the end of the log"),
        (["warn", "LOG", "--distance", "1e300"], 2, "distance"),
        (["warn", "LOG", "--persistence", "1e9"], 2, "persistence"),
        (["warn", "LOG", "--conflict", "nearness"], 2, "there is no measure 'nearness'"),
        (["warn", "LOG", "--conflict", "ttc > 1"], 2, "for example --conflict 'ttc < 1.5'"),
        (["warn", "LOG", "--conflict", "drac > x"], 2, "for example --conflict 'drac > 1.5'"),
        (["warn", "LOG", "--conflict", "ttc < nan"], 2, "'ttc < nan' does not say beyond which value"),
        (["warn", "LOG", "--conflict", "ttc <"], 2, "'ttc <' is not a definition of a conflict"),
        (["warn", "LOG", "--conflict", "pet"], 2, "pet is one number for the whole drive"),
        (["warn", "LOG", "--conflict-ttc", "1.5"], 2, "no such option: --conflict-ttc"),
        (["warn", "LOG", "--max-lead", "-1"], 2, "max lead"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_refusals_of_later_stages(cwcli: Run, predicted: Path, arguments: list[str], code: int, words: str) -> None:
    done = cwcli(*(str(predicted) if argument == "LOG" else argument for argument in arguments))
    shown = done.stderr.decode()
    assert (done.returncode, done.stdout) == (code, b""), shown
    assert words in shown
    assert "Traceback" not in shown


def test_zero_byte_in_a_name_of_the_configuration(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text('[estimate]\ncalibration = "x\\u0000y"\n')
    done = cwcli("estimate", intersection, "--config", "c.toml")
    assert done.returncode in (2, 3), done.stderr.decode()
    assert b"null byte" in done.stderr


def test_force_overwrites(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    (tmp_path / "e.mcap").write_text("old")
    assert cwcli("estimate", intersection, "-o", "e.mcap", "--force", "--quiet").returncode == 0
    assert topics(tmp_path / "e.mcap") >= STATE_TOPICS


def test_replace_replaces_the_channels_of_an_earlier_run(cwcli: Run, predicted: Path, tmp_path: Path) -> None:
    refused = cwcli("predict", predicted, "-o", "p.mcap")
    assert refused.returncode == 6
    assert b"--replace" in refused.stderr
    done = cwcli("predict", predicted, "-o", "p.mcap", "--replace", "--horizon", "1", "--quiet")
    assert done.returncode == 0, done.stderr.decode()
    counts = [
        sum(topic == "/cwcli/ego/path" for topic, _, _ in messages(path.read_bytes()))
        for path in (predicted, tmp_path / "p.mcap")
    ]
    assert counts[0] == counts[1] > 0


def test_run_twice_with_replace(cwcli: Run, predicted: Path, tmp_path: Path) -> None:
    done = cwcli("run", predicted, "-o", "r.mcap", "--replace", "--quiet")
    assert done.returncode == 0, done.stderr.decode()
    assert topics(tmp_path / "r.mcap") >= STATE_TOPICS | PATH_TOPICS | WARNING_TOPICS


def test_closed_pipe_leaves_with_141(intersection: Path) -> None:
    for arguments in (["info", str(intersection)], ["estimate", str(intersection), "-o", "-", "--quiet"]):
        reader, writer = os.pipe()
        os.close(reader)
        done = subprocess.run(
            [sys.executable, "-m", "cwcli", *arguments], stdout=writer, stderr=subprocess.PIPE, check=False, cwd=ROOT
        )
        os.close(writer)
        assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_full_disk_behind_stdout_leaves_with_6(cwcli: Run, intersection: Path) -> None:
    with Path("/dev/full").open("wb") as full:
        done = cwcli("estimate", intersection, "-o", "-", "--quiet", stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 6
    assert done.stderr == b"error: <stdout>: no space is left on the disk\n"


def test_output_to_the_device_of_stdout_keeps_tables_off_it(cwcli: Run, intersection: Path) -> None:
    done = cwcli("estimate", intersection, "-o", "/dev/stdout")
    assert done.returncode == 0
    assert {topic for topic, _, _ in messages(done.stdout)} >= STATE_TOPICS


def test_file_name_that_is_no_utf8(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    name = os.fsdecode(b"caf\xe9\x1b[31m.mcap")
    (tmp_path / name).write_bytes(intersection.read_bytes())
    done = cwcli("estimate", name, "-o", name + ".out")
    assert done.returncode == 0, done.stderr
    assert b"wrote caf\\xe9\\x1b[31m.mcap.out" in done.stdout
    assert b"\x1b" not in done.stdout + done.stderr
    assert json.loads(cwcli("info", name, "--json").stdout)["name"] == name


def spools(pid: int, folder: Path) -> bool:
    """Whether the process has a file open in a folder; it has no name there any more."""
    opened = (str(each.readlink()) for each in Path(f"/proc/{pid}/fd").iterdir() if each.is_symlink())
    return any(name.startswith(str(folder)) for name in opened)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupt_leaves_no_file(tmp_path: Path, number: signal.Signals, code: int) -> None:
    """The run waits for standard input, so it is in the middle of its work when the signal comes."""
    process = subprocess.Popen(
        [sys.executable, "-m", "cwcli", "estimate", "-", "-o", "e.mcap"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)},
    )
    assert process.stdin is not None
    process.stdin.write(b"\x89MCAP0\r\n")
    process.stdin.flush()
    deadline = time.monotonic() + 600
    while not spools(process.pid, tmp_path) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert spools(process.pid, tmp_path)
    process.send_signal(number)
    _, error = process.communicate(timeout=600)
    assert process.returncode == code
    assert b"Traceback" not in error
    assert list(tmp_path.iterdir()) == []


def test_demo_runs_everything_and_names_its_files(cwcli: Run, tmp_path: Path) -> None:
    for _ in range(2):
        done = cwcli("demo")
        shown = done.stdout.decode()
        assert done.returncode == 0, done.stderr.decode()
    assert max(map(len, shown.splitlines())) <= 80
    for path in (tmp_path / "cwcli-demo").rglob("*.*"):
        if path.is_file():
            assert f"wrote {path.relative_to(tmp_path)}" in shown
    assert topics(tmp_path / "cwcli-demo" / "intersection.annotated.mcap") >= WARNING_TOPICS
    digest = cwcli("demo", details=False).stdout.decode().splitlines()
    assert len(digest) <= 12
    assert digest[1].startswith("what   At 4.7 s cwcli warned that the car would collide with vehicle d9583520,")
    assert any(line.startswith("wrote  cwcli-demo/intersection.html (") for line in digest)
    assert any(line.startswith("next   cwcli run YOUR.mcap") for line in digest)


def test_demo_json(cwcli: Run) -> None:
    documents = json.loads(cwcli("demo", "-d", "d", "--json").stdout)["runs"]
    assert [list(document["stages"]) for document in documents] == [["estimate", "predict", "warn"]]


def test_simulate_is_reproducible(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    assert cwcli("simulate", "intersection", "-o", "a.mcap").returncode == 0
    piped = cwcli("simulate", "intersection", "-o", "-")
    assert (tmp_path / "a.mcap").read_bytes() == piped.stdout == intersection.read_bytes()
    assert b"seed 1" in piped.stderr


def test_run_leaves_out_the_warnings_where_there_is_nobody_to_warn_of(
    cwcli: Run, intersection: Path, tmp_path: Path
) -> None:
    straight = intersection.with_name("straight.mcap")
    done = cwcli("run", str(straight), "-o", str(tmp_path / "out.mcap"), "--json")
    assert done.returncode == 0
    told = json.loads(done.stdout)
    assert list(told["stages"]) == ["estimate", "predict"]
    assert "no messages of other vehicles" in told["left_out"]["warn"]
