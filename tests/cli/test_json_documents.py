"""What `--json` prints: every command's document is what schemas/output.schema.json says."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from cwcli.cli.app import load_command
from cwcli.cli.commands import HELP_LINE_BY_COMMAND
from cwcli.cli.main import run_command_line
from cwcli.pipeline.json_names import CellWithValues, heading_to_json_name, table_row_to_json
from cwcli.stages import STAGES
from tests.cli.conftest import ROOT, SAMPLES

SCHEMA = json.loads((ROOT / "schemas" / "output.schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
INTERSECTION = str(SAMPLES / "intersection.mcap")


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("annotated") / "intersection.mcap"
    assert run_command_line(["run", INTERSECTION, "-o", str(target), "--quiet"]) == 0
    return target


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("fleet") / "out"
    assert run_command_line(["run", INTERSECTION, "-d", str(target), "--jobs", "1", "--quiet"]) == 0
    return target


VIEW = ["view", "ANNOTATED", "-o", "x.rrd"]
OTHERS = {"lanes", "observe", "predict-lane", "warn-lane", "track", "warn-targets"}
"""Stages that need frames or detections; their documents are held to the schema where they are tested."""
CASES = [
    ["info", INTERSECTION],
    ["info", INTERSECTION, "--doctor"],
    ["info", "ANNOTATED"],
    *([stage, "ANNOTATED", "-o", "o.mcap", "--replace"] for stage in STAGES if stage not in OTHERS),
    ["run", INTERSECTION, "-o", "o.mcap"],
    ["run", INTERSECTION, "-d", "out", "--jobs", "1"],
    ["demo", "-d", "d"],
    ["evaluate", "ANNOTATED", "--gate", "ego.position_rmse_m < 1"],
    ["evaluate", "FOLDER"],
    ["compare", "FOLDER", "FOLDER"],
    ["report", "ANNOTATED", "-o", "r.html"],
    ["plot", "ANNOTATED", "--what", "motion", "-o", "m.svg"],
    ["export", "ANNOTATED", "-o", "x.csv"],
    ["import", "TABLE", "-o", "i.mcap"],
    ["export", "ANNOTATED", "--format", "ros2", "-o", "x.mcap"],
    VIEW,
    ["layout", "-o", "l.json"],
    ["join", INTERSECTION, "ANNOTATED", "-o", "j.mcap"],
    ["cut", "ANNOTATED", "--start", "2", "--end", "4", "-o", "cut.mcap"],
    ["find", "ANNOTATED", "all", "--clips", "clips"],
    ["merge", "FOLDER", "-d", "merged"],
    ["calibrate", str(SAMPLES / "curve.mcap"), "-o", "c.toml"],
    ["simulate", "intersection", "-o", "s.mcap"],
    ["reproduce", "xiang2019", "--seeds", "2", "--jobs", "1"],
    ["conform", "--list"],
    ["conform", "etsi-101-539", "--seeds", "1", "--jobs", "1"],
]


@pytest.mark.parametrize(
    "arguments",
    [pytest.param(case, marks=pytest.mark.peer("rerun")) if case is VIEW else case for case in CASES],
    ids=" ".join,
)
def test_a_document_is_what_the_schema_says(
    annotated: Path,
    folder: Path,
    tmp_path: Path,
    arguments: list[str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    places = {"ANNOTATED": str(annotated), "FOLDER": str(folder), "TABLE": "drive.csv"}
    (tmp_path / "drive.csv").write_text("time,speed [m/s]\n1700000000,1\n1700000001,2\n1700000002,2\n")
    code = run_command_line([*(places.get(each, each) for each in arguments), "--json"])
    said = capsys.readouterr()
    if arguments[0] not in ("reproduce", "conform"):
        assert code == 0, said.err
    document = json.loads(said.out)
    assert document["command"] == arguments[0]
    assert list(map(str, VALIDATOR.iter_errors(document))) == []


def test_document_of_a_doubtful_log_is_what_the_schema_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = [f"{1_700_000_000 + k / 10},{48 + k % 3 * 1e-7:.7f},11" for k in range(200)]  # it stands for 20 s
    (tmp_path / "still.csv").write_text("\n".join(["time,lat,lon", *rows]))
    assert run_command_line(["run", "still.csv", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [doubt["name"] for doubt in document["digest"]["doubts"]] == ["heading"]
    assert list(map(str, VALIDATOR.iter_errors(document))) == []


def test_every_command_with_json_is_in_the_schema() -> None:
    printing = {
        name for name in HELP_LINE_BY_COMMAND if any("--json" in each.opts for each in load_command(name).params)
    }
    known = {
        name
        for each in SCHEMA["$defs"].values()
        for command in [each.get("properties", {}).get("command", {})]
        for name in command.get("enum", [command.get("const")])
    } - {None}
    assert printing - {"config"} == known  # what `config` prints is a pipeline file
    assert {case[0] for case in CASES} | OTHERS == known


def test_the_schema_refuses_names_and_values_for_people() -> None:
    good: dict[str, Any] = {
        "cwcli": "1", "command": "estimate", "input": "a", "output": "b", "written": [], "faults": {}, "left_out": {},
        "stages": {"estimate": {"title": "", "sections": {"t": [{"speed_mps": 1.0}]}, "inputs": [], "notes": []}},
    }  # fmt: skip
    assert VALIDATOR.is_valid(good)
    for row in ({"speed [m/s]": 1.0}, {"Speed": 1.0}, {"speed_mps": [1.0]}):
        good["stages"]["estimate"]["sections"]["t"] = [row]
        assert not VALIDATOR.is_valid(good)


@pytest.mark.parametrize(
    ("heading", "end", "name"),
    [
        ("latency [ms]", "", "latency_ms"),
        ("latency [ms]", "sigma", "latency_sigma_ms"),
        ("max speed [m/s]", "", "max_speed_mps"),
        ("NIS/dof", "", "nis_per_dof"),
        ("seen [%]", "", "seen_percent"),
        ("rate_hz [Hz]", "", "rate_hz"),
        ("error of", "", "error_of"),
        ("x [furlong/s]", "", "x_furlong_s"),
        ("95 % from", "", "at_95_percent_from"),
    ],
)
def test_a_heading_becomes_a_name_with_its_unit(heading: str, end: str, name: str) -> None:
    assert heading_to_json_name(heading, end) == name
    assert re.fullmatch("[a-z][a-z0-9_]*", name)


def test_cells_become_values() -> None:
    told = CellWithValues("12 +- 3", {"": 12.0, "sigma": 3.0})
    row = table_row_to_json(("latency [ms]", "status", "most"), (told, "", float("nan")))
    assert row == {"latency_ms": 12.0, "latency_sigma_ms": 3.0, "status": None, "most": None}
    with pytest.raises(ValueError, match="two columns are at_s"):
        table_row_to_json(("at [s]", "at [s]"), (1.0, 2.0))


def test_latencies_are_numbers(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert run_command_line(["estimate", INTERSECTION, "-o", str(tmp_path / "o.mcap"), "--json"]) == 0
    sections = json.loads(capsys.readouterr().out)["stages"]["estimate"]["sections"]
    assert {type(row["latency_ms"]) for row in sections["sources"]} <= {float, type(None)}
    bias = next(row for row in sections["parameters"] if row["quantity"] == "accel")
    assert bias["unit"] == "m/s^2" and abs(bias["value"]) < 0.1 and bias["value_sigma"] > 0.0
    assert all(row["bounds_95_low"] < 1.0 < row["bounds_95_high"] for row in sections["noise"])
    assert {type(row["inside"]) for row in sections["noise"]} == {bool}
