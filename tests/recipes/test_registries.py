"""The recipes of the registries: what is added shows up wherever its kind does, works on a log, and obeys the laws."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Strings
from tests.recipes.conftest import Built
from tests.recipes.house import SAMPLES
from tests.unit.vision import lane_logs

INTERSECTION = SAMPLES / "intersection.mcap"


def spaced(text: str) -> str:
    return " ".join(text.split())


def test_a_measure_is_a_column_a_conflict_and_a_section_of_the_docs(built: Built, tmp_path: Path) -> None:
    house = built("A measure")
    house.python("-m", "tools.compile_schemas")
    house.run("run", INTERSECTION, "-o", "out.mcap", "--metrics-dir", "m", "--warn-conflict", "closing > 10")
    (pair,) = pq.read_table(house.folder / "m" / "pairs.parquet").to_pylist()
    assert 10.0 < pair["max_closing_mps"] < 19.0  # the cars drive 9 and 10 m/s
    assert pq.read_table(house.folder / "m" / "conflicts.parquet").num_rows == 1
    house.run("measure", "out.mcap", "-o", "measured.mcap", "--measures", "closing", "--metrics-dir", "n")
    with Log.open(house.folder / "measured.mcap") as log:
        closing_mps = np.asarray(log.columns("/cwcli/measures").fields["closing_mps"])
    assert closing_mps.max() == pytest.approx(pair["max_closing_mps"], rel=0.01)
    assert "closing_mps" in pq.read_schema(house.folder / "n" / "measures.parquet").names
    assert "closing" in house.run("measure", "--help")
    (house.folder / "p.toml").write_text('[warn]\nconflict = "closing > 10"\n')
    assert 'conflict = "closing > 10"' in house.run("config", "p.toml")
    house.run("report", "out.mcap", "-o", "out.html")
    assert "the closing speed of the centres was above 10 m/s" in (house.folder / "out.html").read_text()
    docs = house.write_docs()
    assert "| `closing` | closing speed of the centres | m/s |" in docs
    assert "## `closing`" in docs
    house.obeys_its_laws()


def test_a_rule_warns_and_stands_in_help_and_docs(built: Built) -> None:
    house = built("A collision rule")
    house.run("run", INTERSECTION, "-o", "out.mcap", "--warn-rule", "nearest")
    with Log.open(house.folder / "out.mcap") as log:
        rule = log.columns("/cwcli/warnings").fields["rule"]
    assert isinstance(rule, Strings) and rule.values == ("nearest",)
    line = "nearest: paths whose centres pass nearer than --distance."
    assert line in spaced(house.run("warn", "--help"))
    assert line in spaced(house.run("run", "--help"))
    assert 'rule = "nearest"' in house.run("config", CWCLI_WARN_RULE="nearest")
    assert "| `nearest` | paths whose centres pass nearer than --distance | 0.2 s |" in house.write_docs()
    house.obeys_its_laws()


def test_a_motion_model_predicts_is_compared_and_stands_in_help_and_docs(built: Built) -> None:
    house = built("A motion model")
    arguments = ("--stage", "estimate,predict", "--predict-model", "cv-cya", "--json")
    told = json.loads(house.run("run", INTERSECTION, "-o", "out.mcap", *arguments))
    assert "cv-cya" in json.dumps(told["stages"]["predict"]["sections"])
    with Log.open(house.folder / "out.mcap") as log:
        columns = log.columns("/cwcli/ego/path")
        model = columns.fields["model"]
        assert isinstance(model, Strings) and model.values == ("cv-cya",)
        speed_mps = np.asarray(columns.fields["speed_mps"])
    assert np.ptp(speed_mps, axis=1).max() == 0.0
    assert "cv-cya: constant speed, constant yaw acceleration." in spaced(house.run("predict", "--help"))
    assert 'model = "cv-cya"' in house.run("config", CWCLI_PREDICT_MODEL="cv-cya")
    assert "| `cv-cya` | constant speed, constant yaw acceleration |  |  | yes | yes |" in house.write_docs()
    house.obeys_its_laws()


def test_an_event_is_found_alone_and_in_expressions_and_stands_in_the_docs(built: Built) -> None:
    house = built("An event")
    house.run("run", INTERSECTION, "-o", "out.mcap")
    told = json.loads(house.run("find", "out.mcap", "hard-corner or ego.speed_mps > 1", "--json"))
    assert [each["event"] for each in told["events"]] == ["expression"]
    assert json.loads(house.run("find", "out.mcap", "hard-corner", "--json"))["found"] == 0
    assert (
        "| `hard-corner` | the ego corners hard | 4 m/s^2 | chosen | peak_lateral_mps2 | states |" in house.write_docs()
    )
    house.obeys_its_laws()


def test_a_lane_method_finds_the_lane_and_stands_in_help_and_docs(built: Built) -> None:
    house = built("A lane method")
    frames = lane_logs.write_log(house.folder / "frames.mcap", lane_logs.road_frames(3))
    house.run("run", frames, "-o", "out.mcap", "--lanes-method", "narrow")
    with Log.open(house.folder / "out.mcap") as log:
        found = log.columns("/cwcli/lanes").fields
    assert np.all(np.asarray(found["left.found"])) and np.all(np.asarray(found["right.found"]))
    assert "narrow: as cwcli, on frames of at most 320 columns" in spaced(house.run("lanes", "--help"))
    assert 'method = "narrow"' in house.run("config", CWCLI_LANES_METHOD="narrow")
    assert "| `narrow` | as cwcli, on frames of at most 320 columns |" in house.write_docs()
    house.obeys_its_laws()


def test_a_command_runs_and_stands_in_help_and_docs(built: Built) -> None:
    house = built("A command")
    with Log.open(INTERSECTION) as log:
        topics = [channel.topic for channel in log.channels]
    assert house.run("topics", INTERSECTION).split() == topics
    assert house.run("topics", INTERSECTION, "--below", "/gps").split() == [each for each in topics if "/gps" in each]
    assert "topics Print the topics of a log." in spaced(house.run("--help"))
    assert "cwcli topics drive.mcap" in house.run("topics", "--help")
    assert "## cwcli topics\n" in house.write_docs()
    house.obeys_its_laws()


def test_a_clause_is_listed_judged_and_held_to_its_source(built: Built) -> None:
    house = built("A clause of a standard")
    assert "house-fcw" in house.run("conform", "--list")
    told = json.loads(house.run("conform", "house-fcw", "--json", "--jobs", "1", "--horizon", "5"))
    (clause,) = told["clauses"]
    assert (clause["outcome"], clause["trials"][0]["required"]) == ("pass", 2)
    # 240 m at 20 m/s: 0.3 of the way is left 3.6 s before the contact, and the rule looks 5 s ahead at most
    assert 0.0 < clause["trials"][0]["repetitions"][0]["margin"] < 1.5
    house.python("-m", "tools.conformance", "house-fcw")
    assert "| house-fcw | as published | 3 | " in (house.folder / "docs/conformance.md").read_text()
    house.obeys_its_laws()


def test_a_doubt_is_found_and_stands_in_the_docs(built: Built) -> None:
    house = built("A doubt")
    assert "| `spin` | a turn that no car makes | 120 degrees/s | chosen: above a spin on ice |" in house.write_docs()
    house.obeys_its_laws()


def test_an_import_format_becomes_a_log(built: Built) -> None:
    house = built("An import format")
    head = ["Geolife trajectory", "WGS 84", "Altitude is in Feet", "Reserved 3", "0,2,255,My Track,0,0,2,8421376", "0"]
    rows = [f"39.98{k},116.3,0,492,{39744.125 + k / 86400:.10f},2008-10-23,03:00:0{k}" for k in range(3)]
    (house.folder / "drive.plt").write_text("\n".join([*head, *rows]))
    house.run("import", "drive.plt", "-o", "log.mcap")
    with Log.open(house.folder / "log.mcap") as log:
        assert np.asarray(log.columns("/gps/fix").fields["latitude"]).tolist() == [39.98, 39.981, 39.982]
        assert log.start_ns == 1_224_730_800 * 10**9  # `date -u -d "2008-10-23 03:00" +%s`
    house.obeys_its_laws()
