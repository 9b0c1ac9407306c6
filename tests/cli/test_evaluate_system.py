"""`cwcli evaluate --topic`: another system in the log, from the command line; and the commands of its page."""

from __future__ import annotations

import json
import math
import re
import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.cli.main import run_command_line
from cwcli.digest.drive import read_drive
from cwcli.digest.encounters import find_encounters
from cwcli.evaluation.system_topics import parse_other_system_options
from cwcli.logs.read.reader import Log
from cwcli.measures import MEASURES
from cwcli.report.encounter_figures import distance_and_ttc_figure_around_warning
from cwcli.report.signal_figures import motion_figure
from cwcli.report.system import judge_warnings_of_other_system, other_system_sentences, other_system_tables
from tests.cli.rewritten_logs import Logged, read, write

ROOT = Path(__file__).parents[2]
BOOL = ("std_msgs/msg/Bool", "ros2msg", b"bool data")
UP_S = (3.2, 5.0)


def flag(t0_ns: int) -> Iterator[Logged]:
    """50 Hz: up once before the collision of the intersection."""
    for k in range(500):
        data = bytes([0, 1, 0, 0, int(UP_S[0] <= k * 0.02 < UP_S[1])])
        yield Logged("/adas/fcw", "cdr", BOOL, t0_ns + k * 20_000_000, data)


def motion(path: Path) -> Iterator[Logged]:
    """An odometry that is the truth, but 2 m to the north, and a plan: straight on at this speed."""
    with Log.open(path) as log:
        truth = log.columns("/truth/ego").fields
    columns = (np.asarray(truth[name]) for name in ("stamp_ns", "x_m", "y_m", "heading_rad", "speed_mps"))
    for stamp_ns, x_m, y_m, heading, speed in zip(*(each.tolist() for each in columns), strict=True):
        sec, nanosec = divmod(stamp_ns, 10**9)
        header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "odom"}
        turn = {"x": 0.0, "y": 0.0, "z": math.sin(heading / 2), "w": math.cos(heading / 2)}
        points = []
        for k in range(41):
            at = {"x": x_m + 0.1 * k * speed * math.cos(heading), "y": y_m + 2.0 + 0.1 * k * speed * math.sin(heading)}
            time = {"sec": k // 10, "nanosec": 100_000_000 * (k % 10)}
            points.append({"time_from_start": time, "pose": {"position": at}, "longitudinal_velocity_mps": speed})
        pose = {"pose": {"position": {**points[0]["pose"]["position"], "z": 0.0}, "orientation": turn}}
        twist = {"twist": {"linear": {"x": speed, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}}
        odometry = {"header": header, "child_frame_id": "base_link", "pose": pose, "twist": twist}
        plan = {"header": header, "points": points}
        for topic, schema, message in (
            ("/odometry", "nav_msgs/msg/Odometry", odometry),
            ("/planning/trajectory", "autoware_planning_msgs/msg/Trajectory", plan),
        ):
            yield Logged(topic, "json", (schema, "jsonschema", b"{}"), stamp_ns, json.dumps(message).encode())


@pytest.fixture(scope="module")
def drive(intersection: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled intersection with a warning function in it, annotated: drive.mcap and annotated.mcap."""
    folder = tmp_path_factory.mktemp("system")
    messages = read(intersection)
    both = sorted([*messages, *flag(messages[0].log_time_ns), *motion(intersection)], key=lambda each: each.log_time_ns)
    write(folder / "drive.mcap", both)
    arguments = ["run", str(folder / "drive.mcap"), "-o", str(folder / "annotated.mcap"), "--quiet"]
    assert run_command_line(arguments) == 0
    return folder


def document(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, Any]:
    code = run_command_line([*map(str, arguments), "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_the_other_system_stands_beside_cwcli(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    annotated, option = drive / "annotated.mcap", "--topic=warning=/adas/fcw:data==true"
    code, found = document(capsys, "evaluate", annotated, option)
    assert code == 0
    metrics = found["logs"][0]["metrics"]
    assert metrics["system.warnings.recall"]["value"] == metrics["warnings.recall"]["value"] == 1.0
    own_raised_s = (
        3.2 + metrics["system.warnings.lead_time_mean_s"]["value"] - metrics["warnings.lead_time_mean_s"]["value"]
    )
    assert run_command_line(["evaluate", str(annotated), option, "--markdown", str(tmp_path / "summary.md")]) == 0
    assert (
        "| metric | the other system | cwcli | states/reference | samples of the other system |"
        in (tmp_path / "summary.md").read_text()
    )
    assert "The other system and cwcli" in capsys.readouterr().out
    assert 4.0 < own_raised_s < 5.5  # cwcli warns 0.8 to 2.3 s after the flag


def test_the_commands_of_the_page_hold(drive: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    page = (ROOT / "docs" / "evaluation.md").read_text(encoding="utf-8")
    (section,) = re.findall(r"## Is my FCW late\?\n(.*?)\n## ", page, re.DOTALL)
    commands = [shlex.split(line.strip()) for line in section.splitlines() if line.startswith("    cwcli ")]
    assert len(commands) >= 3
    monkeypatch.chdir(drive)
    for program, *arguments in commands:
        assert program == "cwcli"
        if arguments[0] == "run":
            arguments += ["--force"]
        assert run_command_line([*arguments]) == 0, arguments
    said = capsys.readouterr().out
    assert "The other system and cwcli" in said
    assert "passed" in said


def test_its_state_and_its_path_stand_beside_cwclis(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The odometry is the truth; the car goes straight at a steady speed, so the plan is what happens."""
    options = ("--topic=ego_state=/odometry", "--topic=ego_path=/planning/trajectory")
    code, found = document(capsys, "evaluate", drive / "annotated.mcap", *options)
    assert code == 0
    metrics = found["logs"][0]["metrics"]
    assert metrics["system.ego.position_rmse_m"]["value"] < 1e-6
    assert metrics["system.prediction.ego.truth_fde_2.5s_m"]["value"] < 1e-6
    assert metrics["system.prediction.ego.truth_fde_2.5s_m"]["states"] == "system vs truth"
    assert metrics["ego.position_rmse_m"]["states"] == "hindsight vs truth"


def test_a_gate_on_the_other_system(drive: Path) -> None:
    option = "--topic=warning=/adas/fcw:data==true"
    arguments = ["evaluate", str(drive / "annotated.mcap"), option, "--quiet", "--gate"]
    assert run_command_line([*arguments, "system.warnings.recall >= 0.9"]) == 0
    assert run_command_line([*arguments, "system.warnings.lead_time_mean_s > 60"]) == 1


@pytest.mark.parametrize(
    ("option", "code", "said"),
    [
        ("warning=/adas/fcw:dta==true", 2, "found: data (true or false)"),
        ("warning=/adas/fcw", 2, "expected warning=/topic:field==value"),
        ("warning=/adas/fcx:data==true", 2, "the log has no such topic"),
        ("fcw=/adas/fcw:data==true", 2, "there is no role fcw of another system"),
        ("warning=/adas/fcw:data=true", 2, "expected `.`, `[` or one of"),
        ("warning=/adas/fcw:data==1.5x", 2, "can't be compared so"),
    ],
)
def test_what_can_not_be_judged(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, code: int, said: str
) -> None:
    metrics = tmp_path / "m.csv"
    arguments = ["evaluate", str(drive / "annotated.mcap"), "--topic", option, "--metrics", str(metrics)]
    assert run_command_line(arguments) == code
    assert said in " ".join(capsys.readouterr().err.split())
    assert not metrics.exists()


def test_a_log_without_states_and_a_table_can_not_be_judged(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    option = "--topic=warning=/adas/fcw:data==true"
    assert run_command_line(["evaluate", str(drive / "drive.mcap"), option]) == 4
    assert "holds no states of the ego and the others" in " ".join(capsys.readouterr().err.split())
    assert (
        run_command_line(
            ["evaluate", str(drive / "annotated.mcap"), "--metrics", str(tmp_path / "m.parquet"), "--quiet"]
        )
        == 0
    )
    assert run_command_line(["evaluate", str(tmp_path / "m.parquet"), option]) == 2
    assert "--topic needs the annotated logs" in " ".join(capsys.readouterr().err.split())


def test_the_report_shows_the_other_systems_warnings(drive: Path, tmp_path: Path) -> None:
    page, option = tmp_path / "report.html", "--topic=warning=/adas/fcw:data==true"
    assert run_command_line(["report", str(drive / "annotated.mcap"), "-o", str(page), option, "--quiet"]) == 0
    text = page.read_text(encoding="utf-8")
    assert "The other system (/adas/fcw) gave 1 warning: 1 came true. It warned of 1 of 1 conflict" in text
    assert (
        "A careful driver would not have braked, and would have crashed at 15." in text
    )  # the regulation's looks ahead only
    assert "The other system and cwcli" in text
    assert "Warnings of /adas/fcw" in text
    assert run_command_line(["report", str(drive / "annotated.mcap"), "-o", str(page), "--force", "--quiet"]) == 0
    assert "other system" not in page.read_text(encoding="utf-8")


def test_the_figures_mark_the_other_systems_warnings(drive: Path) -> None:
    system = parse_other_system_options(["warning=/adas/fcw:data==true"])
    with Log.open(drive / "annotated.mcap") as log:
        found = read_drive(log)
        judged = replace(found, other_system=judge_warnings_of_other_system(log, system))
    meetings = find_encounters(judged)
    for figure in (
        motion_figure(judged, meetings, 100),
        distance_and_ttc_figure_around_warning(judged, meetings.encounters[0]),
    ):
        assert figure is not None
        marks = [label["x"] for label in figure["layout"]["annotations"] if label["text"] == "other system"]
        assert marks == [UP_S[0]]
    shown = distance_and_ttc_figure_around_warning(judged, meetings.encounters[0])
    assert shown is not None
    words = [label["text"] for label in shown["layout"]["annotations"]]
    thresholds = [f"{MEASURES['ttc'].threshold:g} s: a conflict", f"{MEASURES['drac'].threshold:g} m/s²: a conflict"]
    assert words[:3] == ["2.5 m counts as a collision", *thresholds]
    assert {"y2", "y3"} <= {trace.get("yaxis") for trace in shown["data"]}
    assert other_system_sentences(found) == []
    assert other_system_tables(found, {}) == []


def test_a_report_of_a_wrong_field_is_not_written(drive: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    option = "--topic=warning=/adas/fcw:dta==true"
    assert run_command_line(["report", str(drive / "annotated.mcap"), "-o", str(page), option, "--quiet"]) == 2
    assert not page.exists()


def test_a_run_over_several_logs(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    option = "--topic=warning=/adas/fcw:data==true"
    for name in ("a", "b"):
        (tmp_path / f"{name}.mcap").write_bytes((drive / "drive.mcap").read_bytes())
    logs = [str(tmp_path / f"{name}.mcap") for name in ("a", "b")]
    assert run_command_line(["run", *logs, "-d", str(tmp_path / "out"), "--jobs", "1", "--quiet"]) == 0
    code, found = document(capsys, "evaluate", tmp_path / "out", option)
    assert code == 0
    assert found["pooled"]["system.warnings.count"]["value"] == 2
    page = tmp_path / "report.html"
    assert run_command_line(["report", str(tmp_path / "out"), "-o", str(page), option, "--quiet"]) == 0
    assert page.read_text(encoding="utf-8").count("Warnings of /adas/fcw") == 2


def test_the_page_of_one_drive_of_a_run_has_the_drives_name(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every annotated log of a run is called annotated.mcap; tab, header and log say which drive it is."""
    (tmp_path / "tuesday.mcap").write_bytes((drive / "drive.mcap").read_bytes())
    assert (
        run_command_line(["run", str(tmp_path / "tuesday.mcap"), "-d", str(tmp_path / "out"), "--jobs", "1", "--quiet"])
        == 0
    )
    monkeypatch.chdir(tmp_path / "out" / "logs" / "tuesday")
    for source in (tmp_path / "out", Path("annotated.mcap").resolve(), Path("annotated.mcap")):
        assert run_command_line(["report", str(source), "-o", str(tmp_path / "r.html"), "--force", "--quiet"]) == 0
        text = (tmp_path / "r.html").read_text(encoding="utf-8")
        assert "<title>cwcli report: tuesday</title>" in text
        assert '<p class="kicker">cwcli report · tuesday</p>' in text
        assert "annotated.mcap" not in text
